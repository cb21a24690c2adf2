"""How cost grows: time of a path and of the build over primitives, time of a path over pixels and samples."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.analysis import Analysis, seconds_per_sample
from harness.plots.curves import finish_legend
from harness.plots.style import Palette, log_scales, new_figure
from harness.results import Contender, Event, phase_seconds
from harness.statistics import Estimate, median_interval

FEWEST = 3
"""Sizes from which on a growth is drawn."""


def primitives(contender: Contender) -> int:
    return int(contender.cells[0].get("primitives") or 0)


def pixels(cell: Event) -> int:
    return int(cell["width"]) * int(cell["height"])


def microseconds_a_path(contender: Contender) -> Estimate:
    """Median over seeds of the warm time of a path (a sample of a pixel)."""
    return median_interval([1e6 * s / pixels(contender.done[0]) for s in seconds_per_sample(contender).values()])


def cost_over_primitives(analysis: Analysis, palette: Palette) -> Figure | None:
    """None below three scenes of different sizes that some configuration has in common."""
    families = _families(analysis, "scene", primitives)
    if not families:
        return None
    figure = new_figure(8.4, 3.6)
    paths, builds = figure.subplots(1, 2, sharex=True)
    for family in families:
        x, times = [primitives(c) for c in family], [microseconds_a_path(c) for c in family]
        label = f"{name_of(family)} ({exponent(x, times):.2f})"
        _line(paths, palette, family[0], x, times, label)
        built = [median_interval([1e3 * phase_seconds(cell, "build") for cell in c.done]) for c in family]
        _line(builds, palette, family[0], x, built, label)
    for axis, words in ((paths, "time of a path [µs]"), (builds, "build [ms]")):
        log_scales(axis, y=True)
        axis.set_xlabel("primitives")
        axis.set_ylabel(words)
    finish_legend(figure, [builds], palette, [family[0] for family in families])
    return figure


def cost_over_pixels(analysis: Analysis, palette: Palette) -> Figure | None:
    """None below three sizes of image that some configuration has on one scene."""
    families = _families(analysis, "size", lambda contender: pixels(contender.done[0]))
    if not families:
        return None
    figure = new_figure(8.4, 3.6)
    sizes, samples = figure.subplots(1, 2)
    for family in families:
        x, times = [pixels(c.done[0]) for c in family], [microseconds_a_path(c) for c in family]
        _line(sizes, palette, family[0], x, times, name_of(family))
        passes = _passes(family[-1])
        _line(samples, palette, family[0], list(passes), list(passes.values()), name_of(family))
    for axis, words in ((sizes, "pixels"), (samples, "samples a pixel, largest image")):
        log_scales(axis, y=True)
        axis.set_xlabel(words)
        axis.set_ylabel("time of a path [µs]")
    finish_legend(figure, [samples], palette, [family[0] for family in families])
    return figure


def _passes(contender: Contender) -> dict[int, Estimate]:
    """Samples a pixel so far -> time of a path in the pass that ended there."""
    found: dict[int, list[float]] = {}
    for cell in contender.done:
        before = (0, 0.0)
        for point in cell["points"]:
            spp, seconds = point["spp"] - before[0], point["seconds"] - before[1]
            found.setdefault(point["spp"], []).append(1e6 * seconds / (spp * pixels(cell)))
            before = point["spp"], point["seconds"]
    return {spp: median_interval(values) for spp, values in sorted(found.items())}


def _families(analysis: Analysis, axis: str, size: Callable[[Contender], int]) -> list[list[Contender]]:
    """Contenders that differ in one setting alone, three or more different sizes, the smallest first."""
    groups: dict[object, list[Contender]] = {}
    for verdict in analysis.verdicts:
        contender = verdict.contender
        if not contender.settings.label and seconds_per_sample(contender) and size(contender):
            groups.setdefault(contender.settings._replace(**{axis: ""}), []).append(contender)
    ordered = [sorted(group, key=size) for group in groups.values()]
    return [group for group in ordered if len({size(contender) for contender in group}) >= FEWEST]


def name_of(family: list[Contender]) -> str:
    """The name that the family's members share."""
    first = family[0]
    return " ".join(word for word in first.name.split() if word != first.settings.size)


def exponent(x: list[int], y: list[Estimate]) -> float:
    """d log y / d log x between the two largest."""
    return math.log(y[-1].value / y[-2].value) / math.log(x[-1] / x[-2])


def _line(axis: Axes, palette: Palette, first: Contender, x: list[int], y: list[Estimate], label: str) -> None:
    """A curve with intervals."""
    values = np.array([estimate[:3] for estimate in y])
    whiskers = np.nan_to_num(np.abs(values[:, 1:].T - values[:, 0]))
    axis.errorbar(x, values[:, 0], yerr=whiskers, elinewidth=1, label=label, **palette.look(first).line_style())
