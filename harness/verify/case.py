"""A case of the suite, its measurements, and the sections in which cases are registered."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.verify.tolerances import Tolerance

if TYPE_CHECKING:
    from harness.verify.subject import Subject

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measurement:
    """`errors` (n,): one per ray, pixel or sample, in the unit of the case (`tolerances`); NaN and inf are infinitely wrong.

    `parameter` names what was varied. `ulps` (n,), where errors are distances from exact answers: the same distances in units
    in the last place of the tracing precision.
    """

    errors: Array
    parameter: str = ""
    ulps: Array | None = None
    note: str = ""


def measurement(errors: Any, parameter: str = "", ulps: Array | None = None, note: str = "") -> Measurement:
    """A `Measurement` of anything array-like."""
    return Measurement(np.atleast_1d(np.asarray(errors, np.float64)), parameter, ulps, note)


CheckFunction = Callable[["Subject"], Iterable[Measurement]]


@dataclass(frozen=True, slots=True)
class Case:
    """`description` is one sentence, `source` the publication or program that the case comes from, `tolerance` what its
    measurements are compared with.

    With `each_accelerator` the case runs once with every accelerator of an engine, otherwise with `auto`. A quick run leaves
    out `full_only` cases.
    """

    id: str
    section: str
    description: str
    tolerance: Tolerance
    source: str
    check: CheckFunction
    each_accelerator: bool
    full_only: bool

    def accelerators(self, names: Sequence[str]) -> Sequence[str]:
        """Those of an engine's accelerators that it runs with."""
        return names if self.each_accelerator else ["auto"]


@dataclass
class Section:
    """Cases on one subject, in the order of their definition; `case` is the decorator that registers one."""

    name: str
    cases: list[Case] = field(default_factory=list)
    each_accelerator: bool = False

    def case(
        self, id: str, description: str, tolerance: Tolerance, source: str = "raybench", full_only: bool = False
    ) -> Callable[[CheckFunction], CheckFunction]:
        """Registers the decorated function as the check of a case."""

        def add(check: CheckFunction) -> CheckFunction:
            self.cases.append(Case(id, self.name, description, tolerance, source, check, self.each_accelerator, full_only))
            return check

        return add
