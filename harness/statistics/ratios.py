"""Who is faster, by how much, and how sure that is: the ratios, verdicts and possible winners of one race.

A race is a scene and a target. Its contestants are rows of ln seconds, its blocks columns; a time of which only bounds are
known has two ends. Every pair is tested on its paired differences with Student's t, each test on the bounds least favourable
to what it claims. The variance of a pair is moderated by that of the whole race (Smyth 2004, "Linear models and empirical
Bayes methods", with the weight of the race capped).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit  # Student's distribution; scipy.stats takes a second to import

from harness.statistics.intervals import LEVEL, exp

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.int64]

ALPHA = 0.05
"""Probability of a false verdict in a race: of a false `faster` or `slower` (Holm), and of a false single winner."""
TWINS_ALPHA = 0.01
"""Level at which A/A twins are separated; then nothing in their race is."""
MARGIN = 0.05
"""Contestants whose times surely differ by less than this share are the same."""
FEWEST_BLOCKS = 3
"""Blocks below which no verdict is given."""
LEAST_ERROR = 0.005
"""Least standard error of a mean log ratio: what stays the same from block to block is not seen in their spread."""
POOLED_FREEDOM = 4
"""Most degrees of freedom that the race's variance has in that of a pair."""


class Ratio(NamedTuple):
    """Seconds of the baseline over those of a contestant, with its 95 % interval over `blocks` pairs; above 1 is faster.

    Infinite: the baseline got nowhere, so that only `low` is known; 0: the contestant did not, only `high` is known;
    NaN: neither is. `verdict`: faster, slower, same or unresolved.
    """

    ratio: float
    low: float
    high: float
    blocks: int
    verdict: str


class Race(NamedTuple):
    """`ratios` of the pairs asked for, and (k,) whether a contestant may be the fastest.

    `twins_separated`: the A/A twins differ, so that nothing is concluded.
    """

    ratios: list[Ratio]
    possible_winner: Mask
    twins_separated: bool


class _Pairs(NamedTuple):
    """(r, k, k) arrays, r readings. Row i, column j: the least mean by which ln seconds of i exceed those of j (-inf where a
    block has no bound), its standard error and degrees of freedom; (k, k) `blocks` that both have."""

    excess: Array
    error: Array
    freedom: Array
    blocks: Rows

    def slower(self, floor: float) -> Array:
        """One-sided p of "i is slower than j by more than `floor`", a log ratio; 1 below three blocks, NaN with a NaN floor."""
        p = stdtr(self.freedom, (floor - self.excess) / self.error).max(axis=0)
        return np.where(self.blocks >= FEWEST_BLOCKS, p, 1.0)

    def least(self, level: float, i: Rows, j: Rows) -> Array:
        """Lower ends of the two-sided intervals of the excess of rows i over rows j."""
        half = stdtrit(self.freedom[:, i, j], (1 + level) / 2) * self.error[:, i, j]
        return (self.excess[:, i, j] - half).min(axis=0)

    def beside(self, others: Sequence[_Pairs], mixed: Mask) -> _Pairs:
        """With further readings of those pairs that are mixed."""

        def stacked(name: str) -> Array:
            own: Array = getattr(self, name)
            return np.concatenate([own, *(np.where(mixed, getattr(other, name), own) for other in others)])

        return _Pairs(stacked("excess"), stacked("error"), stacked("freedom"), self.blocks)


def race(
    low: Array,
    high: Array,
    compared: Sequence[tuple[int, int]],
    floor: float,
    *,
    ranked: Mask | None = None,
    twins: Sequence[tuple[int, int]] = (),
    clock: Array | float = 0.0,
    margin: float = MARGIN,
    readings: Sequence[tuple[Array, Array]] = (),
    mixed: Mask | None = None,
) -> Race:
    """All ratios, verdicts and possible winners among k contestants in n blocks.

    `low`, `high`: (k, n) bounds of ln seconds: equal where measured, -inf and inf where there is none, NaN where a contestant
    was not measured in a block. `compared`: (contestant, baseline), pairs of rows. `floor`: the noise floor as a log ratio, see
    `noise_floor`; NaN, where it was not measured, leaves all unresolved but what is the same. `ranked`: (k,), the
    contestants of one division that may win; others, such as twins, take no part in corrections. `twins`: pairs of
    rows. `clock`: (k,), the clock's resolution over the seconds. `readings`: `low` and `high` as found in other ways,
    under which too a verdict has to hold between contestants that are `mixed` (k, k), of different kinds.

    `faster` and `slower` hold together at 5 % for all pairs of ranked ones (Holm 1979), of differences beyond the floor. `same`
    precedes them: the 90 % interval lies within ±ln(1 + `margin`). A contestant may be the fastest if no one-sided
    test finds it slower than another, at 5 % over max(2, k - 1); none may where none reached the target.
    """
    rows = np.ones(len(low), np.bool_) if ranked is None else np.asarray(ranked, np.bool_)
    pairs = _pairs(low, high, rows, clock)
    if mixed is not None:
        pairs = pairs.beside([_pairs(*bounds, rows, clock) for bounds in readings], mixed)
    separated = _separated(pairs, twins)
    p = pairs.slower(floor)
    found = _ratios(pairs, p, np.asarray(compared, np.int64).reshape(-1, 2), rows, margin, separated)
    return Race(found, _possible_winners(p, high, rows, separated), separated)


