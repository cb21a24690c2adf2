"""How time falls with threads: speed-up, parallel efficiency and the serial fraction of Amdahl's law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from harness.statistics.comparison import paired_speedup
from harness.statistics.intervals import NOTHING, Estimate, resample_indices


class ParallelRow(NamedTuple):
    """T(base) / T(threads) with its interval over blocks; `efficiency` = speed-up x base / threads, 1 is ideal."""

    threads: int
    speedup: Estimate
    efficiency: Estimate


def parallel_speedups(seconds: Mapping[int, Mapping[int, float]]) -> list[ParallelRow]:
    """One row a thread count from `seconds[threads][block]`, paired by block against the smallest thread count."""
    base = min(seconds)
    rows = []
    for threads in sorted(seconds):
        ratio = paired_speedup(seconds[base], seconds[threads])
        estimate = Estimate(*ratio[:4]) if threads != base else Estimate(1.0, 1.0, 1.0, len(seconds[base]))
        share = base / threads
        efficiency = Estimate(estimate.value * share, estimate.low * share, estimate.high * share, estimate.n)
        rows.append(ParallelRow(threads, estimate, efficiency))
    return rows


def serial_fraction(threads: ArrayLike, speedups: ArrayLike) -> float:
    """f of 1/S(p) = f + (1-f)/p (Amdahl 1967) by least squares on 1/S, clipped to [0, 1]; NaN without p > 1."""
    p, s = np.asarray(threads, np.float64), np.asarray(speedups, np.float64)
    lever, excess = 1 - 1 / p, 1 / s - 1 / p
    if not (lever > 0).any():
        return math.nan
    return float(np.clip((lever * excess).sum() / (lever**2).sum(), 0.0, 1.0))


def amdahl_fit(seconds: Mapping[int, Mapping[int, float]]) -> Estimate:
    """Serial fraction from `seconds[threads][block]` with a bootstrap interval over the blocks that all counts share.

    Needs one thread among the counts (p = 1 is the law's unit), another count and two blocks; else NaN.
    """
    blocks = sorted(set.intersection(*(set(times) for times in seconds.values()))) if seconds else []
    counts = sorted(seconds)
    if len(counts) < 2 or counts[0] != 1 or not blocks:
        return NOTHING
    logs = np.log([[seconds[p][b] for b in blocks] for p in counts])
    fits = [_fit(counts, logs)]
    if len(blocks) > 1:
        fits += [_fit(counts, logs[:, chosen]) for chosen in resample_indices(len(blocks))[:500]]
    low, high = np.quantile(fits[1:], (0.025, 0.975)) if len(fits) > 1 else (math.nan, math.nan)
    return Estimate(fits[0], float(low), float(high), len(blocks))


def _fit(counts: list[int], logs: np.ndarray) -> float:
    """Serial fraction of geometric-mean times over blocks; `logs` is (counts, blocks)."""
    mean = logs.mean(axis=1)
    return serial_fraction(counts, np.exp(mean[0] - mean))
