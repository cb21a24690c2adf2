"""Plots and tables of one's own: functions of a DataFrame, found by the names that engines are found by.

`plot(points) -> Figure` and `table(cells) -> DataFrame` are named `module:function`, or registered under the entry points
`raybench.plots` and `raybench.tables`. The name of the only parameter says which DataFrame it gets: one of `FRAMES`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from pandas.api import types

from engines.errors import ConfigError, UnknownName
from engines.registry import load_attribute
from harness.analysis import Analysis, frames
from harness.analysis.columns import Column, Table, rows_of
from harness.report.plots.chart import Picture
from harness.report.plots.style import file_stem, formats

GROUPS = {"plot": "raybench.plots", "table": "raybench.tables"}
FRAMES: dict[str, Callable[[Analysis], Table]] = {
    "points": lambda analysis: analysis.points,
    "cells": lambda analysis: analysis.cells,
    "times_to_quality": frames.times_to_quality,
    "verdicts": frames.verdicts,
    "by_axis": frames.by_axis,
}
PREFIX = "own-"
"""How the files begin."""


class Plugin(NamedTuple):
    """A function of a DataFrame. `kind`: plot or table; `frame`: a key of `FRAMES`."""

    kind: str
    name: str
    frame: str
    function: Callable[[pd.DataFrame], Any]

    @property
    def stem(self) -> str:
        """The name of its files, without a suffix."""
        return PREFIX + file_stem(self.name.rpartition(":")[2])

    @property
    def title(self) -> str:
        return self.name.rpartition(":")[2].replace("_", " ")

    @property
    def description(self) -> str:
        """The first line of its docstring."""
        words = inspect.getdoc(self.function) or f"Made by {self.name} from the DataFrame {self.frame}."
        return words.splitlines()[0]


@dataclass
class Made:
    """What plugins made of a results folder; `problems` has a line for each that failed."""

    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def plugin(kind: str, name: str) -> Plugin:
    """The plot or table of a name.

    Raises `UnknownName` for a name that nobody has registered, `ConfigError` where what is there cannot be imported, or is
    no function of one DataFrame.
    """
    found = load_attribute(name) if ":" in name else _registered(kind, name)
    try:
        parameters = list(inspect.signature(found).parameters)
    except (TypeError, ValueError):
        raise ConfigError(f"{kind} {name!r}: {found!r} is no function") from None
    if len(parameters) != 1 or parameters[0] not in FRAMES:
        given = f"({', '.join(parameters)})"
        raise ConfigError(f"{kind} {name!r}: its parameters are {given}: expected one, named {', '.join(FRAMES)}")
    return Plugin(kind, name, parameters[0], found)


def _registered(kind: str, name: str) -> Any:
    known = {point.name: point for point in entry_points(group=GROUPS[kind])}
    if name not in known:
        raise UnknownName(kind, name, known)
    try:
        return known[name].load()
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{kind} {name!r} ({known[name].value}): cannot be loaded: {' '.join(str(error).split())}") from error


def make(plugins: Iterable[Plugin], analysis: Analysis, folder: Path) -> Made:
    """Calls each with its DataFrame; writes figures into `folder`/plots and tables into `folder`/tables, where those of
    earlier plugins are removed first. What a plugin raises, and a result that is no figure or DataFrame, becomes a problem."""
    made = Made()
    taken: set[tuple[str, str]] = set()
    for old in (folder / "tables").glob(f"{PREFIX}*"):
        old.unlink()
    for each in plugins:
        source = FRAMES[each.frame](analysis)
        try:
            if (each.kind, each.stem) in taken:
                raise ConfigError(f"another {each.kind} is called {each.stem}")
            taken.add((each.kind, each.stem))
            if each.kind == "plot":
                made.pictures.append(_picture(each, source.frame.copy(), folder / "plots"))
            else:
                made.tables.append(_table(each, source, folder / "tables"))
        except (Exception, SystemExit) as error:
            first = (str(error).splitlines() or [""])[0]
            made.problems.append(f"{each.kind} {each.name!r} is left out: {type(error).__name__}: {first}")
    return made


def _picture(plugin: Plugin, frame: pd.DataFrame, folder: Path) -> Picture:
    from matplotlib.figure import Figure

    from harness.report.plots.figures import save, style, svg_text

    with style():
        figure = plugin.function(frame)
        if not isinstance(figure, Figure):
            raise TypeError(f"expected a Matplotlib figure, found {type(figure).__name__}")
        text = save(figure, folder, plugin.stem, formats()) or svg_text(figure)
    return Picture(plugin.stem, plugin.title, plugin.description, text)


def _table(plugin: Plugin, source: Table, folder: Path) -> Table:
    from harness.report.tables import write_table

    found = plugin.function(source.frame.copy())
    if not isinstance(found, pd.DataFrame):
        raise TypeError(f"expected a DataFrame, found {type(found).__name__}")
    named = [name for name in found.index.names if name is not None]
    found = found.reset_index() if named else found.reset_index(drop=True)
    found.columns = [_heading(name) for name in found.columns]
    meanings = {name: meaning for column in source.columns for name, meaning in column.fields.items()}
    columns = [Column(name, meanings.get(name, ""), _kind(found[name])) for name in found.columns]
    table = Table(plugin.stem, plugin.title, plugin.description, columns, rows_of(found, columns))
    write_table(table, folder)
    return table


def _heading(name: Any) -> str:
    """The name of a column; those of several levels are joined."""
    return " ".join(str(part) for part in name if str(part)) if isinstance(name, tuple) else str(name)


def _kind(values: Any) -> str:
    """The kind of the `Column` that a column of a DataFrame becomes."""
    if types.is_bool_dtype(values):
        return "flag"
    if types.is_integer_dtype(values):
        return "count"
    return "number" if types.is_numeric_dtype(values) else "text"
