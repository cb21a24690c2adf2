"""Cases of the accuracy suite (`raybench verify`) as work of a run: those that the config names under `verify`.

An examination is one case, asked of one engine in one precision and accelerator, in a process of its own like a cell.
Its event holds the findings, and it is not made again while nothing that was asked changes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from time import monotonic
from typing import TYPE_CHECKING, Any

from harness.identity import digest
from harness.pool import Pool, WorkerFailed, WorkerTimeout
from harness.sources import engine_code

if TYPE_CHECKING:
    from engines.interface import Engine
    from harness.config import VerifyAsked
    from harness.verify.case import Case

EVENT = "examination"


@dataclasses.dataclass(frozen=True, slots=True)
class Examination:
    """`asked` is the preimage of `examination_id`; `engine` the name by which a worker imports it."""

    examination_id: str
    engine: str
    asked: Mapping[str, Any]
    timeout_seconds: float

    @property
    def words(self) -> str:
        return " ".join(str(self.asked[key]) for key in ("engine", "precision", "accelerator", "case"))


def planned(asked: VerifyAsked | None, engines: Mapping[str, Engine]) -> tuple[Examination, ...]:
    """Every case in every precision that an engine has; none of one that renders nothing here: its cells say why."""
    if asked is None:
        return ()
    from harness.verify.subject import Skipped, accelerator_names, precisions
    from harness.verify.suite import select_cases

    found: list[Examination] = []
    for name, engine in engines.items():
        with suppress(Skipped):
            found += [
                _examination(asked, name, engine, precision, accelerator, case)
                for precision in precisions(engine)
                for case in select_cases(asked.cases)
                for accelerator in (accelerator_names(engine) if case.each_accelerator else ["auto"])
            ]
    return tuple(found)


def _examination(
    asked: VerifyAsked, name: str, engine: Engine, precision: str, accelerator: str, case: Case
) -> Examination:  # fmt: skip
    source = inspect.getsource(inspect.getmodule(case.check) or case.check)
    preimage = {
        "engine": name if ":" not in name else engine.name, "engine_version": str(engine.version),
        "engine_code": engine_code(engine, name), "precision": precision, "accelerator": accelerator, "case": case.id,
        "quick": asked.quick, "code": hashlib.sha256(source.encode()).hexdigest(),
    }  # fmt: skip
    return Examination(digest(preimage), name, preimage, asked.timeout_seconds)


def latest(events: Iterable[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """The last event of every examination."""
    return {event["examination_id"]: event for event in events if event["event"] == EVENT}


def findings(events: Iterable[Mapping[str, Any]], wanted: Iterable[str] | None = None) -> list[Mapping[str, Any]]:
    """What all examinations found, or those of the ids wanted."""
    known = latest(events)
    chosen = known if wanted is None else [key for key in wanted if key in known]
    return [finding for key in chosen for finding in known[key]["findings"]]


def todo(wanted: Iterable[Examination], events: Iterable[Mapping[str, Any]], retry: bool) -> list[Examination]:
    """What was not made yet; what failed only where it is to be tried again."""
    known = latest(events)
    return [each for each in wanted if each.examination_id not in known
            or (retry and known[each.examination_id]["state"] != "done")]  # fmt: skip


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
        "event": EVENT, "examination_id": each.examination_id, "asked": dict(each.asked), "env_id": env_id,
        "state": state, "message": message, "findings": found, "wall_seconds": monotonic() - began,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip
