"""How cost grows: time of a path and of the build over primitives, time of a path over pixels and samples."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.analysis import Analysis
from harness.analysis.scaling import exponent, families, microseconds_a_path, name_of, passes, path_seconds, pixels, primitives
from harness.report.plots.chart import Axis, Chart, Series, Subplot, interval
from harness.report.plots.style import MOST_CURVES, Palette, curve_legend
from harness.statistics import Estimate, geometric_interval
from harness.store.results import Contestant, phase_seconds

PATH, BUILD = "time of a path [µs]", "build [ms]"


def cost_over_primitives(analysis: Analysis, palette: Palette) -> Chart | None:
    """None below three scenes of different sizes that some configuration has in common."""
    found = families(analysis, "scene", primitives)
    if not found:
        return None
    paths, builds = [], []
    for family in found:
        x, times = [primitives(c) for c in family], [microseconds_a_path(c) for c in family]
        last = _last_exponent(family)
        label = name_of(family) if math.isnan(last) else f"{name_of(family)} ({last:.2f})"
        built = [geometric_interval([1e3 * phase_seconds(cell, "build") for cell in c.done]) for c in family]
        scenes = {"scene": [c.settings.scene for c in family], "primitives": x}
        paths.append(_curve(palette, family[0], x, times, label, scenes | {"µs of a path": [t.value for t in times]}))
        builds.append(_curve(palette, family[0], x, built, label, scenes | {"ms to build": [b.value for b in built]}))
    subplots = [Subplot(Axis("primitives"), Axis(words), curves) for words, curves in ((PATH, paths), (BUILD, builds))]
    return _chart(subplots, palette, found, shared_x="all")


def shows_exponents(analysis: Analysis) -> bool:
    """Whether the legend of the cost over primitives has exponents: beyond a few curves there is no entry a curve."""
    found = families(analysis, "scene", primitives)
    return len(found) <= MOST_CURVES and any(not math.isnan(_last_exponent(family)) for family in found)


def _last_exponent(family: list[Contestant]) -> float:
    """The exponent of the time of a path between the two largest scenes."""
    sizes = [primitives(contestant) for contestant in family]
    return exponent({primitives(c): path_seconds(c) for c in family}, sizes[-2:]).value


def cost_over_pixels(analysis: Analysis, palette: Palette) -> Chart | None:
    """None below three sizes of image that some configuration has on one scene."""
    found = families(analysis, "size", lambda contestant: pixels(contestant.done[0]))
    if not found:
        return None
    sizes, samples = [], []
    for family in found:
        first, name = family[0], name_of(family)
        x, times = [pixels(c.done[0]) for c in family], [microseconds_a_path(c) for c in family]
        hover = {"image": [c.settings.size for c in family], "µs of a path": [t.value for t in times]}
        sizes.append(_curve(palette, first, x, times, name, hover))
        measured = _pass_times(family[-1])
        hover = {"samples": list(measured), "µs of a path": [t.value for t in measured.values()]}
        samples.append(_curve(palette, first, list(measured), list(measured.values()), name, hover))
    words = (("pixels", sizes), ("samples per pixel, largest image", samples))
    return _chart([Subplot(Axis(x), Axis(PATH), curves) for x, curves in words], palette, found, shared_x="none")


def _pass_times(contestant: Contestant) -> dict[int, Estimate]:
    """Samples per pixel so far -> microseconds of a path in the pass that ended there."""
    return {spp: geometric_interval([1e6 * s for s in blocks.values()]) for spp, blocks in passes(contestant).items()}


def _curve(palette: Palette, first: Contestant, x: list[int], y: Sequence[Estimate], label: str, hover: dict) -> Series:
    """A curve with intervals."""
    values = np.array([estimate.value for estimate in y])
    return Series(np.array(x, float), values, palette.look(first), label, label, hover, y_interval=interval(y))


def _chart(subplots: list[Subplot], palette: Palette, found: Sequence[list[Contestant]], shared_x: str) -> Chart:
    legend = curve_legend(palette, [family[0] for family in found])
    return Chart(subplots, 8.4, 3.6, 2, shared_x=shared_x, shared_y="none", **legend)
