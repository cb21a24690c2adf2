"""Cases of the accuracy suite as work of a run: those that a config's `verify` key names.

A verify job is one case for one engine, precision and accelerator. It runs in a process of its own, like a cell. Its event
holds the check results. It is not run again until its spec changes.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from harness.hashing import digest
from harness.source_hashes import engine_code
from harness.store.events import latest_verify_jobs
from harness.store.records import AnyEvent
from harness.suites import Check, suite

if TYPE_CHECKING:
    from engines.interface import Engine
    from harness.config import VerifyConfig


@dataclasses.dataclass(frozen=True, slots=True)
class VerifyJob:
    """`spec` is the preimage of `verify_job_id`; `engine` the name by which a worker imports it."""

    verify_job_id: str
    engine: str
    spec: Mapping[str, Any]
    timeout_seconds: float

    @property
    def words(self) -> str:
        return " ".join(str(self.spec[key]) for key in ("engine", "precision", "accelerator", "case"))


def planned(config: VerifyConfig | None, engines: Mapping[str, Engine]) -> tuple[VerifyJob, ...]:
    """Every case in every precision that an engine has; none for an engine that renders nothing here: its cells say why."""
    if config is None:
        return ()
    return tuple(
        _job(config, name, engine, check) for name, engine in engines.items() for check in suite().checks(engine, config.cases)
    )


def _job(config: VerifyConfig, name: str, engine: Engine, check: Check) -> VerifyJob:
    preimage = {
        "engine": name if ":" not in name else engine.name,
        "engine_version": str(engine.version),
        "engine_code": engine_code(engine, name),
        "precision": check.precision,
        "accelerator": check.accelerator,
        "case": check.case,
        "quick": config.quick,
        "code": hashlib.sha256(check.source.encode()).hexdigest(),
    }
    return VerifyJob(digest(preimage), name, preimage, config.timeout_seconds)


def todo(wanted: Iterable[VerifyJob], events: Iterable[AnyEvent], retry: bool) -> list[VerifyJob]:
    """The jobs without a result; with `retry` those that failed, too."""
    known = latest_verify_jobs(events)
    return [each for each in wanted if each.verify_job_id not in known or (retry and known[each.verify_job_id].state != "done")]
