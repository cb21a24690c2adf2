"""Accelerators: seconds of the build against the time of a path."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from harness.analysis import Analysis
from harness.analysis.accelerator_tradeoff import build, families
from harness.analysis.scaling import microseconds_a_path
from harness.report.plots.panels import MOST_CURVES
from harness.report.plots.style import Palette, log_scales, small_multiples

SHORTEST_BUILD = 1e-3
"""Milliseconds; what is built in less is drawn here."""


def build_against_traverse(analysis: Analysis, palette: Palette) -> Figure | None:
    """A subplot a scene; a line joins what differs in the accelerator alone. None without two accelerators."""
    found = families(analysis.results)
    scenes = list(dict.fromkeys(family[0].settings.scene for family in found))
    if not scenes:
        return None
    figure, grid = small_multiples(len(scenes), 3.4, 3.3, sharey=False)
    for axis, scene in zip(grid, scenes, strict=True):
        for family in found:
            if family[0].settings.scene != scene:
                continue
            x = np.array([build(contestant)[:3] for contestant in family]) * 1e3
            y = np.array([microseconds_a_path(contestant)[:3] for contestant in family])
            x = np.where(np.isnan(x), x, np.maximum(x, SHORTEST_BUILD))
            first = palette.look(family[0])
            axis.plot(x[:, 0], y[:, 0], color=first.colour, linestyle=first.line, linewidth=first.width / 2, alpha=0.6)
            for contestant, across, up in zip(family, x, y, strict=True):
                look = palette.look(contestant).line_style() | {"linestyle": "none", "markersize": 6.5}
                axis.errorbar(
                    across[0], up[0], xerr=_whisker(across), yerr=_whisker(up), elinewidth=0.8, label=contestant.name, **look
                )
        log_scales(axis, y=True)
        axis.set_title(scene, fontsize=9)
        axis.set_xlabel("build [ms]")
    for axis in grid[::3]:
        axis.set_ylabel("time of a path [µs]")
    named = {label: handle for axis in grid for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    if len(named) <= MOST_CURVES:
        figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=3)
    else:
        handles = palette.key([contestant for family in found for contestant in family])
        figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _whisker(estimate: np.ndarray) -> np.ndarray:
    """(2, 1) lengths below and above the value, 0 where there is no interval."""
    return np.nan_to_num(np.abs(estimate[1:, None] - estimate[0]))
