"""What an accelerator costs to build and what it saves: contestants that differ in their accelerator alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from harness.analysis import axes
from harness.analysis.comparisons import race_of
from harness.analysis.model import Analysis, seconds_per_sample
from harness.analysis.scaling import microseconds_a_path
from harness.statistics import Estimate, Ratio, geometric_interval
from harness.store.results import Contestant, Results, phase_seconds


class BreakEven(NamedTuple):
    """An accelerator beside the one of its family that is built fastest, `baseline` (None for that one itself).

    `break_even_spp`: samples per pixel from which on its build and rendering together take less; inf: never; None: unresolved.
    """

    contestant: Contestant
    baseline: Contestant | None
    build_seconds: Estimate
    path_microseconds: Estimate
    speedup: Ratio | None
    break_even_spp: Estimate | None


def families(results: Results) -> list[list[Contestant]]:
    """Measured contestants that differ in the accelerator alone, two or more, the quickest build first."""
    timed = [c for c in results.contestants if not c.settings.label and seconds_per_sample(c)]
    return [sorted(group, key=lambda c: build(c).value) for group in axes.families(timed, "accelerator") if len(group) > 1]


def build_seconds(contestant: Contestant) -> dict[int, float]:
    """Block -> seconds of the build."""
    return {cell.block: phase_seconds(cell, "build") for cell in contestant.done}


def build(contestant: Contestant) -> Estimate:
    """Geometric mean over seeds of the seconds of the build."""
    return geometric_interval(list(build_seconds(contestant).values()))


def break_evens(analysis: Analysis) -> Iterator[BreakEven]:
    """Every member of every family; none of its ratios of a contestant with a flag that disqualifies it."""
    unfit = {id(verdict.contestant) for verdict in analysis.verdicts if verdict.disqualified}
    for family in families(analysis.results):
        first, *others = family
        yield BreakEven(first, None, build(first), microseconds_a_path(first), None, None)
        compared = [(row, 0) for row, other in enumerate(family) if row and not unfit & {id(first), id(other)}]
        floor, margin = analysis.floor(first.settings.scene), analysis.results.config.same_within
        ratios = race_of([seconds_per_sample(c) for c in family], compared, floor, margin).ratios
        found = {row: ratio for (row, _), ratio in zip(compared, ratios, strict=True)}
        for row, other in enumerate(others, 1):
            yield BreakEven(
                other,
                first,
                build(other),
                microseconds_a_path(other),
                found.get(row),
                break_even_spp(first, other, found.get(row)),
            )


def break_even_spp(first: Contestant, other: Contestant, speedup: Ratio | None) -> Estimate | None:
    """Geometric mean over blocks of (build - build of the first) / (seconds per sample that it saves), where it surely
    saves some.

    0 where some build is no dearer. Surely none saved: never.
    """
    if speedup is None or speedup.verdict not in ("faster", "slower"):
        return None
    if speedup.verdict == "slower":
        return Estimate(math.inf, math.nan, math.nan, speedup.blocks)
    samples, builds = ([function(c) for c in (first, other)] for function in (seconds_per_sample, build_seconds))
    blocks = sorted(samples[0].keys() & samples[1].keys())
    saved = [samples[0][block] - samples[1][block] for block in blocks]
    dearer = [max(builds[1][block] - builds[0][block], 0.0) for block in blocks]
    return geometric_interval([d / s for d, s in zip(dearer, saved, strict=True)]) if min(saved) > 0 else None
