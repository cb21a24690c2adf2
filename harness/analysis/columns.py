"""Documented columns, and tables of them: as rows of plain values and as DataFrames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import pandas as pd

from harness.statistics import Estimate

DTYPES = {"text": "string", "flag": "boolean", "count": "Int64", "number": "float64", "exact": "float64", "percent": "float64"}
ESTIMATES = ("estimate", "ratio", "break_even")
"""Kinds with an interval."""


class Column(NamedTuple):
    """`name` carries the unit; `meaning` is a sentence; `kind` says how it is stored and printed.

    Kinds: text, flag (true or false), number (3 significant digits), exact (as configured), count, percent (of a share), and
    `estimate`, a number with its interval: in DataFrames and csv it has three columns (`name`, `name_low`, `name_high`), texts
    print `value [low, high]`. A `ratio` is an estimate whose infinity means that the baseline never reached it, a `break_even`
    one whose infinity means that it never pays.
    """

    name: str
    meaning: str
    kind: str = "text"
    title: str = ""

    @property
    def heading(self) -> str:
        return self.title or self.name.replace("_", " ")

    @property
    def fields(self) -> dict[str, str]:
        """The columns that a DataFrame has for it, each with its meaning."""
        if self.kind not in ESTIMATES:
            return {self.name: self.meaning}
        ends = {f"{self.name}_{end}": f"{word} end of the interval of `{self.name}`." for end, word in _ENDS.items()}
        return {self.name: self.meaning, **ends}


_ENDS = {"low": "Lower", "high": "Upper"}


@dataclass
class Table:
    """Rows map column names to values; an estimate's value is an Estimate."""

    name: str
    title: str
    note: str
    columns: list[Column]
    rows: list[dict[str, Any]] = field(default_factory=list)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The rows with the dtypes of `DTYPES`, made once: rows that are put in later are not there. What is not known is `NA`,
        and NaN among numbers."""
        found: dict[str, pd.Series] = {}
        for column in self.columns:
            values = [row.get(column.name) for row in self.rows]
            if column.kind in ESTIMATES:
                for part, name in enumerate(column.fields):
                    found[name] = pd.Series([math.nan if v is None else v[part] for v in values], dtype="float64")
            else:
                found[column.name] = pd.Series(values, dtype=DTYPES[column.kind])
        return pd.DataFrame(found)


def estimate_of(row: Any, name: str) -> Estimate:
    """The estimate that a row of a DataFrame, a named tuple, has in the columns `name`, `name_low` and `name_high`."""
    value, low, high = (getattr(row, f"{name}{end}") for end in ("", "_low", "_high"))
    return Estimate(value, low, high, 0)


def rows_of(frame: pd.DataFrame, columns: Sequence[Column]) -> list[dict[str, Any]]:
    """The rows of a DataFrame as a `Table` has them: estimates put together, None for what is not known."""
    found = frame.astype(object).where(frame.notna(), None).to_dict("records")
    for row in found:
        for column in columns:
            if column.kind in ESTIMATES:
                value, low, high = (math.nan if row[name] is None else row[name] for name in column.fields)
                row[column.name] = Estimate(value, low, high, 0)
    return [{column.name: row[column.name] for column in columns} for row in found]
