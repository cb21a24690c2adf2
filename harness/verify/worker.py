"""The job of a measuring worker that runs one case of the suite: named, not imported, by `harness.run.verify_jobs`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.measure.messages import End, Parent, Results
from harness.verify.subject import Subject
from harness.verify.suite import CASES, run_case


def run(engine: Any, request: Mapping[str, Any], parent: Parent) -> None:
    """Sends the results of a case, each a `CheckResult` as plain data."""
    case = next(case for case in CASES if case.id == request["case"])
    subject = Subject(engine, request["precision"], request["accelerator"], request["quick"])
    parent.send(Results([dict(result) for result in run_case(case, subject)]))
    parent.send(End({}, {}))
