"""Time to quality, censored where a target was not reached, and efficiency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.statistics.convergence import NOISE_ERRORS, Crossing, Curve, first_crossing
from harness.statistics.intervals import LEVEL, Estimate, median_interval


@dataclass(frozen=True, slots=True)
class QualityTime:
    """Seconds until `target`: median over seeds with its bootstrap interval; inf where the median seed fell short.

    `reached` of `seeds` got there; `at_first` of those were there at their first checkpoint, so that their time is an
    upper bound. `crossings` keeps the seconds of each seed (inf if censored).
    """

    target: float
    median: float
    low: float
    high: float
    reached: int
    at_first: int
    seeds: int
    crossings: tuple[float, ...]

    def verdict(self) -> str:
        """`5/5`, as the tables print it; `5/5 ≤` says that some times are upper bounds."""
        return f"{self.reached}/{self.seeds}{' ≤' if self.at_first else ''}"


def reliable_errors(error: ArrayLike, se: ArrayLike) -> NDArray[np.float64]:
    """Corrected errors no smaller than 3 standard errors: below that only "less than 3 se" is known.

    A target under that level is thus not reached by noise.
    """
    error, se = np.asarray(error, np.float64), np.nan_to_num(np.asarray(se, np.float64), posinf=np.inf)
    return np.maximum(error, NOISE_ERRORS * se)


def time_to_quality(curves: Sequence[Curve], fixed_seconds: Sequence[float], target: float,
                    level: float = LEVEL) -> QualityTime:  # fmt: skip
    """Median over seeds of fixed seconds + first crossing of each seed's monotone fit; curves hold seconds as x.

    `fixed_seconds` is 0 for warm times, import + load + build + compilation for cold ones. Bootstrap over seeds.
    """
    crossings = [first_crossing(c.x, reliable_errors(c.error, c.se), target) for c in curves]
    return summarise(crossings, fixed_seconds, target, level)


def summarise(crossings: Sequence[Crossing], fixed_seconds: Sequence[float], target: float,
              level: float = LEVEL) -> QualityTime:  # fmt: skip
    """`time_to_quality` of crossings that are known already."""
    seconds = tuple(fixed + crossing.x for fixed, crossing in zip(fixed_seconds, crossings, strict=True))
    value, low, high, _ = median_interval(seconds, level)
    states = [crossing.state for crossing in crossings]
    reached = sum(state != "censored" for state in states)
    return QualityTime(target, value, low, high, reached, states.count("at_first"), len(states), seconds)


def efficiency(mse: Sequence[float], seconds: Sequence[float]) -> Estimate:
    """1 / (MSE x time) (Pharr, Jakob and Humphreys, "Efficiency"): median over seeds with a bootstrap interval.

    NaN for a seed whose error is not positive or not finite.
    """
    pairs = zip(mse, seconds, strict=True)
    return median_interval([1 / (e * t) if math.isfinite(e * t) and e > 0 and e * t > 0 else math.nan for e, t in pairs])
