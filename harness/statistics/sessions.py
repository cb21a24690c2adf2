"""What changed between two sides, each measured in one or more sessions.

A machine is another one from session to session: its clock, its memory's layout and what else is loaded differ, and stay the
same for all blocks of a session. Blocks therefore are no replicates of a session. With three or more a side the sessions are:
each gives one mean, and the two sides are compared with Welch's test on these (Kalibera and Jones 2013, "Rigorous
benchmarking in reasonable time", whose top level this is). Welch's and not the pooled test, for the variance between sessions
may change with the code, and numbers of sessions differ: where few sessions vary much the pooled one is wrong too often.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit  # Student's distribution; scipy.stats takes a second to import

from harness.statistics.intervals import LEVEL
from harness.statistics.ratios import ALPHA, FEWEST_BLOCKS, LEAST_ERROR, MARGIN, PersistentSpread, holm

FEWEST_SESSIONS = 3
"""Sessions a side below which the drift between them is not separated from a change."""
ROUNDING = 1e-9
"""Least standard error of a mean log ratio of errors, of which seeds decide all but the rounding."""


class Change(NamedTuple):
    """Mean ln(after / before), its standard error and degrees of freedom; NaN where there is too little to say.

    `sessions`: of either side. `tested`: whether the error holds all that varies, so that there is a verdict; without it the
    error is that within sessions.
    """

    mean: float
    error: float
    freedom: float
    sessions: tuple[int, int]
    tested: bool

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """The ends of the interval of the mean."""
        half = float(stdtrit(self.freedom, (1 + level) / 2)) * self.error
        return self.mean - half, self.mean + half

    @property
    def p(self) -> float:
        """Two-sided, of no change."""
        return float(2 * stdtr(self.freedom, -abs(self.mean) / self.error))


def change_of_times(before: Sequence[Sequence[float]], after: Sequence[Sequence[float]]) -> Change:
    """Of positive values by session and block. Values that are not positive and finite are left out, and so are empty sessions.

    The mean of a side is that of its sessions' means. Below `FEWEST_SESSIONS` the error is that of the blocks within them.
    """
    sides = [[logs for session in side if (logs := _logs(session)).size] for side in (before, after)]
    counts = len(sides[0]), len(sides[1])
    if 0 in counts:
        return Change(math.nan, math.nan, math.nan, counts, False)
    means = [np.array([logs.mean() for logs in side]) for side in sides]
    tested = min(counts) >= FEWEST_SESSIONS
    if tested:
        shares = [(each.var(ddof=1) / each.size, each.size - 1) for each in means]
    else:
        shares = [_within(logs, len(side)) for side in sides for logs in side]
    return _change(float(means[1].mean() - means[0].mean()), shares, counts, tested)


def change_of_pairs(sessions: Sequence[Sequence[tuple[float, float]]], spreads: Sequence[PersistentSpread]) -> Change:
    """Of positive values (before, after) that were measured in one block of one session, by session, each of a machine with
    the persistent spread of `spreads`. Pairs with a value that is not positive and finite are left out, and so are empty
    sessions.

    What stays the same in a session cancels. The sessions are the replicates; below `FEWEST_SESSIONS` the blocks are, and the
    persistent spread adds its variance, whole: the layout of a build's memory may be the same in each session.
    """
    good = [[pair for pair in session if all(value > 0 and math.isfinite(value) for value in pair)] for session in sessions]
    found = [
        (np.log([after / before for before, after in session]), spread)
        for session, spread in zip(good, spreads, strict=True)
        if session
    ]
    counts = len(found), len(found)
    if not found:
        return Change(math.nan, math.nan, math.nan, counts, False)
    means = np.array([logs.mean() for logs, _ in found])
    mean = float(means.mean())
    if len(found) >= FEWEST_SESSIONS:
        return _change(mean, [(float(means.var(ddof=1)) / means.size, means.size - 1)], counts, True)
    tested = all(logs.size >= FEWEST_BLOCKS and not math.isnan(spread.variance) for logs, spread in found)
    blocks = _change(mean, [_within(logs, len(found)) for logs, _ in found], counts, tested)
    persistent = [(spread.variance / len(found), spread.freedom) for _, spread in found if spread.variance > 0]
    return _change(mean, [(blocks.error**2, blocks.freedom), *persistent], counts, tested) if persistent else blocks


def change_of_errors(before: Mapping[int, float], after: Mapping[int, float], sessions: tuple[int, int]) -> Change:
    """Of positive values by seed. Seeds decide errors, not sessions: seeds are the replicates, in pairs where both sides have
    three or more in common."""
    ours, theirs = ({seed: x for seed, x in side.items() if x > 0 and math.isfinite(x)} for side in (before, after))
    shared = sorted(ours.keys() & theirs.keys())
    if len(shared) >= FEWEST_BLOCKS:
        logs = _logs([theirs[seed] for seed in shared]) - _logs([ours[seed] for seed in shared])
        return _change(float(logs.mean()), [_within(logs, 1)], sessions, True, ROUNDING)
    if min(len(ours), len(theirs)) < FEWEST_BLOCKS:
        return Change(math.nan, math.nan, math.nan, sessions, False)
    sides = [_logs(list(side.values())) for side in (ours, theirs)]
    return _change(float(sides[1].mean() - sides[0].mean()), [_within(logs, 1) for logs in sides], sessions, True, ROUNDING)


def judge_changes(changes: Sequence[Change], margin: float = MARGIN) -> list[str]:
    """`rise`, `fall`, `same` or `unresolved` for each.

    `rise` and `fall` hold together at 5 % (Holm 1979). `same` precedes them: the 90 % interval lies within ±ln(1 + `margin`).
    What is not tested is unresolved.
    """
    tested = np.array([change.tested for change in changes], np.bool_)
    p = holm(np.array([change.p for change in changes], np.float64), tested)
    found = []
    for change, adjusted in zip(changes, p.tolist(), strict=True):
        low, high = change.interval(1 - 2 * ALPHA)
        if not change.tested:
            found.append("unresolved")
        elif -math.log1p(margin) < low and high < math.log1p(margin):
            found.append("same")
        else:
            found.append("unresolved" if not adjusted <= ALPHA else "rise" if change.mean > 0 else "fall")
    return found


def _logs(values: Sequence[float]) -> NDArray[np.float64]:
    return np.log([value for value in values if value > 0 and math.isfinite(value)])


def _within(logs: NDArray[np.float64], sessions: int) -> tuple[float, float]:
    """The variance that a session's blocks leave in the mean of so many sessions, and its degrees of freedom."""
    if logs.size < 2:
        return math.nan, 1
    return float(logs.var(ddof=1)) / logs.size / sessions**2, logs.size - 1


def _change(
    mean: float, shares: Sequence[tuple[float, float]], sessions: tuple[int, int], tested: bool, least: float = LEAST_ERROR
) -> Change:
    """With the degrees of freedom of a sum of variances (Welch 1947, Satterthwaite 1946)."""
    variance = sum(share for share, _ in shares)
    spread = sum(share**2 / freedom for share, freedom in shares)
    freedom = variance**2 / spread if spread > 0 else float(min(freedom for _, freedom in shares))
    return Change(mean, max(math.sqrt(variance), least) if variance >= 0 else math.nan, freedom, sessions, tested)
