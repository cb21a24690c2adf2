"""Time-to-quality with intervals, phases, and speed-up over threads."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from harness.analysis import Analysis, Verdict, seconds_per_sample
from harness.analysis.scaling import thread_families
from harness.report.plots.panels import MOST_CURVES, Panel
from harness.report.plots.style import FAINT, GRID, INK, Palette, log_scales, new_figure, small_multiples
from harness.statistics import Estimate, amdahl_fit, parallel_speedups
from harness.statistics.ratios import FEWEST_BLOCKS
from harness.store.results import PHASES

PHASE_COLOURS = {"import": "#999999", "load": "#f0e442", "build": "#e69f00", "compile": "#cc79a7", "render": "#0072b2"}
PHASE_HATCHES = {"import": "|||", "load": "xxx", "build": "///", "compile": "\\\\\\", "render": ""}


def quality_bars(analysis: Analysis, panel: Panel, palette: Palette) -> Figure | None:
    """A panel for each target, two in a row; warm times are full dots, cold times hollow ones, whiskers 95 % intervals."""
    targets = analysis.results.targets
    if not targets:
        return None
    rows, columns = len(panel.verdicts), min(len(targets), 2)
    lines = math.ceil(len(targets) / columns)
    figure = new_figure(7.4, 0.7 + (0.8 + 0.24 * rows) * lines)
    axes = figure.subplots(lines, columns, sharey=True, sharex=True, squeeze=False).ravel()
    for axis in axes[len(targets) :]:
        axis.set_visible(False)
    for index, (axis, target) in enumerate(zip(axes, targets, strict=False)):
        for row, verdict in enumerate(panel.verdicts):
            _quality_row(axis, row, verdict, index, palette)
        log_scales(axis)
        axis.set_title(f"until {target:g}", fontsize=9)
        if index >= len(targets) - columns:
            axis.set_xlabel("time [s]")
            axis.tick_params(labelbottom=True)
        axis.grid(axis="y", visible=False)
    axes[0].set_yticks(range(rows), [verdict.contestant.name for verdict in panel.verdicts])
    axes[0].set_ylim(rows - 0.4, -0.6)
    for filled, words in ((True, "warm: rendering alone"), (False, "cold: with import, load, build, compilation")):
        axes[0].plot([], [], "o", color=INK, markerfacecolor=INK if filled else "white", label=words, linestyle="none")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _quality_row(axis: Axes, row: int, verdict: Verdict, index: int, palette: Palette) -> None:
    """Means with whiskers; below three blocks a dot a block, for there an interval says nothing."""
    colour = palette.colour(verdict.contestant.settings.engine)
    warm, cold = verdict.warm[index], verdict.cold[index]
    if not math.isfinite(warm.value):
        axis.annotate(
            f"{warm.reached}/{warm.seeds} reached",
            (0.02, row),
            xycoords=("axes fraction", "data"),
            fontsize=7,
            va="center",
            color=FAINT,
        )
        return
    axis.plot([warm.value, cold.value], [row, row], color=GRID, linewidth=3, zorder=1)
    for quality, filled in ((cold, False), (warm, True)):
        dots = [bound.high for bound in quality.crossings] if quality.seeds < FEWEST_BLOCKS else [quality.value]
        axis.plot(dots, [row] * len(dots), "o", color=colour, markerfacecolor=colour if filled else "white", zorder=3)
        if quality.seeds >= FEWEST_BLOCKS and not warm.at_first:
            axis.plot([quality.low, quality.high], [row, row], color=colour, linewidth=1.2, zorder=2, solid_capstyle="butt")
    if warm.at_first:
        axis.annotate(
            f"< ({warm.verdict()})",
            (cold.value, row),
            xytext=(5, 0),
            fontsize=6,
            textcoords="offset points",
            va="center",
            color=INK,
        )


def phase_bars(panel: Panel) -> Figure:
    """Stacked mean seconds of a whole cell; a whisker at the end of each phase is its own interval."""
    rows = len(panel.verdicts)
    figure = new_figure(7.2, 1.4 + 0.24 * rows)
    axis = figure.subplots()
    left = np.zeros(rows)
    for phase in PHASES:
        seconds = np.nan_to_num([verdict.phases[phase].value for verdict in panel.verdicts])
        axis.barh(
            range(rows),
            seconds,
            left=left,
            color=PHASE_COLOURS[phase],
            hatch=PHASE_HATCHES[phase],
            label=phase,
            edgecolor="white",
            linewidth=0,
            height=0.72,
        )
        _phase_whiskers(axis, [verdict.phases[phase] for verdict in panel.verdicts], left)
        left += seconds
    axis.set_yticks(range(rows), [verdict.contestant.name for verdict in panel.verdicts])
    axis.set_ylim(rows - 0.4, -0.6)
    axis.set_xlabel("geometric mean time [s]")
    axis.grid(axis="y", visible=False)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=len(PHASES))
    return figure


def _phase_whiskers(axis: Axes, estimates: Sequence[Estimate], left: np.ndarray) -> None:
    """Intervals of bars that start at `left`, where they are known."""
    for row, (estimate, start) in enumerate(zip(estimates, left.tolist(), strict=True)):
        if math.isfinite(estimate.low) and math.isfinite(estimate.high) and estimate.high > estimate.low:
            ends = [start + estimate.low, start + estimate.high]
            axis.plot(ends, [row, row], color=INK, linewidth=1.2, solid_capstyle="butt")


def thread_speedups(analysis: Analysis, palette: Palette) -> Figure | None:
    """Speed-up over threads with intervals, the ideal, and Amdahl's law as fitted; a subplot a scene."""
    families = thread_families(analysis.results)
    scenes = list(dict.fromkeys(family[0].settings.scene for family in families))
    if not scenes:
        return None
    most = max(sum(family[0].settings.scene == scene for family in families) for scene in scenes)
    many = most > MOST_CURVES
    height = 3.0 + (0.5 if many else 0.11 * most)
    figure, grid = small_multiples(len(scenes), 3.4, height)
    counts = sorted({contestant.settings.threads for family in families for contestant in family})
    for axis, scene in zip(grid, scenes, strict=True):
        axis.plot(counts, np.array(counts) / counts[0], color=FAINT, linewidth=0.8, linestyle=":", label="ideal")
        for family in families:
            if family[0].settings.scene == scene:
                _speedup_curve(axis, family, palette)
        axis.set_title(scene, fontsize=9)
        axis.set_xlabel("threads")
        axis.xaxis.set_major_locator(FixedLocator(counts))
        if not many:
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), fontsize=7)
    grid[0].set_ylabel("speed-up")
    if many:
        figure.legend(handles=palette.key([family[0] for family in families]), loc="outside lower center", ncols=6)
    return figure


def _speedup_curve(axis: Axes, family: list, palette: Palette) -> None:
    seconds = {contestant.settings.threads: seconds_per_sample(contestant) for contestant in family}
    rows = parallel_speedups(seconds)
    fit = amdahl_fit(seconds)
    look = palette.look(family[0])
    name = family[0].name.replace(f" {family[0].settings.threads} thread", "").removesuffix("s")
    serial = "" if math.isnan(fit.value) else f" (serial {100 * fit.value:.1f} %)"
    values = np.array([row.speedup[:3] for row in rows])
    whiskers = np.nan_to_num(np.abs(values[:, 1:].T - values[:, 0]))
    axis.errorbar(
        [row.threads for row in rows],
        values[:, 0],
        yerr=whiskers,
        color=look.colour,
        linestyle=look.line,
        marker=look.marker,
        elinewidth=1,
        capsize=2,
        label=name + serial,
    )
