"""What the chapter measures of a contestant beside its speed: errors, times to a quality, builds, and how few pixels hold
the error."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

from harness.analysis import Analysis
from harness.analysis.crossings import READINGS
from harness.metrics import TRIMMED_FRACTION
from harness.report.chapter.families import Family, Measure, estimate, named_contestants
from harness.statistics import Bound, Estimate, Reading, geometric_interval
from harness.statistics.convergence import NOISE_ERRORS
from harness.store.results import Contestant, point_error


def errors_at(analysis: Analysis, spp: int | None) -> Measure:
    """Error at `spp` samples, where it is above three of its standard errors. It repeats."""

    def values(contestant: Contestant) -> Mapping[int, float]:
        errors = {}
        for cell in contestant.done:
            for point in cell.points:
                error, spread = point_error(point, analysis.results.metric)
                if point.spp == spp and error > NOISE_ERRORS * spread:
                    errors[cell.block] = error
        return errors

    return Measure(values, timed=False)


def error_curve(analysis: Analysis, contestant: Contestant) -> dict[int, Estimate]:
    """Samples -> geometric mean over seeds of the error, where every seed has one above 0."""
    errors: dict[int, list[float]] = {}
    for cell in contestant.done:
        for point in cell.points:
            errors.setdefault(point.spp, []).append(point_error(point, analysis.results.metric)[0])
    whole = {spp: found for spp, found in sorted(errors.items()) if len(found) == len(contestant.done)}
    return {spp: geometric_interval(found) for spp, found in whole.items() if min(found) > 0}


def hardest_target(analysis: Analysis, family: Family) -> int | None:
    """Index of the hardest target that every member reaches with every seed, none at its first checkpoint already."""
    for index, target in reversed(list(enumerate(analysis.results.targets))):
        found = [analysis.at(member, target) for member in family.members.values()]
        if all(quality.reached == quality.seeds for quality in found):
            return index if not any(quality.at_first for quality in found) else None
    return None


def times_to(analysis: Analysis, family: Family, index: int) -> Measure:
    """Warm seconds until the target of `index`, which all of a family reach; samplers whose curves are read differently are
    compared by either reading."""

    target = analysis.results.targets[index]

    def own(contestant: Contestant) -> Any:
        return analysis.crossings_of(contestant, target).query("own")

    def values(contestant: Contestant) -> Mapping[int, float]:
        return dict(zip(own(contestant).block, own(contestant).high, strict=True))

    def read(way: Reading) -> Callable[[Contestant], Mapping[int, Bound]]:
        def bounds(contestant: Contestant) -> Mapping[int, Bound]:
            every = analysis.crossings_of(contestant, target)
            found = every[every.reading == way]
            return {row.block: Bound(row.sure_low, row.sure_high) for row in found.itertuples()}

        return bounds

    def kind(contestant: Contestant) -> str:
        return own(contestant).reading.iloc[0]

    return Measure(values, True, kind, [read(way) for way in READINGS])


def build_milliseconds(analysis: Analysis, contestant: Contestant) -> Estimate:
    """Of a build in a process that has built, compiled and rendered the scene before: geometric mean over blocks of the median
    over all contestants with that scene, engine and accelerator, which build the same."""
    of = {key: word for named, one in named_contestants(analysis) if one is contestant for key, word in named.items()}
    alike = [
        one
        for named, one in named_contestants(analysis)
        if all(named[key] == of[key] for key in ("scene", "accelerator", "machine"))
    ]
    builds: dict[int, list[float]] = {}
    for cell in (cell for one in alike for cell in one.done):
        seconds = cell.phases.warm_build_seconds
        if seconds is not None:
            builds.setdefault(cell.block, []).append(seconds)
    return estimate({block: median(found) for block, found in builds.items()}, 1e3)


def errors_untrimmed_and_trimmed(analysis: Analysis, contestant: Contestant, spp: int | None) -> tuple[Estimate, Estimate]:
    """relMSE at `spp` samples, and that without the 0.1 % of pixels where it is largest; without correction, both."""
    name = analysis.results.relative_metric
    points = [point.metrics for cell in contestant.done for point in cell.points if point.spp == spp]
    both = [(found.get(name), found.get(f"{name}_trimmed")) for found in points]
    known = [(whole, trimmed) for whole, trimmed in both if whole is not None and trimmed is not None]
    return geometric_interval([whole for whole, _ in known]), geometric_interval([trimmed for _, trimmed in known])


def share_of_the_worst(whole: float, trimmed: float, count: int) -> float:
    """Share of relMSE that the worst 0.1 % (rounded up) of `count` pixels hold."""
    cut = math.ceil(TRIMMED_FRACTION * count) / count
    return 1 - trimmed * (1 - cut) / whole


def one_a_scene_and_shader(analysis: Analysis) -> list[tuple[dict[str, str], Contestant]]:
    """Of each scene and shader the contestant whose other settings most contestants have, with its words."""
    every = named_contestants(analysis)
    counts = Counter((key, named[key]) for named, _ in every for key in named)
    chosen: dict[tuple[str, str], tuple[dict[str, str], Contestant]] = {}
    for named, one in sorted(every, key=lambda pair: -sum(counts[key, word] for key, word in pair[0].items())):
        chosen.setdefault((named["scene"], named["shader"]), (named, one))
    return [pair for pair in every if any(pair[1] is one for _, one in chosen.values())]
