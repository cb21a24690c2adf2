"""How fast errors fall over samples: the slope of an error curve, over samples that all contestants of a scene share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.statistics.intervals import mean_interval

Array = NDArray[np.float64]
NOISE_ERRORS = 3.0
"""A corrected error below this many of its standard errors is noise."""
CLEAR_ERRORS = 10.0
"""From this many standard errors on the noise of the reference is left out of account."""
MONTE_CARLO = -0.5
SLOPE_MARGIN = 0.05
FEWEST_CHECKPOINTS = 4
LEAST_FACTOR = 8.0
"""Checkpoints, and samples at the last over samples at the first, without which there is no slope."""


class Curve(NamedTuple):
    """One seed: after `samples` (n,) per pixel, rising, and `seconds` (n,) the mean squared `error` (n,) was left.

    `se` (n,): standard error of `error` by the noise of the reference; NaN where it is not known. `smooth`: whether the
    sampler's error falls smoothly (independent samples), or is small after whole patterns only. `reproducible`: whether a
    repetition with the same seed gives the same errors at the same samples.
    """

    samples: Array
    seconds: Array
    error: Array
    se: Array
    smooth: bool = False
    reproducible: bool = False


class Slope(NamedTuple):
    """d ln(RMSE) / d ln(samples) with its interval over seeds, and what it means: see `convergence_slope`.

    `first`, `last`: samples per pixel between which it was fitted, 0 without a fit.
    """

    value: float
    low: float
    high: float
    seeds: int
    verdict: str
    first: int
    last: int


def curve(
    samples: ArrayLike,
    seconds: ArrayLike,
    error: ArrayLike,
    se: ArrayLike | None = None,
    *,
    smooth: bool = False,
    reproducible: bool = False,
) -> Curve:
    """A Curve of float arrays sorted by samples; without `se` the reference has no noise."""
    x, y, e = (np.asarray(values, np.float64) for values in (samples, seconds, error))
    noise = np.zeros_like(x) if se is None else np.asarray(se, np.float64)
    order = np.argsort(x, kind="stable")
    return Curve(x[order], y[order], e[order], noise[order], smooth, reproducible)


def clear_samples(seeds: Sequence[Curve]) -> Array:
    """The samples at which every seed of a contestant has a checkpoint whose error stands 10 standard errors above zero."""
    clear = [set(each.samples[(each.error > 0) & (each.error >= CLEAR_ERRORS * each.se)]) for each in seeds]
    return np.array(sorted(set.intersection(*clear)) if clear else [], np.float64)


def common_samples(contestants: Sequence[Sequence[Curve]]) -> Array:
    """The samples over which the slopes of a scene's contestants, each a list of seeds, are fitted and can be compared.

    Those that all contestants have: at least 4 checkpoints that span a factor of 8. A contestant with less than that does not
    count, so that it takes nothing from the others. Where the rest have too little in common, the one with the fewest does
    not count either. Empty where there is no such range.
    """
    sets = sorted((set(clear_samples(seeds)) for seeds in contestants), key=len)
    while sets := [own for own in sets if spans_enough(own)]:
        if spans_enough(common := set.intersection(*sets)):
            return np.array(sorted(common))
        sets = sets[1:]
    return np.zeros(0)


def spans_enough(samples: set[float]) -> bool:
    """Whether there are enough checkpoints, far enough apart, for a slope."""
    return len(samples) >= FEWEST_CHECKPOINTS and max(samples) >= LEAST_FACTOR * min(samples)


def convergence_slope(seeds: Sequence[Curve], samples: ArrayLike) -> Slope:
    """Slope of ln(RMSE) over ln(samples) at the checkpoints `samples` (see `common_samples`): a line a seed.

    Then mean and Student's t interval over seeds. Checkpoints of one seed share samples, hence are correlated: only seeds
    count as replicates. Verdict: `monte carlo` where the interval lies within -0.5 ± 0.05; else `steeper` or `shallower`
    where it excludes -0.5; else, and for a contestant that lacks one of the checkpoints, `unknown`.
    """
    at = np.asarray(samples, np.float64)
    if not seeds or not spans_enough(set(at)) or not set(at) <= set(clear_samples(seeds)):
        return Slope(math.nan, math.nan, math.nan, 0, "unknown", 0, 0)
    x = np.log(at) - np.log(at).mean()
    lever = x / (x**2).sum() / 2
    slopes = [float(lever @ np.log(each.error[np.searchsorted(each.samples, at)])) for each in seeds]
    value, low, high, count = mean_interval(slopes)
    return Slope(value, low, high, count, _slope_verdict(low, high), int(at[0]), int(at[-1]))


def _slope_verdict(low: float, high: float) -> str:
    if low >= MONTE_CARLO - SLOPE_MARGIN and high <= MONTE_CARLO + SLOPE_MARGIN:
        return "monte carlo"
    return "steeper" if high < MONTE_CARLO else "shallower" if low > MONTE_CARLO else "unknown"
