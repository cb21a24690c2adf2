"""Charts drawn by Matplotlib, as files for a paper. They are the same to the byte at every run."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis as Scale
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from harness.report.plots.chart import (
    FAINT,
    GRID,
    INK,
    PAPER,
    WARNING,
    Axis,
    Bars,
    Chart,
    Guide,
    Look,
    Note,
    Picture,
    Plot,
    Series,
    Subplot,
)
from harness.store.atomic import replacing, write_text

STYLE: dict[str, Any] = {
    "svg.hashsalt": "raybench",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "savefig.dpi": 160,
    "axes.titlelocation": "left",
    "axes.formatter.useoffset": False,
    "font.family": ["DejaVu Sans", "sans-serif"],
}
NO_DATES: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": "raybench"},
    "png": {"Software": "raybench"},
    "pdf": {"CreationDate": None, "Creator": "raybench", "Producer": "raybench"},
}


def style() -> AbstractContextManager[None]:
    """The context in which figures are made and saved."""
    return matplotlib.rc_context(cast(Any, STYLE))


def figure(chart: Chart) -> Figure:
    """Draws a chart, inside `style()`."""
    drawn = new_figure(chart.width, chart.height)
    rows = math.ceil(len(chart.subplots) / chart.columns)
    grid = drawn.subplots(
        rows, chart.columns, sharex=cast(Any, chart.shared_x), sharey=cast(Any, chart.shared_y), squeeze=False
    )
    axes = list(grid.ravel())
    for spare in axes[len(chart.subplots) :]:
        spare.set_visible(False)
    for index, (axis, subplot) in enumerate(zip(axes, chart.subplots, strict=False)):
        _draw(axis, subplot)
        if index + chart.columns >= len(chart.subplots):
            axis.set_xlabel(subplot.x.title)
            axis.tick_params(labelbottom=True)
        if index % chart.columns == 0 or subplot.y.title != chart.subplots[index - 1].y.title:
            axis.set_ylabel(subplot.y.title)
    if chart.warning:
        drawn.suptitle(chart.warning, color=WARNING, fontsize=9, weight="bold")
    _legend(drawn, axes[: len(chart.subplots)], chart)
    return drawn


def _draw(axis: Axes, subplot: Subplot) -> None:
    for guide in subplot.guides:
        _guide(axis, guide)
    for content in subplot.content:
        if isinstance(content, Bars):
            _bars(axis, content)
        else:
            _series(axis, content)
    for note in subplot.notes:
        _note(axis, note)
    log_scales(axis, subplot.x.scale == "log", subplot.y.scale == "log")
    _scale(axis, axis.xaxis, subplot.x)
    _scale(axis, axis.yaxis, subplot.y)
    if subplot.title:
        weight = "normal" if subplot.title_colour == INK else "bold"
        axis.set_title(subplot.title, fontsize=9, color=subplot.title_colour, fontweight=weight)


def _scale(axis: Axes, scale: Scale, described: Axis) -> None:
    set_limits = axis.set_xlim if scale is axis.xaxis else axis.set_ylim
    ticks = dict(enumerate(described.names)) or described.ticks
    if ticks is not None:
        scale.set_major_locator(FixedLocator(list(ticks)))
        scale.set_major_formatter(FuncFormatter(lambda value, _: ticks.get(value, "")))
        scale.set_minor_locator(NullLocator())
    if described.names:
        axis.set_ylim(len(described.names) - 0.4, -0.6)
        axis.grid(axis="y", visible=False)
    elif described.low is not None or described.high is not None:
        set_limits(described.low, described.high)


def _series(axis: Axes, series: Series) -> None:
    look: dict[str, Any] = line_style(series.look) | {"alpha": series.opacity if series.opacity < 1 else None}
    look |= {"zorder": 0.5} if series.behind else {}
    look |= {} if series.joined else {"linestyle": "none"}
    if series.step:
        axis.step(series.x, series.y, where="post", markevery=0.15, **look)
        return
    whiskers = {
        name: np.nan_to_num(np.abs(ends.T - values))
        for name, ends, values in (("xerr", series.x_interval, series.x), ("yerr", series.y_interval, series.y))
        if ends is not None and not (series.area and name == "yerr")
    }
    if series.bounds:
        axis.errorbar(series.x, series.y, yerr=0.5 * series.y, uplims=True, elinewidth=0.9, xerr=whiskers.get("xerr"), **look)
    elif whiskers:
        axis.errorbar(series.x, series.y, elinewidth=1, **whiskers, **look)
    else:
        axis.plot(series.x, series.y, **look)
    if series.area and series.y_interval is not None:
        low, high = series.y_interval.T
        axis.fill_between(series.x, low, high, color=series.look.colour, alpha=0.15, linewidth=0)


def _bars(axis: Axes, bars: Bars) -> None:
    rows = range(len(bars.start))
    look = {"color": bars.colour, "hatch": bars.hatch, "edgecolor": "white", "linewidth": 0, "height": 0.72}
    axis.barh(rows, bars.length, left=bars.start, **look)
    for row, ends in enumerate(bars.interval):
        if np.isfinite(ends).all() and ends[1] > ends[0]:
            axis.plot(ends, [row, row], color=INK, linewidth=1.2, solid_capstyle="butt")


def _guide(axis: Axes, guide: Guide) -> None:
    if guide.low is not None:
        axis.axhspan(guide.low, guide.y, color=guide.colour, alpha=0.12, linewidth=0)
        return
    axis.axhline(guide.y, color=guide.colour, linewidth=0.8, linestyle=(0, (2, 2)), zorder=0.5)
    place: Any = {"xycoords": ("axes fraction", "data"), "fontsize": 7, "ha": "right", "va": "bottom"}
    axis.annotate(guide.text, (1.0, guide.y), color=guide.colour, **place)


def _note(axis: Axes, note: Note) -> None:
    if note.x is None:
        place: Any = {"xy": (0.02, note.y), "xycoords": ("axes fraction", "data"), "fontsize": 7}
    else:
        place = {"xy": (note.x, note.y), "xytext": (5, 0), "textcoords": "offset points", "fontsize": 6}
    axis.annotate(note.text, va="center", color=note.colour, **place)


def _legend(drawn: Figure, axes: Sequence[Axes], chart: Chart) -> None:
    if chart.legend == "each":
        for axis, subplot in zip(axes, chart.subplots, strict=True):
            axis.legend(handles=_handles([subplot], False), loc="upper center", bbox_to_anchor=(0.5, -0.18), fontsize=7)
        return
    handles = [_line(entry.look, entry.label) for entry in chart.key] + _handles(chart.subplots, bool(chart.key))
    handles += [_line(entry.look, entry.label) for entry in chart.more]
    if handles and chart.legend == "right":
        drawn.legend(handles=handles, loc="outside right upper")
    elif handles:
        columns = _columns([str(handle.get_label()) for handle in handles], 72 * chart.width)
        drawn.legend(handles=handles, loc="outside lower center", ncols=columns)


def _handles(subplots: Sequence[Subplot], areas_alone: bool) -> list[Artist]:
    """An entry a label of a series, unless there are to be `areas_alone`, and of an area."""
    found: dict[str, Artist] = {}
    for subplot in subplots:
        for content in () if areas_alone else subplot.content:
            if isinstance(content, Bars):
                found[content.label] = Patch(
                    label=content.label, facecolor=content.colour, hatch=content.hatch, edgecolor=PAPER
                )
            elif content.label:
                found.setdefault(content.label, _line(content.look, content.label))
        for guide in subplot.guides:
            if guide.low is not None:
                found[guide.text] = Patch(label=guide.text, color=guide.colour, alpha=0.12, linewidth=0)
    return list(found.values())


def _line(look: Look, label: str) -> Line2D:
    return Line2D([], [], **line_style(look), label=label)


def _columns(labels: Sequence[str], width: float) -> int:
    """How many columns of a legend, at most six, fit into `width` points: letters take some 4.6 of them, a handle 40."""
    for count in range(6, 1, -1):
        rows = math.ceil(len(labels) / count)
        columns = [labels[first : first + rows] for first in range(0, len(labels), rows)]
        if sum(40 + 4.6 * max(map(len, column)) for column in columns) <= width:
            return count
    return 1


def line_style(look: Look) -> dict[str, Any]:
    """A look as the arguments of `Axes.plot`."""
    return {
        "color": look.colour,
        "linestyle": look.line,
        "marker": look.marker,
        "markerfacecolor": look.colour if look.filled else PAPER,
        "markeredgecolor": look.colour,
        "linewidth": look.width,
        "markersize": look.size,
    }


def new_figure(width: float = 7.2, height: float = 4.2) -> Figure:
    """A figure in inches with automatic layout, without pyplot's global state."""
    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, folder: Path, name: str, suffixes: Sequence[str]) -> str:
    """Writes the figure in the formats of `suffixes`, and returns the svg text where svg is one of them, else ''."""
    figure.draw_without_rendering()
    figure.set_layout_engine(None)  # the layout is found; with any engine each format would be drawn twice
    text = ""
    for suffix in suffixes:
        if suffix == "svg":
            text = svg_text(figure)
            write_text(folder / f"{name}.svg", text)
        else:
            with replacing(folder / f"{name}.{suffix}", durable=False) as file:
                figure.savefig(file, format=suffix, metadata=NO_DATES[suffix])
    return text


def picture(plot: Plot) -> Picture:
    """The plot drawn, for pages without scripts."""
    with style():
        return Picture(plot.name, plot.title, plot.description, svg_text(figure(plot.chart)))


def svg_text(figure: Figure) -> str:
    """The figure as SVG, without a background."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=NO_DATES["svg"], transparent=True)
    return buffer.getvalue()


def log_scales(axis: Axes, x: bool = True, y: bool = False) -> None:
    """Logarithmic scales with plain labels such as 0.01, which are set faster than powers and read as easily."""
    for logarithmic, scaled, set_scale in ((x, axis.xaxis, axis.set_xscale), (y, axis.yaxis, axis.set_yscale)):
        if logarithmic:
            set_scale("log")
            scaled.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            scaled.set_minor_formatter(FuncFormatter(partial(_minor_label, scaled)))


def _minor_label(scaled: Scale, value: float, _: int) -> str:
    """2 and 5 of a decade where the axis spans so little that decades alone would leave it nearly bare."""
    low, high = sorted(scaled.get_view_interval())
    few = low > 0 and high < 30 * low
    return f"{value:g}" if few and f"{value:.0e}"[0] in "25" else ""
