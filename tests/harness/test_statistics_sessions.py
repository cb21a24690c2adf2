"""Changes between sessions whose truth is known: how often drift between sessions is taken for a change."""

import math

import numpy as np
import pytest

from harness.statistics import Change, change_of_errors, change_of_times, judge_changes
from harness.statistics.sessions import FEWEST_SESSIONS
from tests.chance import at_least, at_most

DRIFT, NOISE, BLOCKS, TRIALS = 0.05, 0.02, 5, 2000


def side(rng, sessions, drift, effect=0.0):
    """Seconds by session and block: a session's drift is the same in all of its blocks."""
    logs = effect + rng.normal(0, drift, (sessions, 1)) + rng.normal(0, NOISE, (sessions, BLOCKS))
    return np.exp(logs).tolist()


def share(before, after, drifts=(DRIFT, DRIFT), effect=0.0, seed=1):
    """Shares of trials with p <= 5 %, whatever `tested` says, and of 95 % intervals that hold the effect."""
    rng = np.random.default_rng(seed)
    found = [change_of_times(side(rng, before, drifts[0]), side(rng, after, drifts[1], effect)) for _ in range(TRIALS)]
    held = [low <= effect <= high for low, high in (change.interval() for change in found)]
    return np.mean([change.p <= 0.05 for change in found]), np.mean(held), found


def test_blocks_of_one_session_take_drift_for_a_change_so_that_nothing_is_concluded_from_them():
    """As independent sessions they would be called changed in most trials [68 % of 10,000 others]."""
    alarms, _, found = share(1, 1)
    assert alarms > 0.6
    assert {verdict for change in found[:50] for verdict in judge_changes([change])} == {"unresolved"}


@pytest.mark.parametrize(
    "before, after, drifts, rate",
    [
        (3, 3, (DRIFT, DRIFT), 0.05),
        (5, 5, (DRIFT, DRIFT), 0.05),
        (3, 8, (DRIFT, DRIFT), 0.06),
        (3, 8, (0.10, 0.02), 0.07),
        (5, 5, (0.10, 0.02), 0.06),
    ],
)
def test_sessions_as_replicates_keep_their_level(before, after, drifts, rate):
    """About 5 %: Welch's test is approximate [4.1, 4.6, 5.6, 6.5 and 5.3 % of 10,000 others]. A draw fails in 1 of 100,000."""
    alarms, covered, _ = share(before, after, drifts)
    assert alarms <= at_most(rate, TRIALS) and covered >= at_least(1 - rate, TRIALS)


def test_the_pooled_test_does_not_where_the_few_sessions_vary_more():
    """Why it is Welch's [27 % of 10,000 others]."""
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(TRIALS):
        few, many = ([np.mean(np.log(session)) for session in side(rng, n, drift)] for n, drift in ((3, 0.1), (8, 0.02)))
        pooled = (2 * np.var(few, ddof=1) + 7 * np.var(many, ddof=1)) / 9 * (1 / 3 + 1 / 8)
        alarms += abs(np.mean(few) - np.mean(many)) > 2.262 * math.sqrt(pooled)  # Student's 97.5 % point at 9 degrees
    assert alarms / TRIALS > 0.15


def test_a_table_of_unchanged_contestants_rarely_has_a_false_alarm():
    """Ten of them, all of whose sessions drift on their own: one table in twenty, at most (Holm) [3.3 %]."""
    rng = np.random.default_rng(2)
    alarms = 0
    for _ in range(400):
        found = judge_changes([change_of_times(side(rng, 4, DRIFT), side(rng, 4, DRIFT)) for _ in range(10)])
        alarms += bool({"rise", "fall"} & set(found))
    assert alarms / 400 <= at_most(0.05, 400)


def test_real_changes_are_found_and_small_ones_are_the_same():
    rng = np.random.default_rng(3)
    changes = [change_of_times(side(rng, 6, 0.005), side(rng, 6, 0.005, math.log(factor))) for factor in (1.3, 0.7, 1.01)]
    assert judge_changes(changes) == ["rise", "fall", "same"]


def test_there_are_at_least_three_sessions_a_side():
    rng = np.random.default_rng(4)
    for before, after in ((2, 5), (1, 3), (3, 2)):
        change = change_of_times(side(rng, before, 0.0), side(rng, after, 0.0, 1.0))
        assert not change.tested and change.sessions == (before, after) and judge_changes([change]) == ["unresolved"]
        assert change.interval()[0] > 0.9
    change = change_of_times([[1.0, math.nan], [], [2.0]], [[1.0, 1.0]])
    assert change.sessions == (2, 1) and math.isnan(change.interval()[0])
    assert math.isnan(change_of_times([[]], [[1.0]]).mean)
    assert change_of_times([[1.0]] * FEWEST_SESSIONS, [[2.0]] * FEWEST_SESSIONS).tested


def test_errors_are_compared_seed_by_seed_however_many_sessions_repeat_them():
    rng = np.random.default_rng(5)
    before = dict(enumerate(rng.lognormal(0, 0.5, 5).tolist()))
    worse = {seed: 1.2 * error for seed, error in before.items()}
    same, rise = (change_of_errors(before, after, (3, 3)) for after in (before, worse))
    assert judge_changes([same, rise]) == ["same", "rise"]
    assert np.allclose(same.interval(), 0, atol=1e-6) and np.allclose(rise.interval(), math.log(1.2), atol=1e-6)
    elsewhere = {100 + seed: error for seed, error in worse.items()}
    assert judge_changes([change_of_errors(before, elsewhere, (1, 1))]) == ["unresolved"]
    assert not change_of_errors(before, {}, (1, 1)).tested


def test_same_comes_before_a_difference_and_what_is_not_tested_takes_no_part():
    small, large = Change(0.03, 0.005, 8.0, (5, 5), True), Change(0.5, 0.01, 4.0, (3, 3), True)
    untested = [Change(0.9, 1e-3, 4.0, (1, 1), False)] * 50
    assert judge_changes([small, large, *untested]) == ["same", "rise", *["unresolved"] * 50]
    assert judge_changes([small], margin=0.01) == ["rise"] and judge_changes([]) == []
