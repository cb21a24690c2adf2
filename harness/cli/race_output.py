"""What `raybench race` shows: a line a contestant while it runs, and the answer at its end."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from harness.analysis import Analysis
from harness.analysis.columns import estimate_of
from harness.metrics import as_error
from harness.plan.cells import Cell, Plan
from harness.report import answer_text
from harness.report.plots.panels import panels
from harness.report.tables.by_axis import why_blank
from harness.report.tables.model import estimate_text, number_text
from harness.report.winners import standing
from harness.run.progress import Terminal
from harness.settings import CellSettings
from harness.store import records

BAR_WIDTH = 24


class RaceTerminal(Terminal):
    """On a terminal a line a contestant: repeats done, samples, error, seconds, and a bar from its first error to the smallest
    target, in equal steps of the logarithm. Elsewhere the lines of any run."""

    def __init__(self, console: Console, plan: Plan) -> None:
        super().__init__(console, plan)
        quality = plan.experiment.quality
        self._target = min((as_error(quality.metric, each) for each in quality.targets or ()), default=math.nan)
        self._repeats = plan.experiment.repeats
        self._names = _names([cell for cell in plan.cells if not cell.skip])
        self._lines = Progress(
            TextColumn("{task.description}", markup=False),
            TextColumn("{task.fields[repeats]}", markup=False),
            BarColumn(BAR_WIDTH),
            TextColumn("{task.fields[spp]:>7} spp  error {task.fields[error]:>8}  {task.fields[seconds]:>9}", markup=False),
            console=console,
            auto_refresh=False,
            transient=True,
            disable=not console.is_terminal,
        )
        self._tasks = {
            name: self._lines.add_task(name, total=1.0, repeats=f"0/{self._repeats}", spp="", error="", seconds="")
            for name in dict.fromkeys(self._names.values())
        }
        self._finished = dict.fromkeys(self._tasks, 0)
        self._now: Cell | None = None
        self._first = math.nan

    def __exit__(self, *arguments: object) -> None:
        self._lines.stop()
        super().__exit__(*arguments)

    def cell(self, cell: Cell, number: int, total: int, seconds_left: float) -> None:
        if not self.console.is_terminal:
            super().cell(cell, number, total, seconds_left)
            return
        self._number, self._total = number, total
        if self._now is None:  # the references' bar has had its time
            self._bar.stop()
            self._lines.start()
        self._now, self._first = cell, math.nan

    def point(self, spp: int, seconds: float, error: float) -> None:
        if self._now is None:
            super().point(spp, seconds, error)
            return
        if math.isnan(self._first):
            self._first = error
        share = _share(self._first, error, self._target)
        shown: Any = {"spp": f"{spp}", "error": f"{error:.2g}", "seconds": f"{seconds:.2f} s"}
        self._lines.update(self._tasks[self._names[self._now.cell_id]], completed=share, **shown)
        self._lines.refresh()

    def finished(self, cell: Cell, event: records.AnyCell) -> None:
        name = self._names.get(cell.cell_id)
        if self._now is not None and name is not None:
            self._finished[name] += 1
            self._lines.update(self._tasks[name], repeats=f"{self._finished[name]}/{self._repeats}")
            self._lines.refresh()
        super().finished(cell, event)


def _share(first: float, error: float, target: float) -> float:
    """How far an error is on the way from the first one to the target, in [0, 1]."""
    if not (0 < error < first and 0 < target < first):
        return 1.0 if error <= target else 0.0
    return min(1.0, math.log(first / error) / math.log(first / target))


def _names(cells: list[Cell]) -> Mapping[str, str]:
    """Cell id -> its contestant, by the settings in which contestants differ."""

    def parts(cell: Cell) -> tuple[str, ...]:
        settings = cell.settings
        more = (str(settings.shader), str(settings.sampler)) if isinstance(settings, CellSettings) else ("", "")
        accelerator = str(settings.accelerator)
        threads = f"{settings.threads} threads"
        return (cell.scene.name, cell.engine_name, *more, accelerator, settings.precision or "", threads, cell.label or "")

    rows = {cell.cell_id: parts(cell) for cell in cells}
    varying = [len(values) > 1 for values in map(set, zip(*rows.values(), strict=True))]
    return {
        cell_id: " ".join(part for place, part in enumerate(row) if part and (place == 1 or varying[place]))
        for cell_id, row in rows.items()
    }


def print_answer(console: Console, analysis: Analysis) -> None:
    """A table for each race: seconds to the targets and ratios, with their intervals; then who is the fastest, in words."""
    columns = ("target", "contestant", "reached", "seconds", "times as fast", "as", "verdict")
    for panel in panels(analysis):
        table = Table(*columns, title=escape(panel.title), title_justify="left", box=None, header_style="bold")
        for target in analysis.results.targets:
            found = standing(analysis, panel, target)
            repeats = {each.contestant.name: len(each.contestant.done) for each in panel.verdicts}
            for row in sorted(found.rows, key=lambda row: (not row.reached, row.seconds)):
                ratio = estimate_text(estimate_of(row, "ratio")) if math.isfinite(row.ratio) else ""
                cells = (
                    number_text(target),
                    escape(row.contestant),
                    f"{row.reached}/{repeats[row.contestant]}",
                    estimate_text(estimate_of(row, "seconds")) if row.reached else "",
                    ratio,
                    escape(row.baseline) if ratio else escape(why_blank(row).partition(":")[0]),
                    row.verdict,
                )
                table.add_row(*cells, style="bold" if row.possible_winner else None)
        console.print(table)
    console.print(answer_text(analysis), end="", markup=False, soft_wrap=not console.is_terminal)
