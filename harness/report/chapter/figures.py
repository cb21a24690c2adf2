"""Figures of the chapter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.analysis import Analysis, seconds_per_sample
from harness.report.chapter import measures
from harness.report.chapter.document import FigurePart
from harness.report.chapter.families import Family, compare, demanding, estimate, thousands, values
from harness.report.chapter.words import plural
from harness.report.plots.chart import FAINT, INK, LINES, MARKERS, Picture
from harness.report.plots.curves import error_label
from harness.report.plots.figures import log_scales, new_figure, save
from harness.report.plots.style import ENGINE_COLOURS, FORMATS, OTHER_COLOURS
from harness.report.tables import Table
from harness.statistics import Estimate
from harness.store.results import Contestant

COLOURS = (*ENGINE_COLOURS.values(), *OTHER_COLOURS)


def colours(names: Sequence[str]) -> list[str]:
    """A colour for each engine with its accelerator: the engine's own for the first, others for the rest."""
    free, found = list(OTHER_COLOURS), []
    for name in names:
        own = ENGINE_COLOURS.get(name.split()[0], "")
        found.append(own if own and own not in found else free.pop(0) if free else INK)
    return found


def part(drawn: Picture | None) -> list[FigurePart]:
    """A figure as parts of a section: none where there is nothing to draw."""
    return [] if drawn is None else [FigurePart(drawn)]


def finished(figure: Figure, plots: Path, name: str, title: str, description: str) -> Picture:
    """Saves a figure in all formats: the chapter's texts show png, pdf and svg. A name that is taken gets a number."""
    taken = sum(path.stem == name or path.stem.rpartition("-")[0] == name for path in plots.glob(f"{name}*.svg"))
    name = f"{name}-{taken + 1}" if taken else name
    return Picture(name, title, description, save(figure, plots, name, FORMATS))


def _points(axis: Axes, placed: Sequence[tuple[float, Estimate]], index: int, colour: str, label: str) -> None:
    """Values with their intervals along x, each at its y."""
    whiskers = np.nan_to_num([[one.value - one.low, one.high - one.value] for _, one in placed]).T
    axis.errorbar(
        [one.value for _, one in placed],
        [y for y, _ in placed],
        xerr=np.abs(whiskers),
        elinewidth=1,
        fmt=MARKERS[index % len(MARKERS)],
        color=colour,
        markersize=4,
        label=label,
    )


def tails(table: Table, plots: Path) -> Picture:
    """relMSE with and without the worst pixels: a row of the table a row."""
    figure = new_figure(7.2, 1.3 + 0.3 * len(table.rows))
    axis = figure.subplots()
    for index, (key, label) in enumerate((("whole", "all pixels"), ("trimmed", "without the worst 0.1 %"))):
        shift = 0.12 * (2 * index - 1)
        _points(axis, [(y + shift, row[key]) for y, row in enumerate(table.rows)], index, COLOURS[index], label)
    axis.set_yticks(range(len(table.rows)), [f"{row['scene']}, {row['shader']}" for row in table.rows])
    axis.set_ylim(len(table.rows) - 0.5, -0.5)
    axis.set_xlabel(f"relMSE at {table.rows[0]['spp']} samples per pixel")
    log_scales(axis)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return finished(
        figure,
        plots,
        "tails",
        "Error with and without the worst 0.1 % of the pixels",
        "One row per scene and shader: relMSE of all pixels and without the worst, with intervals.",
    )


def speeds(found: Sequence[Family], plots: Path) -> Picture | None:
    """Paths per second of each member; one row per scene."""
    if not found:
        return None
    names = values(found)
    figure = new_figure(7.2, 1.3 + 0.34 * len(found))
    axis, shades = figure.subplots(), colours(names)
    for index, name in enumerate(names):
        shift = 0.13 * (index - (len(names) - 1) / 2)
        rows = [(row + shift, thousands(f.members[name])) for row, f in enumerate(found) if name in f.members]
        _points(axis, rows, index, shades[index], name)
    axis.set_yticks(range(len(found)), [family.scene for family in found])
    axis.set_ylim(len(found) - 0.5, -0.5)
    axis.set_xlabel("thousands of paths per second")
    log_scales(axis)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=min(len(names), 5))
    shader = " and ".join(dict.fromkeys(family.shader for family in found))
    return finished(
        figure,
        plots,
        "accelerators",
        f"Speed by accelerator and scene, {shader}",
        "One row per scene: paths per second by accelerator, with intervals, on a logarithmic axis.",
    )


