"""How cost grows: families of contestants that differ in one size alone, and the exponents of their times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from harness.analysis import axes
from harness.analysis.model import Analysis, seconds_per_sample
from harness.statistics import Estimate, amdahl_fit, geometric_interval, mean_interval
from harness.store.records import Cell
from harness.store.results import Contestant, Results, phase_seconds

FEWEST = 3
"""Sizes from which on an exponent is shown."""
Samples = dict[int, dict[int, float]]
"""Size -> block -> seconds."""


class ScalingExponent(NamedTuple):
    """d log seconds / d log size between two sizes: 0 is no growth, 1 proportion. Interval: Student's over blocks.

    `exponent` is that over all sizes, `exponent_last` that between the two largest.
    """

    contestant: str
    cost: str
    over: str
    smallest: int
    largest: int
    exponent: Estimate
    exponent_last: Estimate


def primitives(contestant: Contestant) -> int:
    return contestant.cells[0].primitives


def pixels(cell: Cell) -> int:
    return cell.width * cell.height


def families(analysis: Analysis, axis: str, size: Callable[[Contestant], int]) -> list[list[Contestant]]:
    """Contestants that differ in one setting alone, three or more different sizes, the smallest first."""
    timed = [c for c in (verdict.contestant for verdict in analysis.verdicts) if seconds_per_sample(c) and size(c)]
    ordered = [sorted(group, key=size) for group in axes.families((c for c in timed if not c.settings.label), axis)]
    return [group for group in ordered if len({size(contestant) for contestant in group}) >= FEWEST]


def name_of(family: Sequence[Contestant]) -> str:
    """The name that the family's members share."""
    first = family[0]
    return " ".join(word for word in first.name.split() if word != first.settings.size)


def microseconds_a_path(contestant: Contestant) -> Estimate:
    """Geometric mean over seeds of the warm time of a path (a sample of a pixel)."""
    return geometric_interval([1e6 * seconds for seconds in path_seconds(contestant).values()])


def path_seconds(contestant: Contestant) -> dict[int, float]:
    """Block -> warm seconds of a path."""
    return {block: s / pixels(contestant.done[0]) for block, s in seconds_per_sample(contestant).items()}


def passes(contestant: Contestant) -> Samples:
    """Samples per pixel so far -> block -> seconds of a path in the pass that ended there."""
    found: Samples = {}
    for cell in contestant.done:
        before = (0.0, 0.0)
        for point in cell.points:
            spp, seconds = point.samples - before[0], point.seconds - before[1]
            found.setdefault(point.spp, {})[cell.block] = seconds / (spp * pixels(cell))
            if not cell.separate_renders:
                before = point.samples, point.seconds
    return dict(sorted(found.items()))


def scaling_exponents(analysis: Analysis) -> Iterator[ScalingExponent]:
    """Time of a path and of the build over primitives; time of a path over pixels and over samples."""
    over_scenes = families(analysis, "scene", primitives)
    over_sizes = families(analysis, "size", lambda contestant: pixels(contestant.done[0]))
    for family in over_scenes:
        yield from _exponents(family[-1], "path", "primitives", {primitives(c): path_seconds(c) for c in family})
        built = {primitives(c): {cell.block: phase_seconds(cell, "build") for cell in c.done} for c in family}
        yield from _exponents(family[-1], "build", "primitives", built)
    for family in over_sizes:
        yield from _exponents(family[-1], "path", "pixels", {pixels(c.done[0]): path_seconds(c) for c in family})
        yield from _exponents(family[-1], "path", "samples per pixel", passes(family[-1]))


def _exponents(contestant: Contestant, cost: str, over: str, seconds: Samples) -> Iterator[ScalingExponent]:
    """Nothing below `FEWEST` sizes with a time."""
    timed = {size: {b: s for b, s in blocks.items() if s > 0} for size, blocks in sorted(seconds.items())}
    sizes = [size for size, blocks in timed.items() if blocks]
    if len(sizes) >= FEWEST:
        exponents = exponent(timed, sizes), exponent(timed, sizes[-2:])
        yield ScalingExponent(contestant.name, cost, over, sizes[0], sizes[-1], *exponents)


def exponent(seconds: Samples, sizes: Sequence[int]) -> Estimate:
    """Least-squares slope of log seconds over log size in each block that has all of them, averaged over blocks."""
    blocks = sorted(set.intersection(*(set(seconds[size]) for size in sizes)))
    x = np.log(np.array(sizes, np.float64))
    lever = (x - x.mean()) / ((x - x.mean()) ** 2).sum()
    slopes = [float(lever @ np.log([seconds[size][block] for size in sizes])) for block in blocks]
    return mean_interval(slopes)


def thread_families(results: Results) -> list[list[Contestant]]:
    """Measured contestants that differ in threads alone, two or more, by rising thread count."""
    families = axes.families(filter(seconds_per_sample, results.contestants), "threads")
    return [sorted(family, key=lambda c: c.settings.threads) for family in families if len(family) > 1]


def serial_fraction_of(results: Results, family: Sequence[Contestant]) -> Estimate:
    """Amdahl's serial fraction of a family of `thread_families`, from thread counts up to the usable cores of its machine:
    more threads wait for each other, which the law does not describe."""
    cores = _usable_cores(results, family[0].settings.machine)
    return amdahl_fit({c.settings.threads: seconds_per_sample(c) for c in family if c.settings.threads <= cores})


def _usable_cores(results: Results, machine: str) -> float:
    """Infinite where the results do not say it. `machine` is the beginning of the id of an environment."""
    known = (e.preimage.get("usable_cores") for name, e in results.environments.items() if name.startswith(machine))
    return next((cores for cores in known if isinstance(cores, int)), math.inf)
