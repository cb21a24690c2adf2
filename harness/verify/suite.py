"""Runs cases against engines; compares every measurement with its tolerance."""

from __future__ import annotations

import inspect
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from engines.interface import Engine
from harness.check_results import FAIL, PASS, SKIP, XFAIL, CheckOutcome, CheckResult
from harness.measure.messages import End, Parent, Results
from harness.suites import Check
from harness.verify.case import Case, Measurement
from harness.verify.checks import (
    accelerators,
    cameras,
    cylinders,
    furnaces,
    glass,
    lights,
    materials,
    media,
    models,
    rays,
    sampling,
    skies,
    spawned_rays,
    spheres,
    stability,
    textures,
    triangles,
)
from harness.verify.subject import Skipped, Subject, accelerator_names, precisions
from harness.verify.tolerances import ENGINE_TOLERANCES, Tolerance

_TRACING = (spheres, cylinders, triangles, accelerators, rays, spawned_rays, cameras)
_RENDERING = (glass, materials, models, textures, furnaces, lights, skies, media, sampling, stability)
CASES: tuple[Case, ...] = tuple(case for module in (*_TRACING, *_RENDERING) for case in module.SECTION.cases)
"""Every case, in the order of the tables."""


def case_of(id: str) -> Case:
    """The case of an id of the suite; raises `StopIteration` for another text."""
    return next(case for case in CASES if case.id == id)


def select_cases(names: Sequence[str]) -> list[Case]:
    """The cases of these ids and sections, in the order of the suite."""
    return [case for case in CASES if case.id in names or case.section in names]


def case_names() -> list[str]:
    """The names that `select_cases` knows: sections first, then ids."""
    return [*dict.fromkeys(case.section for case in CASES), *(case.id for case in CASES)]


def checks(engine: Engine, names: Sequence[str]) -> Iterator[Check]:
    """What a run whose config names these checks of the engine; see `harness.suites`."""
    with suppress(Skipped):
        for precision in precisions(engine):
            for case in select_cases(names):
                source = inspect.getsource(inspect.getmodule(case.check) or case.check)
                for accelerator in case.accelerators(accelerator_names(engine)):
                    yield Check(case.id, precision, accelerator, source)


def run_suite(engines: Sequence[Engine], quick: bool = False, cases: Sequence[Case] = CASES) -> Iterator[CheckResult]:
    """The results of every engine in this process, one by one as they are measured."""
    for engine in engines:
        for precision in precisions(engine):
            for case in cases:
                if not (quick and case.full_only):
                    for name in case.accelerators(accelerator_names(engine)):
                        yield from run_case(case, Subject(engine, precision, name, quick))


def run_case(case: Case, subject: Subject) -> Iterator[CheckResult]:
    """The results of one case as they are measured. An exception of the engine is a failure; a refusal is a skip."""
    since = time.perf_counter()
    try:
        for measured in case.check(subject):
            yield _result(case, subject, measured, None, time.perf_counter() - since)
            since = time.perf_counter()
    except Skipped as reason:
        yield _result(case, subject, Measurement(np.zeros(0), note=str(reason)), SKIP, 0.0)
    except Exception as error:
        yield failure(case, subject, f"{type(error).__name__}: {error}", time.perf_counter() - since)


def job(engine: Engine, request: Mapping[str, Any], parent: Parent) -> None:
    """What a measuring worker does for a `Check`: sends the results of its case, each a `CheckResult` as plain data."""
    subject = Subject(engine, request["precision"], request["accelerator"], request["quick"])
    parent.send(Results([dict(result) for result in run_case(case_of(request["case"]), subject)]))
    parent.send(End({}, {}))


def failure(case: Case, subject: Subject, note: str, seconds: float = 0.0) -> CheckResult:
    """The result of a case that could not be measured to its end."""
    return _result(case, subject, Measurement(np.array([np.inf]), note=note), FAIL, seconds)


def _error(tolerance: Tolerance, errors: Any) -> float:
    """The one number of a measurement: the sum for `wrong`, else the largest error."""
    if errors.size == 0:
        return float("nan")
    if tolerance.unit == "wrong":
        return float(np.where(np.isnan(errors), 1.0, errors).sum())
    return float(np.max(np.where(np.isnan(errors), np.inf, np.abs(errors))))


def _median_error(errors: Any) -> float:
    return float(np.median(np.where(np.isnan(errors), np.inf, np.abs(errors)))) if errors.size else float("nan")


def _compared(case: Case, subject: Subject, measured: Measurement, error: float) -> tuple[float, CheckOutcome]:
    """(tolerance, outcome). Without a tolerance in this precision the outcome is pass within that of float64, else xfail."""
    own = ENGINE_TOLERANCES.get((subject.engine.name, subject.precision), {})
    limit = own[case.id] if case.id in own else case.tolerance.limit(subject.tracing, measured.parameter)
    bound = limit if limit is not None else case.tolerance.limit("float64", measured.parameter)
    if bound is None:
        raise KeyError(f"case {case.id}: no tolerance for {measured.parameter!r}")
    if limit is None:
        return float("nan"), PASS if error <= bound else XFAIL
    return float(limit), PASS if error <= bound else FAIL


def _result(case: Case, subject: Subject, measured: Measurement, outcome: CheckOutcome | None, seconds: float) -> CheckResult:
    error, limit = _error(case.tolerance, measured.errors), float("nan")
    if outcome is None:
        limit, outcome = _compared(case, subject, measured, error)
    ulps = measured.ulps if measured.ulps is not None else np.full(1, np.nan)
    median, p999, worst = (float(np.quantile(ulps, q, method="higher")) for q in (0.5, 0.999, 1.0))
    return CheckResult(
        engine=subject.engine.name,
        version=subject.engine.version,
        precision=subject.precision,
        tracing=subject.tracing,
        accelerator=subject.accelerator,
        section=case.section,
        case=case.id,
        description=case.description,
        source=case.source,
        parameter=measured.parameter,
        count=measured.errors.size,
        error=error,
        unit=case.tolerance.unit,
        tolerance=limit,
        outcome=outcome,
        median_ulp=median,
        p999_ulp=p999,
        worst_ulp=worst,
        seconds=seconds,
        note=measured.note,
        median_error=_median_error(measured.errors),
    )
