"""Speed-ups between two configurations, paired by block, and the noise floor under which nothing is ranked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit  # Student's quantiles; scipy.stats takes a second to import

from harness.statistics.intervals import LEVEL, NOTHING, Estimate, mean_interval


class Speedup(NamedTuple):
    """`ratio` > 1: the other is faster than the baseline by that factor. `verdict`: faster, slower, tie or unknown."""

    ratio: float
    low: float
    high: float
    pairs: int
    verdict: str


def paired_speedup(baseline: Mapping[int, float], other: Mapping[int, float], floor: float = 0.0,
                   level: float = LEVEL) -> Speedup:  # fmt: skip
    """exp(mean of log(baseline / other)) over the blocks that both have, with Student's t interval on the logarithm.

    Times are seconds by block; a block's drift hits both and cancels. `floor` is the noise floor as a log-ratio: an
    interval that reaches into [-floor, floor] is a tie. Infinite times are censored: where one side of a pair is, the
    median and range of the log-ratios are given instead (coverage 1 - 2^(1-n)), and a verdict needs five pairs that
    agree. Blocks censored on both sides say nothing.
    """
    blocks = [b for b in sorted(set(baseline) & set(other)) if math.isfinite(baseline[b]) or math.isfinite(other[b])]
    if not blocks:
        return Speedup(math.nan, math.nan, math.nan, 0, "unknown")
    logs = np.array([_log_ratio(baseline[b], other[b]) for b in blocks])
    if np.isinf(logs).any():
        ordered = sorted(map(float, logs))
        low, high = ordered[0], ordered[-1]
        value = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2  # NaN between -inf and inf
        enough = logs.size >= 5
    else:
        value, low, high, _ = mean_interval(logs, level)
        enough = logs.size >= 2
    verdict = "unknown" if not enough else "faster" if low > floor else "slower" if high < -floor else "tie"
    return Speedup(_exp(value), _exp(low), _exp(high), len(blocks), verdict)


def unpaired_ratio(before: Sequence[float], after: Sequence[float], level: float = LEVEL) -> Estimate:
    """exp(mean log after - mean log before) with Welch's interval: for measurements that share no blocks.

    Values that are not positive and finite are left out; NaN below two on either side.
    """
    a, b = (np.log([value for value in values if value > 0 and math.isfinite(value)]) for values in (before, after))
    n = min(a.size, b.size)
    if n < 2:
        return NOTHING
    share_a, share_b = a.var(ddof=1) / a.size, b.var(ddof=1) / b.size
    se = math.sqrt(share_a + share_b)
    difference = float(b.mean() - a.mean())
    freedom = se**4 / (share_a**2 / (a.size - 1) + share_b**2 / (b.size - 1)) if se > 0 else 1.0
    half = float(stdtrit(freedom, (1 + level) / 2)) * se
    return Estimate(_exp(difference), _exp(difference - half), _exp(difference + half), n)


def noise_floor(first: Mapping[int, float], second: Mapping[int, float], level: float = LEVEL) -> float:
    """The largest log-ratio that an A/A twin (one cell under two labels) leaves open: max |bound| of its interval.

    NaN below two common blocks.
    """
    logs = np.array([_log_ratio(first[b], second[b]) for b in sorted(set(first) & set(second))])
    logs = logs[np.isfinite(logs)]
    if logs.size < 2:
        return math.nan
    half = stdtrit(logs.size - 1, (1 + level) / 2) * logs.std(ddof=1) / math.sqrt(logs.size)
    return float(abs(logs.mean()) + half)


def _log_ratio(baseline: float, other: float) -> float:
    if math.isinf(baseline) or math.isinf(other):
        return math.inf if math.isinf(baseline) else -math.inf
    return math.log(baseline) - math.log(other)


def _exp(value: float) -> float:
    return math.inf if value > 700 else math.exp(value)
