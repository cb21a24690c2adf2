"""Cases of the accuracy suite as work of a run: those that a config's `verify` key names.

A verify job is one case for one engine, precision and accelerator. It runs in a process of its own, like a cell. Its event
holds the check results. It is not run again until its spec changes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from engines.errors import ConfigError, suggestion
from harness.hashing import digest
from harness.source_hashes import engine_code
from harness.store.events import latest_verify_jobs
from harness.store.records import AnyEvent

if TYPE_CHECKING:
    from engines.interface import Engine
    from harness.config import VerifyConfig
    from harness.verify.case import Case


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


def planned(config: VerifyConfig | None, engines: Mapping[str, Engine], source: str = "") -> tuple[VerifyJob, ...]:
    """Every case in every precision that an engine has; none for an engine that renders nothing here: its cells say why.

    Raises `ConfigError`, which names the file `source`, for a case that does not exist.
    """
    if config is None:
        return ()
    from harness.verify.subject import Skipped, accelerator_names, precisions
    from harness.verify.suite import case_names, select_cases

    for index, name in enumerate(config.cases):
        if name not in (known := case_names()):
            near = suggestion(name, known)
            raise ConfigError(f"{source} verify.cases[{index}] = {name!r}: unknown case or section: {near}")
    found: list[VerifyJob] = []
    for name, engine in engines.items():
        with suppress(Skipped):
            found += [
                _job(config, name, engine, precision, accelerator, case)
                for precision in precisions(engine)
                for case in select_cases(config.cases)
                for accelerator in (accelerator_names(engine) if case.each_accelerator else ["auto"])
            ]
    return tuple(found)


def _job(config: VerifyConfig, name: str, engine: Engine, precision: str, accelerator: str, case: Case) -> VerifyJob:
    source = inspect.getsource(inspect.getmodule(case.check) or case.check)
    preimage = {
        "engine": name if ":" not in name else engine.name,
        "engine_version": str(engine.version),
        "engine_code": engine_code(engine, name),
        "precision": precision,
        "accelerator": accelerator,
        "case": case.id,
        "quick": config.quick,
        "code": hashlib.sha256(source.encode()).hexdigest(),
    }
    return VerifyJob(digest(preimage), name, preimage, config.timeout_seconds)


def todo(wanted: Iterable[VerifyJob], events: Iterable[AnyEvent], retry: bool) -> list[VerifyJob]:
    """The jobs without a result; with `retry` those that failed, too."""
    known = latest_verify_jobs(events)
    return [each for each in wanted if each.verify_job_id not in known or (retry and known[each.verify_job_id].state != "done")]
