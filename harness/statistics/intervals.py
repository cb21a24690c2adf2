"""The intervals that everything else uses: Student's, of means and of geometric means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, stdtrit  # scipy.stats takes a second to import

LEVEL = 0.95


class Estimate(NamedTuple):
    """A value with its interval and the number of independent replicates; NaN where there is too little to say."""

    value: float
    low: float
    high: float
    n: int


NOTHING = Estimate(math.nan, math.nan, math.nan, 0)


def mean_interval(values: Sequence[float] | NDArray[np.float64], level: float = LEVEL) -> Estimate:
    """Mean and Student's t interval of independent `values`; NaN bounds below two of them."""
    known = np.asarray(values, np.float64)
    known = known[~np.isnan(known)]
    if known.size == 0:
        return NOTHING
    mean = float(known.mean())
    if known.size == 1:
        return Estimate(mean, math.nan, math.nan, 1)
    half = stdtrit(known.size - 1, (1 + level) / 2) * known.std(ddof=1) / math.sqrt(known.size)
    return Estimate(mean, float(mean - half), float(mean + half), int(known.size))


def geometric_interval(values: Sequence[float]) -> Estimate:
    """exp of the mean of the logarithms with Student's t interval: of times, rates and errors, which are positive.

    NaN values are left out. Zeros make the mean 0, infinite values make it infinite, both without an interval; of a negative
    value, or of zeros beside infinite ones, there is no geometric mean: NaN.
    """
    known = np.asarray(values, np.float64)
    known = known[~np.isnan(known)]
    if (known < 0).any():
        return Estimate(math.nan, math.nan, math.nan, int(known.size))
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(np.exp(np.log(known).mean())) if known.size else math.nan
    if not 0 < value < math.inf:
        return Estimate(value, math.nan, math.nan, int(known.size))
    _, low, high, n = mean_interval(np.log(known))
    if math.isnan(low):
        return Estimate(value, low, high, n)
    return Estimate(value, min(exp(low), value), max(exp(high), value), n)  # exp rounds another sum where all are equal


def bounded_interval(low: Sequence[float], high: Sequence[float]) -> Estimate:
    """Geometric mean and interval of positive values that are known, or known to lie between `low` and `high`.

    An infinite upper bound makes the value infinite, so that it is only known to be above the lower end. A lower
    bound of 0 makes the lower end 0: the value is the mean of the upper bounds, and only known to be below the upper
    end.
    """
    below, above = geometric_interval(low), geometric_interval(high)
    single = below.n < 2
    return Estimate(
        above.value,
        0.0 if below.value == 0 else below.value if single and math.isinf(above.value) else below.low,
        math.inf if math.isinf(above.value) else above.value if single and below.value == 0 else above.high,
        below.n,
    )


def proportion_interval(count: int, n: int) -> Estimate:
    """count / n with the exact interval of Clopper and Pearson 1934. Where all or none were counted it has one end alone, at
    the full level: of none in n, that is nearly 3 / n at 95 %. NaN where `n` is 0."""
    if n == 0:
        return NOTHING
    tail = (1 - LEVEL) / (1 if count in (0, n) else 2)
    low = float(betaincinv(count, n - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, n - count, 1 - tail)) if count < n else 1.0
    return Estimate(count / n, low, high, n)


def exp(value: float) -> float:
    """e^value, infinite instead of an error where that is too large."""
    return math.inf if value > 700 else math.exp(value)