def noise_floor(own: Sequence[float], all_twins: Sequence[float]) -> float:
    """The noise floor of a race from the |ln ratio| of its own twins and of all twins of the run; NaN without twins of its own.

    It is the largest of its own and the run's median, so that a pair which came out alike by luck gives no floor near 0.
    """
    known = [value for value in own if math.isfinite(value)]
    return max(*known, float(np.median([v for v in all_twins if math.isfinite(v)]))) if known else math.nan


def twin_distance(low: Array, high: Array, one: int, other: int) -> float:
    """|ln ratio| of two rows over the blocks that both have; NaN where some of their times are bounds."""
    exact = (low[[one, other]] == high[[one, other]]).all(axis=0)
    present = ~np.isnan(low[[one, other]]).any(axis=0)
    if not present.any() or not exact[present].all():
        return math.nan
    return abs(float((low[one] - low[other])[present].mean()))


def _pairs(low: Array, high: Array, ranked: Mask, clock: Array | float) -> _Pairs:
    """Variance of a pair: (2 D s^2 + (n - 1) s_ij^2) / (D + n - 1), s^2 being the residual mean square of contestant
    + block."""
    present = ~np.isnan(low)
    both = present[:, None] & present[None, :]
    blocks = both.sum(axis=2)
    differences = np.where(both, low[:, None] - high[None, :], 0.0)
    excess = differences.sum(axis=2) / np.maximum(blocks, 1)
    centre = np.where(np.isfinite(excess), excess, 0.0)[..., None]
    squares = (np.where(both & np.isfinite(differences), differences - centre, 0.0) ** 2).sum(axis=2)
    pooled, weight = _pooled(low, high, ranked)
    freedom = np.maximum(weight + blocks - 1.0, 1.0)
    error = np.sqrt((2 * weight * pooled + squares) / freedom / np.maximum(blocks, 1))
    steps = np.broadcast_to(np.asarray(clock, np.float64), len(low))
    least = np.maximum(LEAST_ERROR, np.maximum(steps[:, None], steps[None, :]))
    return _Pairs(np.where(blocks > 0, excess, -np.inf)[None], np.maximum(error, least)[None], freedom[None], blocks)


def _pooled(low: Array, high: Array, ranked: Mask) -> tuple[float, int]:
    """(residual mean square of contestant + block, its weight D) from the ranked whose times are known in every block."""
    rows = low[ranked & ((low == high) & np.isfinite(low)).all(axis=1)]
    k, n = rows.shape
    if k < 3 or n < 2:
        return 0.0, 0
    residuals = rows - rows.mean(axis=1, keepdims=True) - rows.mean(axis=0) + rows.mean()
    return float((residuals**2).sum() / ((k - 1) * (n - 1))), min(POOLED_FREEDOM, (k - 2) * (n - 1))


def _separated(pairs: _Pairs, twins: Sequence[tuple[int, int]]) -> bool:
    """Whether the times of some twins differ, by two-sided tests with Bonferroni's correction."""
    if not twins:
        return False
    i, j = np.array(twins).T
    least = np.maximum(pairs.least(1 - TWINS_ALPHA / len(twins), i, j), pairs.least(1 - TWINS_ALPHA / len(twins), j, i))
    return bool(((least > 0) & (pairs.blocks[i, j] >= FEWEST_BLOCKS)).any())


def _ratios(pairs: _Pairs, p: Array, compared: Rows, ranked: Mask, margin: float, separated: bool) -> list[Ratio]:
    of, base = compared.T
    least, most, blocks = pairs.excess[0, base, of], -pairs.excess[0, of, base], pairs.blocks[of, base]
    ends, inner = ((pairs.least(level, base, of), -pairs.least(level, of, base)) for level in (LEVEL, 1 - 2 * ALPHA))
    sure = holm(np.minimum(2 * np.minimum(p[base, of], p[of, base]), 1.0), ranked[of] & ranked[base]) <= ALPHA
    verdicts = np.where(sure, np.where(p[base, of] < p[of, base], "faster", "slower"), "unresolved")
    verdicts[(inner[0] > -math.log1p(margin)) & (inner[1] < math.log1p(margin))] = "same"
    verdicts[(blocks < FEWEST_BLOCKS) | separated] = "unresolved"
    ends = np.where(blocks > 1, ends, math.nan)
    return [
        Ratio(exp(_between(*bounds)), exp(low), exp(high), count, verdict)
        for *bounds, low, high, count, verdict in zip(
            least.tolist(), most.tolist(), *ends.tolist(), blocks.tolist(), verdicts.tolist(), strict=True
        )
    ]


def holm(p: Array, family: Mask) -> Array:
    """Adjusted p values (Holm 1979) of those in the family; others as they are. NaN stays NaN."""
    adjusted = p.copy()
    members = np.flatnonzero(family & ~np.isnan(p))
    order = members[np.argsort(p[members], kind="stable")]
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(order.size, 0, -1))
    return adjusted


def _possible_winners(p: Array, high: Array, ranked: Mask, separated: bool) -> Mask:
    if not np.isfinite(high[ranked]).any():
        return np.zeros_like(ranked)
    if separated:
        return ranked
    with np.errstate(invalid="ignore"):
        slower = (p <= ALPHA / max(2, int(ranked.sum()) - 1)) & ranked
    return ranked & ~slower.any(axis=1)


def _between(least: float, most: float) -> float:
    """A value for what lies between two bounds: an end where the other is unknown, the middle where both are known."""
    if math.isinf(least) and math.isinf(most):
        return math.nan
    return least if math.isinf(least) else most if math.isinf(most) else (least + most) / 2
