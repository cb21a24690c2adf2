"""Who is faster, by how much, and how sure that is: the ratios, verdicts and possible winners of one race.

A race is a scene and a target. Its contestants are rows of ln seconds, its blocks columns; a time of which only bounds are
known has two ends. Every pair is tested on its paired differences with Student's t, each test on the bounds least favourable
to what it claims. The variance of a pair is moderated by that of the whole race (Smyth 2004, "Linear models and empirical
Bayes methods", with the weight of the race capped). Added to it is the variance of what differs between two equal contestants
in all blocks alike, which A/A twins tell: see `persistent_spread`.
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
MARGIN = 0.05
"""Contestants whose times surely differ by less than this share are the same."""
FEWEST_BLOCKS = 3
"""Blocks below which no verdict is given."""
LEAST_ERROR = 0.005
"""Least standard error of a mean log ratio: a few blocks may agree by chance."""
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
    """`ratios` of the pairs asked for, and (k,) whether a contestant may be the fastest."""

    ratios: list[Ratio]
    possible_winner: Mask


class TwinPair(NamedTuple):
    """A twin beside its original: the mean over blocks of their ln ratio, and its standard error from the blocks, moderated."""

    difference: float
    error: float


class PersistentSpread(NamedTuple):
    """What differs between two equal contestants in all blocks alike, from a number of twins. `variance` of the mean ln ratio,
    beyond what `noise`, the mean squared standard error of the twins, explains; NaN without twins."""

    variance: float
    twins: int
    noise: float

    @property
    def share(self) -> float:
        """One standard deviation as a share: 0.03 for 3 %; NaN without twins."""
        return math.expm1(math.sqrt(self.variance))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of a positive `variance` V (Satterthwaite 1946). Of its own variance, (V + noise)^2 / m, only what
        V adds to that of noise alone counts: at V = 0 the blocks decide."""
        return self.twins * self.variance / (self.variance + 2 * self.noise)


UNKNOWN_SPREAD = PersistentSpread(math.nan, 0, math.nan)
NO_SPREAD = PersistentSpread(0.0, 0, 0.0)
"""Of measures that a computer repeats exactly."""


def persistent_spread(pairs: Sequence[TwinPair]) -> PersistentSpread:
    """The variance component of all twins of one machine: max(0, mean difference^2 - mean error^2). `UNKNOWN_SPREAD` without
    twins."""
    if not pairs:
        return UNKNOWN_SPREAD
    differences, errors = np.array(pairs).T
    noise = float((errors**2).mean())
    return PersistentSpread(max(0.0, float((differences**2).mean()) - noise), len(pairs), noise)


class _Pairs(NamedTuple):
    """(r, k, k) arrays, r readings. Row i, column j: the least mean by which ln seconds of i exceed those of j (-inf where a
    block has no bound), its standard error and degrees of freedom; (k, k) `blocks` that both have."""

    excess: Array
    error: Array
    freedom: Array
    blocks: Rows

    def slower(self) -> Array:
        """One-sided p of "i is slower than j"; 1 below three blocks."""
        p = stdtr(self.freedom, -self.excess / self.error).max(axis=0)
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

    def spread_by(self, spread: PersistentSpread) -> _Pairs:
        """With the variance of the spread added to that of the blocks, and the degrees of freedom of the sum (Satterthwaite
        1946); as they are where the spread is unknown or 0."""
        if not spread.variance > 0:
            return self
        total = self.error**2 + spread.variance
        uncertain = spread.variance**2 / spread.freedom
        return self._replace(error=np.sqrt(total), freedom=total**2 / (self.error**4 / self.freedom + uncertain))


def race(
    low: Array,
    high: Array,
    compared: Sequence[tuple[int, int]],
    spread: PersistentSpread,
    *,
    ranked: Mask | None = None,
    clock: Array | float = 0.0,
    margin: float = MARGIN,
    readings: Sequence[tuple[Array, Array]] = (),
    mixed: Mask | None = None,
    pools: Rows | None = None,
) -> Race:
    """All ratios, verdicts and possible winners among k contestants in n blocks.

    `low`, `high`: (k, n) bounds of ln seconds: equal where measured, -inf and inf where there is none, NaN where a contestant
    was not measured in a block. `compared`: (contestant, baseline), pairs of rows. `spread`: that of the machine, see
    `persistent_spread`; where it is unknown, intervals hold the noise of blocks alone, and all is unresolved. `ranked`: (k,),
    the contestants of one division that may win; others, such as twins, take no part in corrections. `clock`: (k,), the
    clock's resolution over the seconds. `readings`: `low` and `high` as found in other ways, under which too a verdict has to
    hold between contestants that are `mixed` (k, k), of different kinds. `pools`: (k,) numbers; variances are moderated by
    those of contestants of one number, such as a scene's, by default of all.

    `faster` and `slower` hold together at 5 % for all pairs of ranked ones (Holm 1979). `same` precedes them: the 90 % interval
    lies within ±ln(1 + `margin`). A contestant may be the fastest if no one-sided test finds it slower than another, at 5 %
    over max(2, k - 1); none may where none reached the target.
    """
    rows = np.ones(len(low), np.bool_) if ranked is None else np.asarray(ranked, np.bool_)
    pools = np.zeros(len(low), np.int64) if pools is None else pools
    pairs = _pairs(low, high, rows, clock, pools)
    if mixed is not None:
        pairs = pairs.beside([_pairs(*bounds, rows, clock, pools) for bounds in readings], mixed)
    pairs = pairs.spread_by(spread)
    known = not math.isnan(spread.variance)
    p = pairs.slower() if known else np.ones(pairs.blocks.shape)
    found = _ratios(pairs, p, np.asarray(compared, np.int64).reshape(-1, 2), rows, margin, known)
    return Race(found, _possible_winners(p, high, rows))


