"""What an accelerator costs to build and what it saves: contenders that differ in their accelerator alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from harness.analysis.model import Analysis, seconds_per_sample
from harness.analysis.scaling import microseconds_a_path
from harness.statistics import Estimate, Speedup, median_interval, paired_speedup
from harness.store.results import Contender, Results, phase_seconds


class BreakEven(NamedTuple):
    """An accelerator beside the one of its family that is built fastest, `against` (None for that one itself).

    `break_even_spp`: samples per pixel from which on its build and rendering together take less; inf: never.
    """

    contender: Contender
    against: Contender | None
    build_seconds: Estimate
    path_microseconds: Estimate
    speedup: Speedup | None
    break_even_spp: Estimate | None


def families(results: Results) -> list[list[Contender]]:
    """Measured contenders that differ in the accelerator alone, two or more, the quickest build first."""
    groups: dict[object, list[Contender]] = {}
    for contender in results.contenders:
        if not contender.settings.label and seconds_per_sample(contender):
            groups.setdefault(contender.settings._replace(accelerator=""), []).append(contender)
    return [sorted(group, key=lambda c: build(c).value) for group in groups.values() if len(group) > 1]


def build_seconds(contender: Contender) -> dict[int, float]:
    """Block -> seconds of the build."""
    return {cell["block"]: phase_seconds(cell, "build") for cell in contender.done}


def build(contender: Contender) -> Estimate:
    """Median over seeds of the seconds of the build."""
    return median_interval(list(build_seconds(contender).values()))


def break_evens(analysis: Analysis) -> Iterator[BreakEven]:
    """Every member of every family."""
    for first, *others in families(analysis.results):
        yield BreakEven(first, None, build(first), microseconds_a_path(first), None, None)
        floor = analysis.floors.get(first.settings.scene, 0.0)
        for other in others:
            speedup = paired_speedup(seconds_per_sample(first), seconds_per_sample(other), floor)
            yield BreakEven(other, first, build(other), microseconds_a_path(other), speedup, break_even_spp(first, other))


def break_even_spp(first: Contender, other: Contender) -> Estimate:
    """Median over blocks of (build - build of the first) / (seconds a sample that it saves)."""
    samples, builds = ([function(c) for c in (first, other)] for function in (seconds_per_sample, build_seconds))
    return median_interval([_break_even(builds[1][block] - builds[0][block], samples[0][block] - samples[1][block])
                            for block in sorted(samples[0].keys() & samples[1].keys())])  # fmt: skip


def _break_even(dearer: float, saved: float) -> float:
    if saved <= 0:
        return math.inf
    return max(dearer / saved, 0.0)
