"""Runs the cases against engines and turns what they measure into findings with a verdict."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engines.interface import Engine
from harness.verify import (
    boxes_and_trees,
    cameras,
    furnaces,
    glass,
    light,
    materials,
    rays,
    sampling,
    spawned_rays,
    spheres,
    stability,
    triangles,
)
from harness.verify.case import Case, Measured
from harness.verify.promises import OWN, PROMISES, Promise
from harness.verify.subject import Declined, Subject, accelerators, precisions

SECTIONS = (spheres.SECTION, triangles.SECTION, boxes_and_trees.SECTION, rays.SECTION, spawned_rays.SECTION,
            cameras.SECTION, glass.SECTION, materials.SECTION, furnaces.SECTION, light.SECTION, sampling.SECTION,
            stability.SECTION)  # fmt: skip
CASES: tuple[Case, ...] = tuple(case for section in SECTIONS for case in section.cases)
"""Every case, in the order of the tables."""

KEPT, NOT_PROMISED, BROKEN, DECLINED = "kept", "not promised", "broken", "declined"


@dataclass(frozen=True, slots=True)
class Finding:
    """One row of the tables: what a case found with one engine, precision and accelerator.

    `error`, `allowed` in `unit` (see `promises`); `median`, `tail` (99.9 %) and `worst` in ulp of `tracing`, NaN where a
    case has no distribution. `allowed` is NaN where nothing is promised. `typical` is the median error in `unit`.
    """

    engine: str
    version: str
    precision: str
    tracing: str
    accelerator: str
    section: str
    case: str
    asked: str
    source: str
    parameter: str
    count: int
    error: float
    unit: str
    allowed: float
    verdict: str
    median: float
    tail: float
    worst: float
    seconds: float
    note: str = ""
    typical: float = float("nan")


def findings(engines: Sequence[Engine], quick: bool = False, cases: Sequence[Case] = CASES) -> Iterator[Finding]:
    """Every finding of every engine, one after the other as they come."""
    for engine in engines:
        for precision in precisions(engine):
            for case in cases:
                if not (quick and case.full_only):
                    for name in accelerators(engine) if case.each_accelerator else ["auto"]:
                        yield from examine(case, Subject(engine, precision, name, quick))


def examine(case: Case, subject: Subject) -> list[Finding]:
    """The findings of one case; an exception is a broken promise, a refusal is none."""
    return list(examined(case, subject))


def examined(case: Case, subject: Subject) -> Iterator[Finding]:
    """The same one by one, as they are measured."""
    since = time.perf_counter()
    try:
        for result in case.check(subject):
            yield _finding(case, subject, result, None, time.perf_counter() - since)
            since = time.perf_counter()
    except Declined as reason:
        yield _finding(case, subject, Measured(np.zeros(0), note=str(reason)), DECLINED, 0.0)
    except Exception as error:
        yield broken(case, subject, f"{type(error).__name__}: {error}", time.perf_counter() - since)


def broken(case: Case, subject: Subject, note: str, seconds: float = 0.0) -> Finding:
    """The finding of a case that gave no answer."""
    return _finding(case, subject, Measured(np.array([np.inf]), note=note), BROKEN, seconds)


def _error(promise: Promise, errors: Any) -> float:
    """The one number of a case: a sum of what is wrong, the smallest p value, or the worst error."""
    if errors.size == 0:
        return float("nan")
    if promise.unit == "wrong":
        return float(np.where(np.isnan(errors), 1.0, errors).sum())
    if promise.unit == "p":
        return float(np.min(errors))
    return float(np.max(np.where(np.isnan(errors), np.inf, np.abs(errors))))


def _typical(errors: Any) -> float:
    return float(np.median(np.where(np.isnan(errors), np.inf, np.abs(errors)))) if errors.size else float("nan")


def _verdict(case: Case, subject: Subject, promise: Promise, result: Measured, error: float) -> tuple[float, str]:
    """(allowed, verdict); what is not promised is kept where it would pass as a promise of float64."""
    own = OWN.get((subject.engine.name, subject.precision), {})
    limit = own[case.id] if case.id in own else promise.limit(subject.tracing, result.parameter)
    wanted = limit if limit is not None else promise.limit("float64", result.parameter)
    if wanted is None:
        raise KeyError(f"case {case.id}: no promise for {result.parameter!r}")
    good = error >= wanted if promise.unit == "p" else error <= wanted
    if limit is None:
        return float("nan"), KEPT if good else NOT_PROMISED
    return limit, KEPT if good else BROKEN


def _finding(case: Case, subject: Subject, result: Measured, verdict: str | None, seconds: float) -> Finding:
    promise = PROMISES[case.id]
    error, allowed = _error(promise, result.errors), float("nan")
    if verdict is None:
        allowed, verdict = _verdict(case, subject, promise, result, error)
    finite = result.ulps if result.ulps is not None else np.full(1, np.nan)
    median, tail, worst = (float(np.quantile(finite, q, method="higher")) for q in (0.5, 0.999, 1.0))
    return Finding(
        subject.engine.name, subject.engine.version, subject.precision, subject.tracing, subject.accelerator,
        case.section, case.id, case.asked, case.source, result.parameter, result.errors.size, error, promise.unit,
        allowed, verdict, median, tail, worst, seconds, result.note, _typical(result.errors),
    )  # fmt: skip
