"""The section of a report on each axis: a table of ratios with scenes as rows and measures as columns."""

from __future__ import annotations

from typing import Any, NamedTuple

from harness.analysis import Analysis
from harness.analysis.columns import estimate_of
from harness.analysis.model import PER_SAMPLE, measure_of
from harness.report.tables.by_axis import why_blank
from harness.report.tables.model import INFINITE_AND_ZERO, estimate_text


class AxisCell(NamedTuple):
    """A ratio with its interval, its verdict, and in `title` what a reader may ask of it."""

    text: str
    verdict: str
    title: str


class AxisRow(NamedTuple):
    """The ratios on one scene, under the same settings otherwise."""

    scene: str
    settings: str
    cells: list[AxisCell]


class AxisTable(NamedTuple):
    """The ratios along an axis: `groups` are a comparison of two values in words, with its rows."""

    axis: str
    measures: list[str]
    groups: list[tuple[str, list[AxisRow]]]

    @property
    def rows(self) -> int:
        return sum(len(rows) for _, rows in self.groups)


def axis_tables(analysis: Analysis) -> list[AxisTable]:
    """One an axis, in the order of `Analysis.by_axis`."""
    measures = [PER_SAMPLE, *(measure_of(target) for target in analysis.results.targets)]
    found = []
    for axis, of_axis in analysis.by_axis.groupby("axis", sort=False):
        shown = [measure for measure in measures if (of_axis.measure == measure).any()]
        groups = [
            (f"{value} over {over}", _rows(own, shown)) for (value, over), own in of_axis.groupby(["value", "over"], sort=False)
        ]
        found.append(AxisTable(str(axis), shown, groups))
    return found


def _rows(found: Any, measures: list[str]) -> list[AxisRow]:
    rows = []
    for (scene, settings), own in found.groupby(["scene", "settings"], sort=False):
        by_measure = {row.measure: row for row in own.itertuples()}
        rows.append(AxisRow(scene, settings, [_cell(by_measure.get(measure)) for measure in measures]))
    return rows


def _cell(row: Any) -> AxisCell:
    if row is None:
        return AxisCell("–", "", "not measured")
    if why := why_blank(row):
        return AxisCell("–", "", why)
    title = f"{row.contestant} against {row.baseline}: {row.verdict}, from {row.blocks} blocks"
    return AxisCell(estimate_text(estimate_of(row, "ratio"), *INFINITE_AND_ZERO["ratio"]), row.verdict, title)
