"""Runs the verify jobs of a plan: each in a process of its own, like a cell."""

from __future__ import annotations

from datetime import UTC, datetime
from time import monotonic

from harness import suites
from harness.measure.messages import Job
from harness.measure.pool import Pool, WorkerFailed, WorkerTimeout
from harness.plan.verify_jobs import VerifyJob
from harness.store import records


def make(each: VerifyJob, pool: Pool, env_id: str) -> records.VerifyJob:
    """The event of a verify job that was run, has failed or was killed at its timeout."""
    began, state, message, found = monotonic(), "done", "", []
    try:
        asked = {key: each.spec[key] for key in ("case", "precision", "accelerator", "quick")}
        found = list(pool.run(each.engine, Job(suites.JOB, asked), each.timeout_seconds))
    except WorkerFailed as error:
        state, message = "failed", str(error)
    except WorkerTimeout:
        state, message = "timeout", f"killed after {each.timeout_seconds:g} s"
    return records.VerifyJob(
        verify_job_id=each.verify_job_id,
        spec=dict(each.spec),
        env_id=env_id,
        state=state,
        message=message,
        results=tuple(found),
        wall_seconds=monotonic() - began,
        time=datetime.now(UTC).isoformat(timespec="seconds"),
    )
