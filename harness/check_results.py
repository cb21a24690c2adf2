"""Results of accuracy checks: one record, the same in memory, in verify.json and in the events of a results folder."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple, get_args

from pydantic import BaseModel, ConfigDict, Field

CheckOutcome = Literal["pass", "xfail", "fail", "skip"]
"""xfail: the precision has no tolerance for the case (an expected failure); skip: the engine's `why_not` refuses the scene."""
PASS, XFAIL, FAIL, SKIP = OUTCOMES = get_args(CheckOutcome)


class CheckResult(BaseModel):
    """One measurement of a case, for one engine, precision and accelerator.

    `error`, `tolerance` and `median_error` are in `unit` (see `tolerances`); `tolerance` is NaN where there is none.
    `median_ulp`, `p999_ulp` (the 99.9 % quantile) and `worst_ulp` are in ulp of the precision `tracing`, NaN for cases that
    measure no distances. `count` rays, pixels or samples were measured in `seconds`, compilation included.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    engine: str
    version: str
    precision: str
    tracing: str
    accelerator: str
    section: str
    case: str
    description: str
    source: str
    parameter: str
    count: Annotated[int, Field(ge=0, le=2**62)]
    error: float
    unit: str
    tolerance: float
    outcome: CheckOutcome
    median_ulp: float
    p999_ulp: float
    worst_ulp: float
    seconds: float
    note: str = ""
    median_error: float = float("nan")


def counts(results: Sequence[CheckResult]) -> Counter[str]:
    """The number of results by outcome."""
    return Counter(result.outcome for result in results)


def counts_text(counted: Counter[str]) -> str:
    """`12 pass, 1 fail`."""
    return ", ".join(f"{counted[outcome]} {outcome}" for outcome in OUTCOMES if counted[outcome]) or "no results"


class Worst(NamedTuple):
    """The result nearest to its tolerance, how many others it stands for, and the one of them with the largest ulp error."""

    result: CheckResult
    others: int
    worst_in_ulp: CheckResult


def worst_per_check(results: Sequence[CheckResult]) -> list[Worst]:
    """One row for each case, engine, precision and outcome; failures have a row each."""
    groups: dict[tuple[str, ...], list[CheckResult]] = {}
    for result in results:
        groups.setdefault((result.engine, result.precision, result.section, result.case), []).append(result)
    rows: list[Worst] = []
    for group in groups.values():
        for outcome in (PASS, XFAIL, SKIP):
            alike = [result for result in group if result.outcome == outcome]
            if alike:
                rows.append(Worst(max(alike, key=_share_of_tolerance), len(alike) - 1, max(alike, key=_worst_ulp)))
        rows += [Worst(result, 0, result) for result in group if result.outcome == FAIL]
    return rows


def _worst_ulp(result: CheckResult) -> float:
    return -1.0 if math.isnan(result.worst_ulp) else result.worst_ulp


def _share_of_tolerance(result: CheckResult) -> float:
    """Error over tolerance; the error itself where there is no tolerance."""
    return result.error / result.tolerance if result.tolerance > 0 else result.error
