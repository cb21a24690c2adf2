"""What is worth choosing: the Pareto front of time against error, and the share of targets reached over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def pareto_front(time_low: ArrayLike, time_high: ArrayLike, error_low: ArrayLike, error_high: ArrayLike) -> NDArray[np.bool_]:
    """(n,) bool: whether no other point is surely better in both time and error.

    A point is dominated only where another's upper bounds lie below its lower bounds in both: overlapping intervals
    decide nothing. Points with NaN bounds neither dominate nor are on the front.
    """
    t0, t1, e0, e1 = (np.asarray(bound, np.float64) for bound in (time_low, time_high, error_low, error_high))
    with np.errstate(invalid="ignore"):
        dominates = (t1[:, None] < t0[None, :]) & (e1[:, None] < e0[None, :])
    known = ~(np.isnan(t0) | np.isnan(t1) | np.isnan(e0) | np.isnan(e1))
    return known & ~dominates.any(axis=0)


def ecdf(seconds: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(times, share of all problems solved by then), as COCO's runtime distributions (Hansen et al. 2021).

    A problem is one target of one scene and seed; infinite times are problems never solved and stay in the denominator.
    """
    times = np.asarray(seconds, np.float64)
    solved = np.sort(times[np.isfinite(times)])
    return solved, np.arange(1, solved.size + 1) / max(times.size, 1)
