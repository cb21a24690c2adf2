"""What is left to do: whether an event still answers its cell, and how long cells may take."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from harness.plan.cells import Cell
from harness.settings import CellSettings
from harness.store import records

OVERHEAD_SECONDS, SCORE_SECONDS = 1.0, 1.5e-6
"""What a cell costs beside its rendering, and what scoring costs a pixel and checkpoint: the medians of `results/baseline`."""


def up_to_date(cell: Cell, event: records.AnyCell | None, metric: str) -> bool:
    """Whether an event still answers its cell: an image compared with the current reference, by the metric of the config."""
    if event is None or event.state == "outdated":
        return False
    if event.state == "skipped":
        return cell.skip is not None
    if cell.skip or isinstance(event, records.RayCell):
        return not cell.skip
    return event.reference_id == cell.reference_id and all(metric in point.metrics for point in event.points)


def state_of(cell: Cell, event: records.AnyCell | None, metric: str) -> str:
    """queued, done, failed, timeout, skipped or outdated."""
    if cell.skip:
        return "skipped"
    if event is None:
        return "queued"
    return event.state if up_to_date(cell, event, metric) else "outdated"


def expected_seconds(cells: Iterable[Cell], events: Mapping[str, records.AnyCell]) -> dict[str, tuple[float, bool]]:
    """Wall seconds by cell id, and whether they were measured (on the same configuration) or are `budgeted_seconds`."""
    measured: dict[str, list[float]] = {}
    for event in events.values():
        if event.wall_seconds and event.state == "done":
            measured.setdefault(event.configuration, []).append(event.wall_seconds)
    found = {}
    for cell in cells:
        known = sorted(measured.get(cell.configuration, []))
        found[cell.cell_id] = (known[len(known) // 2], True) if known else (budgeted_seconds(cell), False)
    return found


def budgeted_seconds(cell: Cell) -> float:
    """An estimate of the wall seconds of a cell that uses its budget up."""
    budget = cell.budget
    if not isinstance(cell.settings, CellSettings):
        return min(budget.timeout_seconds, budget.max_time_seconds + OVERHEAD_SECONDS)
    pixels = cell.settings.width * cell.settings.height
    # Patterns are rendered anew: the last one takes the budget, those before it in proportion to their samples.
    renders = sum(each.spp for each in cell.patterns) / cell.patterns[-1].spp if cell.patterns else 1.0
    given = cell.spec["checkpoints"]
    checkpoints = len(cell.patterns) or 2 + max(0.0, math.log(budget.max_spp / given["start"], given["ratio"]))
    scored = SCORE_SECONDS * pixels * checkpoints
    return min(budget.timeout_seconds, renders * budget.max_time_seconds + OVERHEAD_SECONDS + scored)