def twin_pairs(
    low: Array, high: Array, twins: Sequence[tuple[int, int]], *, ranked: Mask | None = None, clock: Array | float = 0.0
) -> list[TwinPair]:
    """Of the twins of a race, (original, twin) rows, those that have three blocks with known times in common. The other
    arguments are as in `race`."""
    rows = np.ones(len(low), np.bool_) if ranked is None else np.asarray(ranked, np.bool_)
    pairs = _pairs(low, high, rows, clock, np.zeros(len(low), np.int64))
    found = []
    for original, twin in twins:
        least, most = pairs.excess[0, twin, original], -pairs.excess[0, original, twin]
        if pairs.blocks[twin, original] >= FEWEST_BLOCKS and math.isclose(least, most, abs_tol=1e-12):
            found.append(TwinPair(float(least), float(pairs.error[0, twin, original])))
    return found


def _pairs(low: Array, high: Array, ranked: Mask, clock: Array | float, pools: Rows) -> _Pairs:
    """Variance of a pair: (2 D s^2 + (n - 1) s_ij^2) / (D + n - 1), s^2 being the residual mean square of contestant + block
    in their pool; D is 0 between pools. Of two known bounds the middle counts: how wide they are is no scatter of blocks."""
    present = ~np.isnan(low)
    both = present[:, None] & present[None, :]
    blocks = both.sum(axis=2)
    differences = np.where(both, low[:, None] - high[None, :], 0.0)
    excess = differences.sum(axis=2) / np.maximum(blocks, 1)
    known = np.isfinite(low) & np.isfinite(high)
    middle = np.where(known, (low + np.where(known, high, 0.0)) / 2, 0.0)
    scattered = np.where(known[:, None] & known[None, :], middle[:, None] - middle[None, :], differences)
    counted = both & np.isfinite(scattered)
    centre = np.where(counted, scattered, 0.0).sum(axis=2) / np.maximum(counted.sum(axis=2), 1)
    squares = (np.where(counted, scattered - centre[..., None], 0.0) ** 2).sum(axis=2)
    pooled, weight = np.zeros(blocks.shape), np.zeros(blocks.shape)
    for pool in np.unique(pools):
        own = np.flatnonzero(pools == pool)
        some = ~np.isnan(low[own]).all(axis=0)
        moderation = _pooled(low[own][:, some], high[own][:, some], ranked[own])
        pooled[np.ix_(own, own)], weight[np.ix_(own, own)] = moderation
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


def _ratios(pairs: _Pairs, p: Array, compared: Rows, ranked: Mask, margin: float, known: bool) -> list[Ratio]:
    of, base = compared.T
    least, most, blocks = pairs.excess[0, base, of], -pairs.excess[0, of, base], pairs.blocks[of, base]
    ends, inner = ((pairs.least(level, base, of), -pairs.least(level, of, base)) for level in (LEVEL, 1 - 2 * ALPHA))
    sure = holm(np.minimum(2 * np.minimum(p[base, of], p[of, base]), 1.0), ranked[of] & ranked[base]) <= ALPHA
    verdicts = np.where(sure, np.where(p[base, of] < p[of, base], "faster", "slower"), "unresolved")
    verdicts[(inner[0] > -math.log1p(margin)) & (inner[1] < math.log1p(margin))] = "same"
    verdicts[(blocks < FEWEST_BLOCKS) | (not known)] = "unresolved"
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


def _possible_winners(p: Array, high: Array, ranked: Mask) -> Mask:
    if not np.isfinite(high[ranked]).any():
        return np.zeros_like(ranked)
    slower = (p <= ALPHA / max(2, int(ranked.sum()) - 1)) & ranked
    return ranked & ~slower.any(axis=1)


def _between(least: float, most: float) -> float:
    """A value for what lies between two bounds: an end where the other is unknown, the middle where both are known."""
    if math.isinf(least) and math.isinf(most):
        return math.nan
    return least if math.isinf(least) else most if math.isinf(most) else (least + most) / 2
