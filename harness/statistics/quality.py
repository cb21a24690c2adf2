"""Time to quality, censored where a target was not reached, and efficiency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.statistics.convergence import NOISE_ERRORS, Curve, first_crossing
from harness.statistics.intervals import Estimate, bounded_interval, geometric_interval


class Bound(NamedTuple):
    """A value that is known (`low` equals `high`), or known to lie between `low` and `high`."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class QualityTime:
    """Seconds until `target`: geometric mean over seeds with Student's interval on the logarithms.

    `reached` of `seeds` got there; `at_first` of those were there at their first checkpoint. `crossings` has the
    seconds of each seed: (0, x] where it was there at its first checkpoint, [x, inf) where it was not there after x
    seconds. `value` is infinite where some seed did not get there.
    """

    target: float
    value: float
    low: float
    high: float
    reached: int
    at_first: int
    seeds: int
    crossings: tuple[Bound, ...]

    def verdict(self) -> str:
        """`5/5`, as the tables print it; `5/5 ≤` says that some times are upper bounds."""
        return f"{self.reached}/{self.seeds}{' ≤' if self.at_first else ''}"


def reliable_errors(error: ArrayLike, se: ArrayLike) -> NDArray[np.float64]:
    """Corrected errors no smaller than 3 standard errors: below that only "less than 3 se" is known.

    A target under that level is thus not reached by noise.
    """
    error, se = np.asarray(error, np.float64), np.nan_to_num(np.asarray(se, np.float64), posinf=np.inf)
    return np.maximum(error, NOISE_ERRORS * se)


def time_to_quality(curves: Sequence[Curve], fixed_seconds: Sequence[float], target: float) -> QualityTime:
    """Over seeds: fixed seconds + first crossing of each seed's monotone fit; curves hold seconds as x.

    `fixed_seconds` is 0 for warm times, import + load + build + compilation for cold ones.
    """
    found = [first_crossing(c.x, reliable_errors(c.error, c.se), target) for c in curves]
    ends = [(0.0 if c.state == "at_first" else c.last if c.state == "censored" else c.x, c.x) for c in found]
    bounds = tuple(Bound(fixed + low, fixed + high) for fixed, (low, high) in zip(fixed_seconds, ends, strict=True))
    value, low, high, _ = bounded_interval([bound.low for bound in bounds], [bound.high for bound in bounds])
    states = [crossing.state for crossing in found]
    reached = len(states) - states.count("censored")
    return QualityTime(target, value, low, high, reached, states.count("at_first"), len(states), bounds)


def efficiency(mse: Sequence[float], seconds: Sequence[float]) -> Estimate:
    """1 / (MSE x time) (Pharr, Jakob and Humphreys, "Efficiency"): geometric mean over seeds with its interval.

    NaN for a seed whose error is not positive or not finite.
    """
    pairs = zip(mse, seconds, strict=True)
    return geometric_interval([1 / (e * t) if math.isfinite(e * t) and e > 0 and e * t > 0 else math.nan for e, t in pairs])
