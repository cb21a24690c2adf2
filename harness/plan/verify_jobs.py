"""Parts of the battery of `raybench verify` as work of a run: what a config's `verify` key asks of its engines.

An examination is one case, asked of one engine in one precision and accelerator, in a process of its own like a cell.
Its event holds the findings, and it is not made again while nothing that was asked changes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from harness.hashing import digest
from harness.source_hashes import engine_code
from harness.store.events import latest_verify_jobs

if TYPE_CHECKING:
    from engines.interface import Engine
    from harness.config import VerifyConfig
    from harness.verify.case import Case


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


def planned(asked: VerifyConfig | None, engines: Mapping[str, Engine]) -> tuple[Examination, ...]:
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
    asked: VerifyConfig, name: str, engine: Engine, precision: str, accelerator: str, case: Case
) -> Examination:  # fmt: skip
    source = inspect.getsource(inspect.getmodule(case.check) or case.check)
    preimage = {
        "engine": name if ":" not in name else engine.name, "engine_version": str(engine.version),
        "engine_code": engine_code(engine, name), "precision": precision, "accelerator": accelerator, "case": case.id,
        "quick": asked.quick, "code": hashlib.sha256(source.encode()).hexdigest(),
    }  # fmt: skip
    return Examination(digest(preimage), name, preimage, asked.timeout_seconds)


def todo(wanted: Iterable[Examination], events: Iterable[Mapping[str, Any]], retry: bool) -> list[Examination]:
    """What was not made yet; what failed only where it is to be tried again."""
    known = latest_verify_jobs(events)
    return [each for each in wanted if each.examination_id not in known
            or (retry and known[each.examination_id]["state"] != "done")]  # fmt: skip
