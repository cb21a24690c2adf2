"""What a plot shows, as data: subplots with axes, series of values with intervals, and guides.

`figures.figure` draws a chart with Matplotlib, for files; `interactive.plotly` describes it to Plotly, for the report.
Positions along an axis of names (`Axis.names`) are row numbers, from 0 at the top.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

INK, FAINT, GRID, PAPER, WARNING = "#222222", "#777777", "#cccccc", "#ffffff", "#a6192e"
"""Colours of text and lines that belong to no engine; in the report's dark mode others stand for the first four."""
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")


Columns = Mapping[str, Sequence[Any] | np.ndarray]
"""Heading -> n values: what a reader is told of n marks."""


class Look(NamedTuple):
    """How a series is drawn. `line`: one of `LINES`, or "none". `marker`: one of `MARKERS`, "x", or "" for none; hollow where
    not `filled`. `width` of the line and `size` of the marker are in points."""

    colour: str
    line: Any = "-"
    marker: str = ""
    filled: bool = True
    width: float = 1.4
    size: float = 4.5


class Entry(NamedTuple):
    """An entry of a legend that belongs to no series."""

    label: str
    look: Look


@dataclass(frozen=True, eq=False)
class Series:
    """n points at `x` and `y` (n,), `joined` by a line where `look` has one, which may be a staircase (`step`). NaN breaks it.

    `x_interval` and `y_interval` (n, 2) are lower and upper ends, NaN where they are unknown. They are drawn as whiskers;
    with `area` those of y are a shaded area. `bounds`: y is an upper bound. `behind`: other series are drawn over this one.
    `label` stands in the legend. `hover` has what the pointer shows of each point, below `name`; NaN and None are left out.
    A series without `hover` does not answer to the pointer.
    """

    x: np.ndarray
    y: np.ndarray
    look: Look
    name: str = ""
    label: str = ""
    hover: Columns = field(default_factory=dict)
    x_interval: np.ndarray | None = None
    y_interval: np.ndarray | None = None
    area: bool = False
    joined: bool = True
    step: bool = False
    bounds: bool = False
    opacity: float = 1.0
    behind: bool = False


@dataclass(frozen=True, eq=False)
class Bars:
    """n horizontal bars in rows 0 to n - 1, from `start` on, `length` long, with the interval (n, 2) of their end."""

    start: np.ndarray
    length: np.ndarray
    interval: np.ndarray
    colour: str
    hatch: str
    label: str
    hover: Columns


class Axis(NamedTuple):
    """`scale`: linear or log. `low` and `high`: its ends, where they are not left to the data. `ticks`: the only places that
    have a mark -> their text. `names`: the texts of rows 0, 1, ... instead."""

    title: str = ""
    scale: str = "log"
    low: float | None = None
    high: float | None = None
    ticks: Mapping[float, str] | None = None
    names: Sequence[str] = ()


class Guide(NamedTuple):
    """A dashed horizontal line at `y`, or an area from `low` to `y`. The text of a line stands at its right end, that of an
    area in the legend."""

    y: float
    text: str = ""
    low: float | None = None
    colour: str = INK


class Note(NamedTuple):
    """Text at row `y`: beside the value `x`, or without it at the left end."""

    y: float
    text: str
    x: float | None = None
    colour: str = INK


@dataclass(frozen=True, eq=False)
class Subplot:
    x: Axis
    y: Axis
    content: Sequence[Series | Bars]
    title: str = ""
    title_colour: str = INK
    guides: Sequence[Guide] = ()
    notes: Sequence[Note] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Subplots in rows of `columns`; `width` and `height` are inches of the file, of all of them.

    `legend` is "right", "below", or "each": one below each subplot of a file, and below all of them in the report. In a file
    `key` stands in place of the entries of series, and says what looks mean; `more` are entries beside those of series.
    `shared_x` and `shared_y` say which subplots have an axis in common: all, none, those of a col or those of a row. `warning`
    stands above all.
    """

    subplots: Sequence[Subplot]
    width: float
    height: float
    columns: int = 1
    legend: str = "right"
    key: Sequence[Entry] = ()
    more: Sequence[Entry] = ()
    shared_x: str = "all"
    shared_y: str = "all"
    warning: str = ""


class Plot(NamedTuple):
    """A chart of the report: file stem, title, and what a screen reader says of it."""

    name: str
    title: str
    description: str
    chart: Chart


class Picture(NamedTuple):
    """A figure that has been drawn: as `Plot`, and its SVG text."""

    name: str
    title: str
    description: str
    svg: str


def interval(estimates: Sequence[Any]) -> np.ndarray:
    """(n, 2) lower and upper ends of n estimates."""
    return np.array([(estimate.low, estimate.high) for estimate in estimates], float).reshape(-1, 2)