def frame_times(named: Sequence[tuple[str, Contestant]], plots: Path) -> Picture | None:
    """Milliseconds per frame of contestants with the names of their rows; one marker per number of threads."""
    if not named:
        return None
    rows = list(dict.fromkeys(name for name, _ in named))
    counts = sorted({contestant.settings.threads for _, contestant in named})
    figure = new_figure(7.2, 1.2 + 0.3 * len(rows))
    axis = figure.subplots()
    for index, threads in enumerate(counts):
        shift = 0.16 * (index - (len(counts) - 1) / 2)
        shown = [
            (rows.index(name) + shift, estimate(seconds_per_sample(c), 1e3))
            for name, c in named
            if c.settings.threads == threads
        ]
        _points(axis, shown, index, COLOURS[index % len(COLOURS)], plural(threads, "thread"))
    axis.set_yticks(range(len(rows)), rows)
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.set_xlabel("milliseconds per frame")
    log_scales(axis)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=min(len(counts), 5))
    return finished(
        figure,
        plots,
        "frames",
        "Frame times",
        "One row per engine and accelerator: milliseconds per frame, on a logarithmic axis.",
    )


def thread_gains(analysis: Analysis, found: Sequence[Family], names: Sequence[str], plots: Path) -> Picture | None:
    """Speed-up over the fewest threads with its interval: a row an accelerator and scene, with the shader of most rays."""
    shown = sorted(demanding(found, ("scene", "accelerator")), key=lambda family: family.held["accelerator"])
    figure = new_figure(7.2, 1.3 + 0.24 * len(shown))
    axis = figure.subplots()
    for index, name in enumerate(names[1:]):
        gains = [
            (row, compare(analysis, family, name, names[0]))
            for row, family in enumerate(shown)
            if {names[0], name} <= set(family.members)
        ]
        _points(axis, [(row, Estimate(*gain[:4])) for row, gain in gains], index, COLOURS[index % len(COLOURS)], name)
        axis.axvline(int(name.split()[0]) / int(names[0].split()[0]), color=FAINT, linestyle=":", linewidth=1)
    axis.set_yticks(range(len(shown)), [f"{family.held['accelerator']}, {family.scene}" for family in shown])
    axis.set_ylim(len(shown) - 0.5, -0.5)
    axis.set_xlabel(f"speed-up over {names[0]} (dotted: ideal)")
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=max(len(names) - 1, 1))
    return finished(
        figure,
        plots,
        "threads",
        f"Speed-up over {names[0]}",
        "One row per accelerator and scene: the speed-up with its interval; dotted lines are ideal.",
    )


def sampler_errors(analysis: Analysis, found: Sequence[Family], plots: Path) -> Picture | None:
    """Error over samples, a panel a scene: the shader with most rays."""
    chosen = demanding(found)
    if not chosen:
        return None
    names, columns = values(chosen), min(len(chosen), 3)
    rows = math.ceil(len(chosen) / columns)
    figure = new_figure(7.6, 0.6 + 2.2 * rows)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for spare in grid[len(chosen) :]:
        spare.remove()
    for axis, family in zip(grid, chosen, strict=False):
        for index, name in enumerate(names):
            if name in family.members:
                _error_curve(analysis, axis, family, name, index)
        axis.set_title(family.scene, fontsize=9)
        log_scales(axis, y=True)
    for axis in grid[max(len(chosen) - columns, 0) : len(chosen)]:
        axis.set_xlabel("samples per pixel")
        axis.tick_params(labelbottom=True)
    for axis in grid[: len(chosen) : columns]:
        axis.set_ylabel(error_label(analysis.results.metric))
    handles = {
        label: handle for axis in grid[: len(chosen)] for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=min(len(handles), 6))
    shader = " and ".join(dict.fromkeys(family.shader for family in chosen))
    return finished(
        figure,
        plots,
        "samplers",
        f"Error over samples by sampler, {shader}",
        "One panel per scene: mean error over samples with its interval, one curve per sampler.",
    )


def _error_curve(analysis: Analysis, axis: Axes, family: Family, name: str, index: int) -> None:
    curve = measures.error_curve(analysis, family.members[name])
    look = {"linestyle": LINES[index % len(LINES)], "marker": MARKERS[index % len(MARKERS)], "markersize": 3.5}
    colour, spp = COLOURS[index % len(COLOURS)], list(curve)
    axis.plot(spp, [mean.value for mean in curve.values()], color=colour, label=name, **look)
    low, high = ([mean[end] for mean in curve.values()] for end in (1, 2))
    axis.fill_between(spp, low, high, color=colour, alpha=0.15, linewidth=0)
