"""One row of the accuracy tables, the same in memory, in verify.json and in the events of a results folder."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Outcome = Literal["pass", "xfail", "fail", "skip"]
"""xfail: the precision has no tolerance for the case (an expected failure); skip: the engine's `why_not` refuses the scene."""


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
    outcome: Outcome
    median_ulp: float
    p999_ulp: float
    worst_ulp: float
    seconds: float
    note: str = ""
    median_error: float = float("nan")
