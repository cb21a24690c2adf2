"""Error against samples or time in log-log space: slope, monotone fit, first crossing of a target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.statistics.intervals import LEVEL, mean_interval

Array = NDArray[np.float64]
NOISE_ERRORS = 3.0
"""A corrected error below this many of its standard errors is noise."""


class Curve(NamedTuple):
    """One seed: `x` (n,) samples or seconds, increasing; `error` (n,) mean squared; `se` (n,), 0 if unknown."""

    x: Array
    error: Array
    se: Array


class Slope(NamedTuple):
    """d log(RMSE) / d log(x) with its interval over seeds, and what it means: see `convergence_slope`."""

    value: float
    low: float
    high: float
    seeds: int
    verdict: str


class Crossing(NamedTuple):
    """When a curve first is at or below a target. `state` is `reached`, `at_first` (at or before the first point, so
    `x` is an upper bound) or `censored` (`x` is inf; the last point is `last`)."""

    x: float
    state: str
    last: float


def curve(x: ArrayLike, error: ArrayLike, se: ArrayLike | None = None) -> Curve:
    """A Curve of float arrays sorted by x."""
    x, error = np.asarray(x, np.float64), np.asarray(error, np.float64)
    spread = np.zeros_like(x) if se is None else np.nan_to_num(np.asarray(se, np.float64), posinf=np.inf)
    order = np.argsort(x, kind="stable")
    return Curve(x[order], error[order], spread[order])


def weighted_line(x: Array, y: Array, weights: Array) -> tuple[float, float]:
    """(slope, intercept) of the weighted least-squares line; NaN below two distinct x."""
    total = weights.sum()
    if x.size < 2 or total <= 0 or np.ptp(x) == 0:
        return math.nan, math.nan
    x_mean, y_mean = (weights * x).sum() / total, (weights * y).sum() / total
    slope = (weights * (x - x_mean) * (y - y_mean)).sum() / (weights * (x - x_mean) ** 2).sum()
    return float(slope), float(y_mean - slope * x_mean)


def convergence_slope(curves: Sequence[Curve], level: float = LEVEL) -> Slope:
    """Slope of log RMSE over log x: a weighted line a seed, then mean and Student's t interval over seeds.

    A point's weight is (error / se)^2, the inverse variance of its logarithm; points below 3 se are left out. Points
    of one seed share samples, hence are correlated: only seeds count as replicates. Verdict: `monte carlo` where the
    interval comes within 0.05 of -1/2, `steeper` (QMC) below that, `flat` (bias) where it lies above -1/4, else
    `slower`; `unknown` without an interval.
    """
    slopes = []
    for x, error, se in curves:
        good = (error > NOISE_ERRORS * se) & (error > 0) & np.isfinite(error) & (x > 0)
        weights = np.where(se[good] > 0, error[good] / np.where(se[good] > 0, se[good], 1.0), 0.0) ** 2
        if not (weights > 0).all():
            weights = np.ones(int(good.sum()))
        slopes.append(weighted_line(np.log(x[good]), np.log(error[good]) / 2, weights)[0])
    value, low, high, seeds = mean_interval(slopes, level)
    return Slope(value, low, high, seeds, _slope_verdict(low, high))


def _slope_verdict(low: float, high: float) -> str:
    if math.isnan(low):
        return "unknown"
    if low <= -0.45 and high >= -0.55:
        return "monte carlo"
    if high < -0.55:
        return "steeper"
    return "flat" if low > -0.25 else "slower"


def monotone_fit(y: ArrayLike) -> Array:
    """The non-increasing sequence nearest to `y` in least squares: pool adjacent violators (Ayer et al. 1955)."""
    pools: list[tuple[float, int]] = []
    for value in np.asarray(y, np.float64):
        mean, size = float(value), 1
        while pools and pools[-1][0] < mean:
            before, count = pools.pop()
            mean, size = (mean * size + before * count) / (size + count), size + count
        pools.append((mean, size))
    return np.concatenate([np.full(size, mean) for mean, size in pools]) if pools else np.zeros(0)


def first_crossing(x: ArrayLike, error: ArrayLike, target: float) -> Crossing:
    """Where the monotone log-log fit of `error` over `x` first reaches `target`, by log-log interpolation.

    Points of infinite or NaN error count as infinitely bad. Nothing is extrapolated: see Crossing.
    """
    x, error = np.asarray(x, np.float64), np.asarray(error, np.float64)
    usable = np.isfinite(error) & (error > 0) & (x > 0)
    last = float(x.max(initial=0.0))
    if not usable.any():
        return Crossing(math.inf, "censored", last)
    log_x, fit, goal = np.log(x[usable]), monotone_fit(np.log(error[usable])), math.log(target)
    below = np.flatnonzero(fit <= goal)
    if below.size == 0:
        return Crossing(math.inf, "censored", last)
    at = int(below[0])
    if at == 0:
        return Crossing(float(x[usable][0]), "at_first", last)
    share = (fit[at - 1] - goal) / (fit[at - 1] - fit[at])
    return Crossing(float(math.exp(log_x[at - 1] + share * (log_x[at] - log_x[at - 1]))), "reached", last)
