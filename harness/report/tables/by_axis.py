"""Ratios along each axis, all else equal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from harness.analysis import Analysis, frames
from harness.analysis.columns import Table
from harness.report.tables.evidence import evidence


def by_axis(analysis: Analysis) -> Table:
    """One row an axis, contestant and measure."""
    found = frames.by_axis(analysis)
    reasons = [why_blank(row) for row in analysis.by_axis.itertuples()]
    rows = [row | {"no_ratio": reason} for row, reason in zip(found.rows, reasons, strict=True)]
    note = (
        f"{found.note} Geometric mean of paired block ratios with Student's 95 % interval. The family-wise error rate of an "
        "axis and measure, over all scenes, is 5 % (Holm). Where there is no speed-up, the last column says why. "
        f"{evidence(analysis)}"
    )
    columns = [column for column in found.columns if column.name not in ("contestant", "baseline")]
    table = replace(found, note=note, columns=columns, rows=rows)
    say_why(table, reasons, "ratio", "verdict")
    return table


def say_why(table: Table, reasons: Sequence[str], *columns: str) -> None:
    """Keeps with each row why these columns of it show nothing: what a report says where one points at such a cell."""
    for row, reason in zip(table.rows, reasons, strict=True):
        row.setdefault("blank", {}).update(dict.fromkeys(columns, reason))


def why_blank(row: Any) -> str:
    """Why a row of `comparisons` or `by_axis` shows no ratio; empty where it shows one."""
    if row.no_ratio or not math.isnan(row.ratio):
        return row.no_ratio
    if row.blocks == 0:
        return "no block has both"
    return (
        "only bounds are known: of some block that both have each did not reach the target, or was there at its first "
        "checkpoint, or the reference is too noisy"
    )
