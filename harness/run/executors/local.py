"""Measures a run's cells on this machine, one at a time."""

from __future__ import annotations

from contextlib import closing
from statistics import median
from time import monotonic

from harness.measure.pool import Pool
from harness.measure.sentinel import sentinel_seconds
from harness.plan.state import expected_seconds
from harness.run.recorder import CellRecord, Recorder


def measure(recorder: Recorder, pool: Pool) -> None:
    """Measures cell after cell; every block begins with fresh workers and a sentinel."""
    todo = recorder.ready()
    checkpoints = recorder.plan.experiment.checkpoints
    block = None
    for number, cell in enumerate(todo):
        if recorder.stopped:
            return
        if cell.block != block:
            block = cell.block
            pool.renew()
            seconds = median(sentinel_seconds() for _ in range(3))
            recorder.append({"event": "sentinel", "block": block, "seconds": seconds})
        left = expected_seconds(todo[number:], recorder.latest)
        recorder.listener.cell(cell, number, len(todo), sum(seconds for seconds, _ in left.values()))
        recorder.begin(cell)
        began, sentinel = monotonic(), sentinel_seconds()
        record = CellRecord(recorder, cell, recorder.env_id)
        with closing(pool.cell(cell.engine, cell.request(checkpoints), cell.budget.timeout_seconds)) as messages:
            event = recorder.measured_as(record, messages, sentinel)
        recorder.finish(cell, {**event, "wall_seconds": monotonic() - began})
