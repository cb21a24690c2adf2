"""How time falls with threads: speed-up, parallel efficiency and the serial fraction of Amdahl's law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from harness.statistics.intervals import NOTHING, Estimate, geometric_interval, mean_interval


class ParallelRow(NamedTuple):
    """T(base) / T(threads) with its interval over blocks; `efficiency` = speed-up x base / threads, 1 is ideal."""

    threads: int
    speedup: Estimate
    efficiency: Estimate


def parallel_speedups(seconds: Mapping[int, Mapping[int, float]]) -> list[ParallelRow]:
    """One row a thread count from `seconds[threads][block]`, paired by block against the smallest thread count."""
    base = min(seconds)
    rows = []
    for threads, times in sorted(seconds.items()):
        shared = sorted(times.keys() & seconds[base].keys())
        speedup = geometric_interval([seconds[base][block] / times[block] for block in shared])
        share = base / threads
        efficiency = Estimate(speedup.value * share, speedup.low * share, speedup.high * share, speedup.n)
        rows.append(ParallelRow(threads, speedup, efficiency))
    return rows


def serial_fraction(threads: ArrayLike, speedups: ArrayLike) -> float:
    """f of 1/S(p) = f + (1-f)/p (Amdahl 1967) by least squares on 1/S, clipped to [0, 1]; NaN without p > 1."""
    p, s = np.asarray(threads, np.float64), np.asarray(speedups, np.float64)
    lever, excess = 1 - 1 / p, 1 / s - 1 / p
    if not (lever > 0).any():
        return math.nan
    return float(np.clip((lever * excess).sum() / (lever**2).sum(), 0.0, 1.0))


def amdahl_fit(seconds: Mapping[int, Mapping[int, float]]) -> Estimate:
    """Serial fraction from `seconds[threads][block]`: the mean of a fit a block, over the blocks that all counts share.

    Needs one thread among the counts (p = 1 is the law's unit) and another count; else NaN. Student's interval from
    two blocks on, within [0, 1].
    """
    blocks = sorted(set.intersection(*(set(times) for times in seconds.values()))) if seconds else []
    counts = sorted(seconds)
    if len(counts) < 2 or counts[0] != 1 or not blocks:
        return NOTHING
    fits = [serial_fraction(counts, [seconds[1][block] / seconds[p][block] for p in counts]) for block in blocks]
    value, low, high, n = mean_interval(fits)
    return Estimate(value, float(np.clip(low, 0, 1)), float(np.clip(high, 0, 1)), n)
