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
from harness.store.results import Contestant, Results, phase_seconds, setting_text


class BreakEven(NamedTuple):
    """An accelerator, and what it is beside the `baseline`, the one of its family that is built fastest; without a ratio for
    that one itself, and where a flag disqualifies one of the two.

    `speedup` is in the time of a path. `break_even_spp`: samples per pixel from which on its build and rendering together take
    less; inf: never; None: unresolved.
    """

    scene: str
    contestant: str
    build_seconds: Estimate
    path_microseconds: Estimate
    baseline: str = ""
    speedup: Estimate | None = None
    verdict: str = ""
    break_even_spp: Estimate | None = None


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
    """Every member of every family, the quickest build first."""
    unfit = {verdict.contestant for verdict in analysis.verdicts if verdict.disqualified}
    for family in families(analysis.results):
        first = family[0]
        fit = [row for row, other in enumerate(family) if row and not unfit & {first, other}]
        spread, margin = analysis.spread(first), analysis.results.config.same_within
        ratios = race_of([seconds_per_sample(c) for c in family], [(row, 0) for row in fit], spread, margin).ratios
        compared = dict(zip(fit, ratios, strict=True))
        for row, other in enumerate(family):
            known = BreakEven(other.settings.scene, other.name, build(other), microseconds_a_path(other))
            if ratio := compared.get(row):
                known = known._replace(
                    baseline=setting_text("accelerator", first.settings.accelerator),
                    speedup=Estimate(*ratio[:4]),
                    verdict=ratio.verdict,
                    break_even_spp=break_even_spp(first, other, ratio),
                )
            yield known


def break_even_spp(first: Contestant, other: Contestant, speedup: Ratio) -> Estimate | None:
    """Geometric mean over blocks of (build - build of the first) / (seconds per sample that it saves), where it surely
    saves some.

    0 where some build is no dearer. Surely none saved: never.
    """
    if speedup.verdict not in ("faster", "slower"):
        return None
    if speedup.verdict == "slower":
        return Estimate(math.inf, math.nan, math.nan, speedup.blocks)
    samples, builds = ([function(c) for c in (first, other)] for function in (seconds_per_sample, build_seconds))
    blocks = sorted(samples[0].keys() & samples[1].keys())
    saved = [samples[0][block] - samples[1][block] for block in blocks]
    dearer = [max(builds[1][block] - builds[0][block], 0.0) for block in blocks]
    return geometric_interval([d / s for d, s in zip(dearer, saved, strict=True)]) if min(saved) > 0 else None
