"""A case of the battery, what it measures, and the table that each section registers its cases in."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from harness.verify.subject import Subject

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """Errors in the case's unit (see `promises`), one a ray or pixel; NaN and inf count as infinitely wrong.

    `parameter` names what was varied. `ulps` is the distribution to report where errors are distances from exact
    answers: in units in the last place of the tracing precision.
    """

    errors: Array
    parameter: str = ""
    ulps: Array | None = None
    note: str = ""


def measured(errors: Any, parameter: str = "", ulps: Array | None = None, note: str = "") -> Measured:
    """`Measured` of anything array-like."""
    return Measured(np.atleast_1d(np.asarray(errors, np.float64)), parameter, ulps, note)


Check = Callable[["Subject"], Iterable[Measured]]


@dataclass(frozen=True, slots=True)
class Case:
    """`asked` is one sentence; `source` where it comes from. `each_accelerator`: run with every one, else with auto.

    `full_only` cases are left out of a quick run.
    """

    id: str
    section: str
    asked: str
    source: str
    check: Check
    each_accelerator: bool
    full_only: bool


@dataclass
class Section:
    """Cases in the order in which they are written; `case` is the decorator that adds one."""

    name: str
    cases: list[Case] = field(default_factory=list)
    each_accelerator: bool = False

    def case(self, id: str, asked: str, source: str, full_only: bool = False) -> Callable[[Check], Check]:
        """Registers the function below it."""

        def add(check: Check) -> Check:
            self.cases.append(Case(id, self.name, asked, source, check, self.each_accelerator, full_only))
            return check

        return add
