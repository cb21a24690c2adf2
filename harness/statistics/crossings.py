"""Where an error curve reaches a target: interpolated where the error falls smoothly, else at a measured checkpoint.

The two readings differ because samplers do. The error of independent samples falls smoothly, and every checkpoint is one more
measurement of one curve. The error of patterned and low-discrepancy samplers is small after whole patterns (powers of two
for Sobol points) and larger between them: nothing may be concluded from a checkpoint about its neighbours.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Reading = Literal["interpolated", "first"]


class Bound(NamedTuple):
    """A value that is known (`low` equals `high`), or known to lie between `low` and `high`."""

    low: float
    high: float


class Crossing(NamedTuple):
    """When a curve reaches a target.

    `state` is `reached`, `at_first` (at or before the first checkpoint, so `x` is (0, first]) or `censored` (not by the last
    one: `x` is [last, inf)). `noise` is the relative standard error of the error where this was decided: NaN where it is not
    known, infinite where the error is no larger than 0.
    """

    x: Bound
    state: str
    noise: float


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


def find_crossing(x: ArrayLike, error: ArrayLike, se: ArrayLike, target: float, reading: Reading) -> Crossing:
    """Where `error` (n,), with standard error `se` (n,), reaches `target` over the rising `x` (n,), samples or seconds.

    `first`: the first checkpoint whose error is no larger than the target, as it was measured. `interpolated`: where the
    monotone fit of ln(error) is, linear in ln(x) between checkpoints. An error no larger than 0, which noise alone can make,
    has no logarithm: the crossing then lies somewhere between its checkpoint and the one before. NaN and infinite errors
    reach no target. Nothing is extrapolated.
    """
    x, error, se = (np.asarray(values, np.float64) for values in (x, error, se))
    if x.size == 0:
        return Crossing(Bound(0.0, math.inf), "censored", 0.0)
    found = _first(x, error, se, target) if reading == "first" else _interpolated(x, error, se, target)
    return found or Crossing(Bound(float(x[-1]), math.inf), "censored", _relative(error[-1], se[-1]))


def _first(x: Array, error: Array, se: Array, target: float) -> Crossing | None:
    below = np.flatnonzero(error <= target)
    if below.size == 0:
        return None
    at = int(below[0])
    here = float(x[at])
    return Crossing(Bound(here if at else 0.0, here), "reached" if at else "at_first", _relative(error[at], se[at]))


def _interpolated(x: Array, error: Array, se: Array, target: float) -> Crossing | None:
    known = np.flatnonzero(np.isfinite(error) & (error > 0) & (x > 0))
    fit = monotone_fit(np.log(error[known]))
    below = np.flatnonzero(fit <= math.log(target))
    nothing_left = np.flatnonzero(error <= 0)
    if nothing_left.size and (below.size == 0 or nothing_left[0] < known[below[0]]):
        at = int(nothing_left[0])
        between = Bound(float(x[at - 1]) if at else 0.0, float(x[at]))
        return Crossing(between, "reached" if at else "at_first", math.inf)
    if below.size == 0:
        return None
    at = int(below[0])
    here, relative = x[known], [_relative(error[i], se[i]) for i in known]
    if at == 0:
        return Crossing(Bound(0.0, float(here[0])), "at_first", relative[0])
    share = float((fit[at - 1] - math.log(target)) / (fit[at - 1] - fit[at]))
    crossing = float(here[at - 1] ** (1 - share) * here[at] ** share)
    return Crossing(Bound(crossing, crossing), "reached", (1 - share) * relative[at - 1] + share * relative[at])


def _relative(error: float, se: float) -> float:
    """Standard error over error."""
    if not math.isfinite(error):
        return math.nan
    return float(se / error) if error > 0 else math.inf
