"""Accelerators: seconds of the build against the time of a path."""

from __future__ import annotations

import numpy as np

from harness.analysis import Analysis
from harness.analysis.accelerator_tradeoff import build, families
from harness.analysis.scaling import microseconds_a_path
from harness.report.plots.chart import FAINT, Axis, Chart, Look, Series, Subplot, interval
from harness.report.plots.style import MOST_CURVES, Palette, small_multiples
from harness.store.results import Contestant

SHORTEST_BUILD = 1e-3
"""Milliseconds; what is built in less is drawn here."""


def build_against_traverse(analysis: Analysis, palette: Palette) -> Chart | None:
    """A subplot a scene; a line joins what differs in the accelerator alone. None without two accelerators."""
    found = families(analysis.results)
    scenes = list(dict.fromkeys(family[0].settings.scene for family in found))
    if not scenes:
        return None
    everyone = [contestant for family in found for contestant in family]
    key = palette.key(everyone) if len({contestant.name for contestant in everyone}) > MOST_CURVES else ()
    subplots = [
        Subplot(
            Axis("build [ms]"),
            Axis("time of a path [µs]"),
            [s for family in found if family[0].settings.scene == scene for s in _family(family, palette)],
            title=scene,
        )
        for scene in scenes
    ]
    return small_multiples(subplots, 3.4, 3.3, legend="below", key=key, shared_y="none")


def _family(family: list[Contestant], palette: Palette) -> list[Series]:
    builds = np.array([build(contestant)[:3] for contestant in family]) * 1e3
    builds = np.where(np.isnan(builds), builds, np.maximum(builds, SHORTEST_BUILD))
    paths = [microseconds_a_path(contestant) for contestant in family]
    y, ends = np.array([path.value for path in paths]), interval(paths)
    first = palette.look(family[0])
    colour = FAINT if palette.coloured == "accelerator" else first.colour
    line = Series(builds[:, 0], y, Look(colour, first.line, width=first.width / 2), opacity=0.6, behind=True)
    points = [
        Series(
            builds[at, 0],
            y[at],
            palette.look(contestant)._replace(line="none", size=6.5),
            contestant.name,
            contestant.name,
            {"ms to build": builds[at, 0], "µs of a path": y[at]},
            builds[at, 1:],
            ends[at],
        )
        for contestant, at in zip(family, ([row] for row in range(len(family))), strict=True)
    ]
    return [line, *points]
