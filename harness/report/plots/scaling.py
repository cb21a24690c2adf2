"""How cost grows: time of a path and of the build over primitives, time of a path over pixels and samples."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.analysis import Analysis
from harness.analysis.scaling import exponent, families, microseconds_a_path, name_of, passes, path_seconds, pixels, primitives
from harness.report.plots.curves import finish_legend
from harness.report.plots.panels import MOST_CURVES
from harness.report.plots.style import Palette, log_scales, new_figure
from harness.statistics import Estimate, geometric_interval
from harness.store.results import Contestant, phase_seconds


def cost_over_primitives(analysis: Analysis, palette: Palette) -> Figure | None:
    """None below three scenes of different sizes that some configuration has in common."""
    found = families(analysis, "scene", primitives)
    if not found:
        return None
    figure = new_figure(8.4, 3.6)
    paths, builds = figure.subplots(1, 2, sharex=True)
    for family in found:
        x, times = [primitives(c) for c in family], [microseconds_a_path(c) for c in family]
        last = _last_exponent(family)
        label = name_of(family) if math.isnan(last) else f"{name_of(family)} ({last:.2f})"
        _line(paths, palette, family[0], x, times, label)
        built = [geometric_interval([1e3 * phase_seconds(cell, "build") for cell in c.done]) for c in family]
        _line(builds, palette, family[0], x, built, label)
    for axis, words in ((paths, "time of a path [µs]"), (builds, "build [ms]")):
        log_scales(axis, y=True)
        axis.set_xlabel("primitives")
        axis.set_ylabel(words)
    finish_legend(figure, [builds], palette, [family[0] for family in found])
    return figure


def shows_exponents(analysis: Analysis) -> bool:
    """Whether the legend of the cost over primitives has exponents: beyond a few curves there is no entry a curve."""
    found = families(analysis, "scene", primitives)
    return len(found) <= MOST_CURVES and any(not math.isnan(_last_exponent(family)) for family in found)


def _last_exponent(family: list[Contestant]) -> float:
    """The exponent of the time of a path between the two largest scenes."""
    sizes = [primitives(contestant) for contestant in family]
    return exponent({primitives(c): path_seconds(c) for c in family}, sizes[-2:]).value


def cost_over_pixels(analysis: Analysis, palette: Palette) -> Figure | None:
    """None below three sizes of image that some configuration has on one scene."""
    found = families(analysis, "size", lambda contestant: pixels(contestant.done[0]))
    if not found:
        return None
    figure = new_figure(8.4, 3.6)
    sizes, samples = figure.subplots(1, 2)
    for family in found:
        x, times = [pixels(c.done[0]) for c in family], [microseconds_a_path(c) for c in family]
        _line(sizes, palette, family[0], x, times, name_of(family))
        passes = _pass_times(family[-1])
        _line(samples, palette, family[0], list(passes), list(passes.values()), name_of(family))
    for axis, words in ((sizes, "pixels"), (samples, "samples per pixel, largest image")):
        log_scales(axis, y=True)
        axis.set_xlabel(words)
        axis.set_ylabel("time of a path [µs]")
    finish_legend(figure, [samples], palette, [family[0] for family in found])
    return figure


def _pass_times(contestant: Contestant) -> dict[int, Estimate]:
    """Samples per pixel so far -> microseconds of a path in the pass that ended there."""
    return {spp: geometric_interval([1e6 * s for s in blocks.values()]) for spp, blocks in passes(contestant).items()}


def _line(axis: Axes, palette: Palette, first: Contestant, x: list[int], y: list[Estimate], label: str) -> None:
    """A curve with intervals."""
    values = np.array([estimate[:3] for estimate in y])
    whiskers = np.nan_to_num(np.abs(values[:, 1:].T - values[:, 0]))
    axis.errorbar(x, values[:, 0], yerr=whiskers, elinewidth=1, label=label, **palette.look(first).line_style())
