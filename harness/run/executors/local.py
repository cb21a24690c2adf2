"""Measures a run's cells on this machine, one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from time import monotonic

from harness.measure.pool import Pool
from harness.plan.cells import Cell
from harness.plan.state import expected_seconds
from harness.run.recorder import CellRecord, Recorder


def measure(recorder: Recorder, pool: Pool) -> None:
    """Measures cell after cell, and contended ones again; every block begins with fresh workers."""
    _measure(recorder, pool, recorder.ready(), again=False)
    for cells in recorder.contended_again(lambda event: event.env_id == recorder.env_id):
        _measure(recorder, pool, cells, again=True)


def _measure(recorder: Recorder, pool: Pool, cells: Sequence[Cell], again: bool) -> None:
    block = None
    for number, cell in enumerate(cells):
        if recorder.stopped:
            return
        if cell.block != block:
            block = cell.block
            pool.renew()
        left = expected_seconds(cells[number:], recorder.latest)
        recorder.listener.cell(cell, number, len(cells), sum(seconds for seconds, _ in left.values()))
        attempt = recorder.next_attempt(cell) if again else 1
        recorder.begin(cell, attempt)
        began = monotonic()
        record = CellRecord(recorder, cell, recorder.env_id, attempt)
        asked = cell.engine, recorder.request(cell), cell.budget.timeout_seconds, lambda record=record: record.enough
        with closing(pool.cell(*asked)) as messages:
            event = recorder.measured_as(record, messages)
        recorder.finish(cell, event.replaced(wall_seconds=monotonic() - began))
