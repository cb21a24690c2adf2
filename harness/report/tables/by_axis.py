"""Ratios along each axis, all else equal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from harness.analysis import Analysis
from harness.analysis.columns import Column, Table, rows_of
from harness.report.tables.evidence import evidence

SPEEDUP = {f"ratio{end}": f"speedup{end}" for end in ("", "_low", "_high")}


def by_axis(analysis: Analysis) -> Table:
    """One row a contestant, axis and measure."""
    table = Table(
        "by_axis",
        "By axis",
        "What a setting, or an option, does: contestants that differ in it alone, each against the one with the first value as "
        "the config writes them; behind these the config's pairs. Geometric mean of paired block ratios with Student's 95 % "
        "interval. The family-wise error rate of an axis and measure, over all scenes, is 5 % (Holm). Where there is no "
        f"speed-up, the last column says why. {evidence(analysis)}",
        [
            Column("axis", "Setting, or option of a shader, sampler or accelerator; of a pair all in which its sides differ."),
            Column("value", "Value of the contestant."),
            Column("over", "Value of the contestant that it is compared with."),
            Column("scene", "Scene that was rendered."),
            Column("settings", "What the two have in common, of what varies."),
            Column("measure", "What is compared: seconds per sample, or warm seconds to a target."),
            Column("speedup", "Time with the value `over` over the time with `value`: above 1 is faster.", "ratio", "speed-up"),
            Column("pairs", "Blocks that both have.", "count"),
            Column("verdict", "faster, slower, same or unresolved; empty where nothing is compared."),
            Column("why", "Why there is no speed-up; empty where there is one.", title="no speed-up"),
        ],
    )
    found = analysis.by_axis.rename(columns=SPEEDUP | {"blocks": "pairs"})
    found["why"] = [why_blank(row) for row in analysis.by_axis.itertuples()]
    table.rows = rows_of(found, table.columns)
    say_why(table, found.why.tolist(), "speedup", "verdict")
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
    return "neither reached the target in all blocks that both have"
