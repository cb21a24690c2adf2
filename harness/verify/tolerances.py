"""Tolerances, by the precision in which an engine traces; each case names its own where it is defined (`checks`).

The unit says what a tolerance bounds:

- `relative`: |measured - exact| / |exact|, the largest;  `eps`: |measured - exact| in machine epsilons of the tracing
  precision, where coordinates are about 1;  `eps/cos`: the same times the cosine at the hit
- `wrong`: the number of rays, pixels or samples that are wrong
- `absolute`: |measured - exact| of a radiance;  `z`: |mean - truth| in standard errors

`None`: the precision cannot pass the case. It is measured and shown, and its outcome is xfail where it fails. A mapping gives
each parameter a tolerance of its own; parameters that it lacks cannot be passed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

Limit = float | None | Mapping[str, float]

TRACING = {"embree": "float32"}
"""Engines that trace in another precision than they shade in. Other engines have an attribute `tracing_precision`."""


def tracing_precision(engine: Any, precision: str) -> str:
    """The precision in which an engine intersects rays with shapes; tolerances go by it."""
    return getattr(engine, "tracing_precision", None) or TRACING.get(engine.name, precision)


ENGINE_TOLERANCES: dict[tuple[str, str], dict[str, float]] = {
    ("embree", "float64"): {"T15": 0, "T18": 0},
    ("numba", "float32"): {"T3": 0, "T11": 0, "T13": 0},
}
"""Tighter tolerances of single engines: (engine, precision) -> case -> limit.

With float64 the embree engine scales scenes to about 1 for Embree, and confirms every hit in float64. The trees of the numba
engine break ties by index in either precision."""


class Tolerance(NamedTuple):
    """Limits for engines that trace in float64 and in float32, and why they differ where they do."""

    unit: str
    float64: Limit
    float32: Limit
    why: str = ""

    def limit(self, tracing: str, parameter: str) -> float | None:
        """The number for a precision and a parameter; None where the precision cannot pass the case."""
        limit = self.float64 if tracing == "float64" else self.float32
        return limit.get(parameter) if isinstance(limit, Mapping) else limit


NONE_WRONG = Tolerance("wrong", 0, 0)
"""No ray or pixel may be wrong."""
ROUNDING, LARGEST_Z = {"float64": 1e-12, "float32": 1e-5}, 4.5
"""Error that rounding may cause in an image without noise, and the largest |z| of a mean."""
Z = Tolerance("z", LARGEST_Z, LARGEST_Z, "with 32 replicates a false alarm has probability 9e-5 per test; seeds are fixed")
EXACT = Tolerance("absolute", ROUNDING["float64"], ROUNDING["float32"])
MANY_EVENTS = Tolerance("absolute", 1e-11, 1e-4, "hundreds of events")
