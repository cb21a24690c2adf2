"""Charts as figures of Plotly (https://plotly.com/javascript/reference/), which the report's plots.js lays out and draws."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from harness.report.plots.chart import (
    FAINT,
    GRID,
    INK,
    LINES,
    MARKERS,
    PAPER,
    WARNING,
    Axis,
    Bars,
    Chart,
    Columns,
    Guide,
    Look,
    Note,
    Series,
    Subplot,
)

DASHES = dict(zip(LINES, ("solid", "dash", "dashdot", "dot", "10px,2px,2px,2px,2px,2px", "2px,2px"), strict=True))
SYMBOLS = (
    "circle",
    "square",
    "triangle-up",
    "diamond",
    "triangle-down",
    "cross",
    "x",
    "star",
    "triangle-left",
    "triangle-right",
)
SYMBOL_OF = {**dict(zip(MARKERS, SYMBOLS, strict=True)), "x": "x-thin"}
HATCHES = {"|||": "|", "xxx": "x", "///": "/", "\\\\\\": "\\", "": ""}
WHISKERS = {"symmetric": False, "thickness": 1.3, "width": 0}
POINT = 4 / 3
"""Pixels."""
INCH = 96
DIGITS = 5
"""Significant digits of what is drawn."""

Json = dict[str, Any]


def plotly(chart: Chart) -> Json:
    """`data` and `layout` of Plotly, and what plots.js arranges by the width of the page: `columns`, `height` of a row in
    pixels, `legend` (right or below), and whether inner subplots repeat the texts of their y axis (`texts`)."""
    data: list[Json] = []
    layout: Json = {"annotations": [], "shapes": [], **_frame(chart)}
    labels: set[str] = set()
    for index, subplot in enumerate(chart.subplots):
        axes = {"xaxis": _reference("x", index), "yaxis": _reference("y", index)}
        layout |= {_key(axes["xaxis"]): _axis(subplot.x), _key(axes["yaxis"]): _axis(subplot.y)}
        _match(layout, chart, index)
        data.append({"x": [None], "y": [None], "showlegend": False, "hoverinfo": "skip", **axes})  # no subplot without a trace
        for content in subplot.content:
            traces = _bars(content) if isinstance(content, Bars) else _series(content, subplot)
            data += [trace | axes | _legend_entry(trace, labels) for trace in traces]
        _add_guides(layout, subplot, axes, labels)
        _add_notes(layout, data, subplot, axes)
    data += [_entry(entry.look, entry.label) for entry in chart.more]
    return {
        "data": data,
        "layout": layout,
        "columns": chart.columns,
        "height": INCH * chart.height / math.ceil(len(chart.subplots) / chart.columns),
        "legend": "right" if chart.legend == "right" or chart.key else "below",
        "texts": chart.shared_y not in ("all", "row"),
    }


def _frame(chart: Chart) -> Json:
    found: Json = {
        "font": {"family": "system-ui, 'DejaVu Sans', sans-serif", "size": 12, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hovermode": "closest",
        "barmode": "overlay",
        "uirevision": True,
        "hoverlabel": {"align": "left"},
    }
    if chart.warning:
        found["title"] = {
            "text": _text(chart.warning),
            "font": {"color": WARNING, "size": 13},
            "x": 0,
            "y": 1,
            "yanchor": "top",
        }
    return found


def _reference(letter: str, index: int) -> str:
    """How traces name an axis: x, x2, x3, ..."""
    return f"{letter}{index + 1}" if index else letter


def _key(axis: str) -> str:
    """How the layout names it: xaxis, xaxis2, ..."""
    return f"{axis[0]}axis{axis[1:]}"


def _axis(axis: Axis) -> Json:
    found: Json = {
        "title": {"text": _text(axis.title), "standoff": 12},
        "type": axis.scale,
        "exponentformat": "none",
        "automargin": True,
        "gridcolor": GRID,
        "linecolor": FAINT,
        "ticks": "outside",
        "tickcolor": FAINT,
        "zeroline": False,
        "showline": True,
    }
    if axis.names:
        rows = list(range(len(axis.names)))
        texts = [_text(name) for name in axis.names]
        return found | {"tickvals": rows, "ticktext": texts, "range": [len(rows) - 0.4, -0.6], "showgrid": False}
    if axis.ticks is not None:
        found |= {"tickvals": list(axis.ticks), "ticktext": [_text(text) for text in axis.ticks.values()]}
    if axis.low is not None or axis.high is not None:
        ends = [end if end is None or axis.scale != "log" else math.log10(end) for end in (axis.low, axis.high)]
        free = {(False, True): "max", (True, False): "min"}.get((ends[0] is None, ends[1] is None), False)
        found |= {"range": ends, "autorange": free}
    return found


def _match(layout: Json, chart: Chart, index: int) -> None:
    """Ties an axis to the first of those that it is shared with."""
    first = {"all": 0, "col": index % chart.columns, "row": index - index % chart.columns, "none": index}
    for letter, shared in (("x", chart.shared_x), ("y", chart.shared_y)):
        if first[shared] != index:
            layout[_key(_reference(letter, index))]["matches"] = _reference(letter, first[shared])


def _series(series: Series, subplot: Subplot) -> Iterable[Json]:
    if not (series.label or len(series.x)):
        return
    look = series.look
    lines = look.line != "none" and series.joined
    modes = [*(["lines"] if lines or not look.marker else []), *(["markers"] if look.marker else [])]
    shared: Json = {"legendgroup": _text(series.name or series.label), "name": _text(series.label or series.name)}
    trace: Json = {
        **shared,
        "x": _numbers(series.x),
        "y": _numbers(series.y),
        "mode": "+".join(modes),
        "showlegend": bool(series.label) and series.joined,
        **_look(look),
        **_hover(series.name, series.hover, look.colour),
    }
    if series.opacity < 1:
        trace["opacity"] = series.opacity
    if series.step:
        trace["line"]["shape"] = "hv"
        trace["marker"]["maxdisplayed"] = 8
    if series.x_interval is not None:
        trace["error_x"] = _whiskers(series.x, series.x_interval, look.colour)
    if series.y_interval is not None and not series.area:
        trace["error_y"] = _whiskers(series.y, series.y_interval, look.colour)
    if series.bounds:
        trace["error_y"] = WHISKERS | {"type": "percent", "value": 0, "valueminus": 50, "color": look.colour}
    if series.area and series.y_interval is not None:
        yield _area(series, subplot.y.low) | shared
    if series.label and not series.joined:
        yield _entry(look, series.label) | shared
    yield trace


def _area(series: Series, lowest: float | None) -> Json:
    """The interval as a polygon, no lower than the axis."""
    ends = np.asarray(series.y_interval, float)
    known = np.isfinite(ends).all(axis=1)
    low, high = ends[known].T
    around = np.concatenate([high, np.maximum(low, -math.inf if lowest is None else lowest)[::-1]])
    red, green, blue = (int(series.look.colour[at : at + 2], 16) for at in (1, 3, 5))
    return {
        "x": _numbers(np.concatenate([series.x[known], series.x[known][::-1]])),
        "y": _numbers(around),
        "mode": "lines",
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": f"rgba({red},{green},{blue},0.15)",
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _bars(bars: Bars) -> Iterable[Json]:
    ends = np.where(bars.interval[:, :1] < bars.interval[:, 1:], bars.interval, math.nan)
    yield {
        "type": "bar",
        "orientation": "h",
        "name": _text(bars.label),
        "legendgroup": _text(bars.label),
        "showlegend": True,
        "base": _numbers(bars.start),
        "x": _numbers(bars.length),
        "y": list(range(len(bars.start))),
        "width": 0.72,
        "marker": {
            "color": bars.colour,
            "pattern": {"shape": HATCHES[bars.hatch], "bgcolor": bars.colour, "fgcolor": PAPER, "size": 6, "solidity": 0.2},
        },
        "error_x": _whiskers(bars.start + bars.length, ends, INK),
        **_hover("", bars.hover, bars.colour),
    }


def _look(look: Look) -> Json:
    symbol = SYMBOL_OF.get(look.marker, "circle")
    stroke = 1.3 * POINT if not look.filled or symbol == "x-thin" else 0
    return {
        "line": {"color": look.colour, "width": _number(POINT * look.width), "dash": DASHES.get(look.line, "solid")},
        "marker": {
            "symbol": symbol,
            "size": _number(POINT * look.size * 1.1),
            "color": look.colour if look.filled else PAPER,
            "line": {"color": look.colour, "width": _number(stroke)},
        },
    }


def _entry(look: Look, label: str) -> Json:
    """A trace without points, for the legend."""
    mode = "+".join(["lines"] * (look.line != "none") + ["markers"] * bool(look.marker))
    name = _text(label)
    shown = {"mode": mode, "name": name, "legendgroup": name, "showlegend": True, "hoverinfo": "skip"}
    return {"x": [None], "y": [None], **shown, **_look(look)}


def _legend_entry(trace: Json, labels: set[str]) -> Json:
    """One entry a label, however many subplots have it."""
    shown = trace["showlegend"] and trace["name"] not in labels
    labels |= {trace["name"]} if shown else set()
    return {"showlegend": shown}


def _whiskers(values: np.ndarray, ends: np.ndarray, colour: str) -> Json:
    lengths = np.nan_to_num(np.abs(ends - np.asarray(values)[:, None]))
    below, above = (_numbers(column) for column in lengths.T)
    return WHISKERS | {"type": "data", "arrayminus": below, "array": above, "color": colour}


def _hover(name: str, columns: Columns, colour: str) -> Json:
    """The text beside the pointer: the name, then a line a column."""
    if not columns:
        return {"hoverinfo": "skip"}
    rows = zip(*columns.values(), strict=True)
    texts = [
        "<br>".join(f"{_text(column)}: {_value(value)}" for column, value in zip(columns, row, strict=True) if _known(value))
        for row in rows
    ]
    head = f"<b>{_text(name)}</b><br>" if name else ""
    return {"hovertext": texts, "hovertemplate": f"{head}%{{hovertext}}<extra></extra>", "hoverlabel": {"bgcolor": colour}}


def _known(value: Any) -> bool:
    return value is not None and not (isinstance(value, float) and math.isnan(value))


def _value(value: Any) -> str:
    if isinstance(value, str):
        return _text(value)
    return f"{int(value)}" if isinstance(value, (int, np.integer)) else f"{value:.4g}"


def _add_guides(layout: Json, subplot: Subplot, axes: Json, labels: set[str]) -> None:
    for guide in subplot.guides:
        place = {"xref": f"{axes['xaxis']} domain", "yref": axes["yaxis"], "x0": 0, "x1": 1, "y1": _number(guide.y)}
        layout["shapes"].append(place | (_line_guide(guide) if guide.low is None else _area_guide(guide, guide.low, labels)))


def _line_guide(guide: Guide) -> Json:
    label = {"text": _text(guide.text), "textposition": "end", "yanchor": "bottom", "font": {"size": 10, "color": guide.colour}}
    line = {"color": guide.colour, "width": 1, "dash": "3px,3px"}
    return {"type": "line", "y0": _number(guide.y), "line": line, "layer": "above", **({"label": label} if guide.text else {})}


def _area_guide(guide: Guide, low: float, labels: set[str]) -> Json:
    entry = {"name": _text(guide.text), "showlegend": True}
    look = {"type": "rect", "fillcolor": guide.colour, "opacity": 0.15, "line": {"width": 0}, "layer": "below"}
    return {"y0": _number(low), **look, **entry, **_legend_entry(entry, labels)}


def _add_notes(layout: Json, data: list[Json], subplot: Subplot, axes: Json) -> None:
    """Texts at a value are a trace, so that they follow a logarithmic axis; others, and the title, are annotations."""
    valued = [note for note in subplot.notes if note.x is not None]
    if valued:
        data.append(
            {
                "x": [_number(note.x) for note in valued if note.x is not None],
                "y": [note.y for note in valued],
                "text": [_text(f" {note.text}") for note in valued],
                "mode": "text",
                "textposition": "middle right",
                "textfont": {"size": 10},
                "showlegend": False,
                "hoverinfo": "skip",
                **axes,
            }
        )
    common = {"xref": f"{axes['xaxis']} domain", "xanchor": "left", "showarrow": False}
    layout["annotations"] += [_note(note, axes["yaxis"]) | common for note in subplot.notes if note.x is None]
    if subplot.title:
        bold = subplot.title_colour != INK
        text = f"<b>{_text(subplot.title)}</b>" if bold else _text(subplot.title)
        place = {"x": 0, "y": 1, "yref": f"{axes['yaxis']} domain", "yanchor": "bottom"}
        layout["annotations"].append({"text": text, "font": {"color": subplot.title_colour, "size": 13}, **place, **common})


def _note(note: Note, axis: str) -> Json:
    return {"text": _text(note.text), "x": 0.02, "y": note.y, "yref": axis, "font": {"size": 10, "color": note.colour}}


def _numbers(values: Iterable[float]) -> list[float | None]:
    return [_number(value) for value in values]


def _number(value: float) -> float | None:
    """To `DIGITS` significant digits; None for what is not finite, which JSON has no number for."""
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def _text(text: str) -> str:
    """Plain text for Plotly, which reads some tags."""
    return html.escape(text, quote=False)
