"""Runs the verify jobs of a plan: each in a process of its own, like a cell."""

from __future__ import annotations

from datetime import UTC, datetime
from time import monotonic
from typing import Any

from harness.measure.pool import Pool, WorkerFailed, WorkerTimeout
from harness.plan.verify_jobs import Examination


def make(each: Examination, pool: Pool, env_id: str) -> dict[str, Any]:
    """The event of an examination that was made, has failed or was killed at its timeout."""
    began, state, message, found = monotonic(), "done", "", []
    try:
        worker = pool.worker(each.engine)
        deadline = monotonic() + each.timeout_seconds
        worker.ask({"do": "examine", **{key: each.asked[key] for key in ("case", "precision", "accelerator", "quick")}})
        found = worker.receive(deadline, "examined")["findings"]
        worker.receive(deadline, "end")
    except WorkerFailed as error:
        state, message = "failed", str(error)
    except WorkerTimeout:
        state, message = "timeout", f"killed after {each.timeout_seconds:g} s"
    return {
        "event": "examination", "examination_id": each.examination_id, "asked": dict(each.asked), "env_id": env_id,
        "state": state, "message": message, "findings": found, "wall_seconds": monotonic() - began,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip
