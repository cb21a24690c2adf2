"""Figures of the chapter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.analysis import Analysis, seconds_per_sample
from harness.analysis.calibration import plural
from harness.report.chapter import measures
from harness.report.chapter.document import FigurePart
from harness.report.chapter.families import Family, demanding, estimate, speedups, thousands, values
from harness.report.chapter.texts import WORST
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
    free, chosen = list(OTHER_COLOURS), []
    for name in names:
        own = ENGINE_COLOURS.get(name.split()[0], "")
        chosen.append(own if own and own not in chosen else free.pop(0) if free else INK)
    return chosen


def part(drawn: Picture | None) -> list[FigurePart]:
    """A figure as parts of a section: none where there is nothing to draw."""
    return [] if drawn is None else [FigurePart(drawn)]


def finished(figure: Figure, plots: Path, name: str, title: str, description: str) -> Picture:
    """Saves a figure in all formats: the chapter's texts show png, pdf and svg. A name that is taken gets a number."""
    taken = sum(path.stem == name or path.stem.rpartition("-")[0] == name for path in plots.glob(f"{name}*.svg"))
    name = f"{name}-{taken + 1}" if taken else name
    return Picture(name, title, description, save(figure, plots, name, FORMATS))


class Dots(NamedTuple):
    """The values of one label: (row, value with interval) each. `ideal` is where a dotted line stands."""

    label: str
    points: Sequence[tuple[int, Estimate]]
    colour: str = ""
    ideal: float | None = None


def _dot_plot(
    names: Sequence[str], series: Sequence[Dots], title: str, spread: float, size: tuple[float, float], log: bool = True
) -> Figure:
    """A row a name, and in it the values along x, those of different series `spread` rows apart. `size` is the height beside
    the rows and of a row, in inches."""
    figure = new_figure(7.2, size[0] + size[1] * len(names))
    axis = figure.subplots()
    for index, dots in enumerate(series):
        shift = spread * (index - (len(series) - 1) / 2)
        whiskers = np.nan_to_num([[one.value - one.low, one.high - one.value] for _, one in dots.points]).T
        axis.errorbar(
            [one.value for _, one in dots.points],
            [row + shift for row, _ in dots.points],
            xerr=np.abs(whiskers),
            elinewidth=1,
            fmt=MARKERS[index % len(MARKERS)],
            color=dots.colour or COLOURS[index % len(COLOURS)],
            markersize=4,
            label=dots.label,
        )
        if dots.ideal is not None:
            axis.axvline(dots.ideal, color=FAINT, linestyle=":", linewidth=1)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlabel(title)
    if log:
        log_scales(axis)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=min(len(series), 5))
    return figure


def tails(table: Table, plots: Path) -> Picture:
    """relMSE with and without the worst pixels: a row of the table a row."""
    parts = (("whole", "all pixels"), ("trimmed", f"without the worst {WORST}"))
    series = [Dots(label, [(row, values[key]) for row, values in enumerate(table.rows)]) for key, label in parts]
    figure = _dot_plot(
        [f"{row['scene']}, {row['shader']}" for row in table.rows],
        series,
        f"relMSE at {table.rows[0]['spp']} samples per pixel",
        0.24,
        (1.3, 0.3),
    )
    text = "One row per scene and shader: relMSE of all pixels and without the worst, with intervals."
    return finished(figure, plots, "tails", f"Error with and without the worst {WORST} of the pixels", text)


def speeds(shown: Sequence[Family], plots: Path) -> Picture | None:
    """Paths per second of each member; one row per scene."""
    if not shown:
        return None
    names = values(shown)
    series = [
        Dots(name, [(row, thousands(f.members[name])) for row, f in enumerate(shown) if name in f.members], colour)
        for name, colour in zip(names, colours(names), strict=True)
    ]
    figure = _dot_plot([family.scene for family in shown], series, "thousands of paths per second", 0.13, (1.3, 0.34))
    text = "One row per scene: paths per second by accelerator, with intervals, on a logarithmic axis."
    return finished(figure, plots, "accelerators", f"Speed by accelerator and scene, {_shaders(shown)}", text)


def _shaders(shown: Sequence[Family]) -> str:
    return " and ".join(dict.fromkeys(family.shader for family in shown))


def frame_times(named: Sequence[tuple[str, Contestant]], plots: Path) -> Picture | None:
    """Milliseconds per frame of contestants with the names of their rows; one marker per number of threads."""
    if not named:
        return None
    rows = list(dict.fromkeys(name for name, _ in named))
    series = [
        Dots(
            plural(threads, "thread"),
            [(rows.index(name), estimate(seconds_per_sample(c), 1e3)) for name, c in named if c.settings.threads == threads],
        )
        for threads in sorted({contestant.settings.threads for _, contestant in named})
    ]
    figure = _dot_plot(rows, series, "milliseconds per frame", 0.16, (1.2, 0.3))
    text = "One row per engine and accelerator: milliseconds per frame, on a logarithmic axis."
    return finished(figure, plots, "frames", "Frame times", text)


def thread_gains(analysis: Analysis, families: Sequence[Family], names: Sequence[str], plots: Path) -> Picture | None:
    """Speed-up over the fewest threads with its interval: a row an accelerator and scene, with the shader of most rays."""
    shown = sorted(demanding(families, ("scene", "accelerator")), key=lambda family: family.held["accelerator"])
    fewest, *others = names
    gains = [speedups(analysis, family, fewest) for family in shown]
    series = [
        Dots(
            name,
            [(row, gain[name]) for row, gain in enumerate(gains) if name in gain],
            ideal=int(name.split()[0]) / int(fewest.split()[0]),
        )
        for name in others
    ]
    rows = [f"{family.held['accelerator']}, {family.scene}" for family in shown]
    figure = _dot_plot(rows, series, f"speed-up over {fewest} (dotted: ideal)", 0.0, (1.3, 0.24), log=False)
    text = "One row per accelerator and scene: the speed-up with its interval; dotted lines are ideal."
    return finished(figure, plots, "threads", f"Speed-up over {fewest}", text)


def sampler_errors(analysis: Analysis, families: Sequence[Family], plots: Path) -> Picture | None:
    """Error over samples, a panel a scene: the shader with most rays."""
    chosen = demanding(families)
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
    text = "One panel per scene: mean error over samples with its interval, one curve per sampler."
    return finished(figure, plots, "samplers", f"Error over samples by sampler, {_shaders(chosen)}", text)


def _error_curve(analysis: Analysis, axis: Axes, family: Family, name: str, index: int) -> None:
    curve = measures.error_curve(analysis, family.members[name])
    look = {"linestyle": LINES[index % len(LINES)], "marker": MARKERS[index % len(MARKERS)], "markersize": 3.5}
    colour, spp = COLOURS[index % len(COLOURS)], list(curve)
    axis.plot(spp, [mean.value for mean in curve.values()], color=colour, label=name, **look)
    low, high = ([mean[end] for mean in curve.values()] for end in (1, 2))
    axis.fill_between(spp, low, high, color=colour, alpha=0.15, linewidth=0)
