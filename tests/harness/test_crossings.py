"""Crossings, times to quality and slopes, on error curves whose truth is known: independent samples, and points that are good
at powers of two."""

import math

import numpy as np
import pytest

from harness.report.tables.model import reached_text
from harness.statistics import (
    Bound,
    common_samples,
    convergence_slope,
    crossing_seconds,
    curve,
    find_crossing,
    geometric_interval,
    reading_of,
    time_to_quality,
)
from harness.statistics.crossings import monotone_fit

CHECKPOINTS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256])
EXACT = np.zeros(CHECKPOINTS.size)
DENSE = np.arange(1, 257)


def independent(rng, pixels=400):
    """Errors at the checkpoints of an image of independent samples: n times them is chi-square over its pixels; they share
    the samples of the checkpoints before."""
    more = np.sqrt(np.diff(CHECKPOINTS, prepend=0))[:, None]
    sums = np.cumsum(more * rng.normal(0, 1, (CHECKPOINTS.size, pixels)), axis=0)
    return ((sums / CHECKPOINTS[:, None]) ** 2).mean(axis=1)


def sobol_like(exponent):
    """Errors (256,) of points that are good at powers of two, where the error is n^-exponent.

    The first n points are one net for every binary digit of n, each with its own independent error.
    """
    digits = 2.0 ** np.arange(9)
    parts = np.where(DENSE[:, None] & digits.astype(int), digits ** (2.0 - exponent), 0.0)
    return parts.sum(axis=1) / DENSE**2.0


def at_checkpoints(errors):
    return errors[CHECKPOINTS - 1]


# Crossings


def test_monotone_fit_is_the_least_squares_fit():
    """By its min-max formula: max over starts of min over ends of means, for falling fits with the roles swapped."""
    y = np.random.default_rng(6).normal(0, 1, 30) - np.arange(30) * 0.1
    oracle = [min(max(y[i : j + 1].mean() for j in range(k, 30)) for i in range(k + 1)) for k in range(30)]
    assert monotone_fit(y) == pytest.approx(oracle)


def test_the_crossing_of_a_power_law_is_exact():
    seconds = np.array([0.1, 0.3, 0.9, 2.7])
    crossing = find_crossing(seconds, 2.0 / seconds, np.zeros(4), 5.0, "interpolated")
    assert crossing.state == "reached" and crossing.x == pytest.approx((0.4, 0.4))
    assert find_crossing(seconds, 2.0 / seconds, np.zeros(4), 5.0, "first").x == (0.9, 0.9)


@pytest.mark.parametrize("reading", ["interpolated", "first"])
def test_nothing_is_extrapolated(reading):
    seconds = np.array([1.0, 2.0, 4.0])
    late, early = (find_crossing(seconds, 1 / seconds, np.zeros(3), target, reading) for target in (0.1, 7.0))
    assert late == (Bound(4.0, math.inf), "censored", 0.0) and early == (Bound(0.0, 1.0), "at_first", 0.0)


def test_bad_points_never_reach_a_target():
    for reading in ("interpolated", "first"):
        assert find_crossing([1, 2], [math.nan, math.inf], [0, 0], 10.0, reading).x == (2.0, math.inf)
        assert find_crossing([], [], [], 1.0, reading).x == (0.0, math.inf)
    assert find_crossing([1, 2, 4], [1.0, math.inf, 0.25], [0, 0, 0], 0.5, "interpolated").x.low == pytest.approx(2.0)


def test_a_dip_of_independent_samples_is_pooled_with_its_successors():
    error = np.array([32, 16, 0.9, 12, 4, 2.0])
    assert find_crossing(2.0 ** np.arange(6), error, np.zeros(6), 1.0, "interpolated").state == "censored"
    assert find_crossing(2.0 ** np.arange(6), error, np.zeros(6), 1.0, "first").x == (4.0, 4.0)


def test_an_error_that_is_noise_gives_bounds_alone():
    found = find_crossing([1, 2, 4], [1.0, 0.1, -1e-5], [1e-3] * 3, 1e-4, "interpolated")
    assert found.x == (2.0, 4.0) and found.noise == math.inf
    assert find_crossing([1, 2], [-1e-5, 1.0], [1e-3] * 2, 1e-4, "interpolated").x == (0.0, 1.0)


def test_crossings_of_independent_samples_are_the_truth():
    """The expected error is 1/n. Over 60 seeds the mean interpolated crossing is within 0.95 to 1.05 of it at every target;
    single ones within 0.89 to 1.16 in nine of ten. The first checkpoint alone lies up to a third above it."""
    rng = np.random.default_rng(1)
    curves = [independent(rng) for _ in range(60)]
    mean = {"interpolated": [], "first": []}
    inside = []
    for truth in (5.0, 10.0, 28.0, 70.0, 110.0):
        for reading, means in mean.items():
            ratios = [find_crossing(CHECKPOINTS, e, EXACT, 1 / truth, reading).x.high / truth for e in curves]
            means.append(np.exp(np.mean(np.log(ratios))))
            inside += [0.89 < ratio < 1.16 for ratio in ratios] if reading == "interpolated" else []
    assert min(mean["interpolated"]) > 0.95 and max(mean["interpolated"]) < 1.05 and np.mean(inside) > 0.9
    assert max(mean["first"]) > 1.12


@pytest.mark.parametrize("exponent", [1.7, 3.0])
def test_crossings_of_patterned_samplers_are_the_first_samples_that_do(exponent):
    """The truth is the first of all sample counts whose error is no larger than the target: the checkpoints hold it, ratio
    1.00. Interpolation gives 0.67 to 1.53 of it, and the first checkpoint from which on the target holds for good up to 2."""
    errors = sobol_like(exponent)
    log_x, log_e = np.log(CHECKPOINTS), np.log(at_checkpoints(errors))
    worse = np.exp(np.log(errors) - np.interp(np.log(DENSE), log_x, log_e))
    assert worse.max() > 2
    ratios, interpolated, for_good = [], [], []
    for target in np.geomspace(errors[1], errors.min() * 1.01, 200):
        truth = DENSE[np.argmax(errors <= target)]
        ratios.append(find_crossing(CHECKPOINTS, at_checkpoints(errors), EXACT, target, "first").x.high / truth)
        interpolated.append(find_crossing(CHECKPOINTS, at_checkpoints(errors), EXACT, target, "interpolated").x.high / truth)
        after = CHECKPOINTS[1 + np.flatnonzero(at_checkpoints(errors) > target)[-1] :]
        for_good.append(after[0] / truth)
    assert min(ratios) == 1.0 and np.mean(ratios) == pytest.approx(1.0, abs=0.005)
    assert min(interpolated) < 0.78
    assert exponent < 3 or (max(interpolated) > 1.5 and max(for_good) == 2.0)


# Time to quality


def seeds_curves(rng, seeds=5, **kind):
    return [curve(CHECKPOINTS, 0.01 * CHECKPOINTS, rng.lognormal(0, 0.1) / CHECKPOINTS, **kind) for _ in range(seeds)]


def crossings_of(curves, target, reading=None):
    """The crossings of a contestant's seeds, by its own reading or another one."""
    return [crossing_seconds(each, target, reading or reading_of(curves)) for each in curves]


def test_a_contestant_is_read_as_its_sampler_is():
    smooth, patterned = (seeds_curves(np.random.default_rng(1), smooth=kind) for kind in (True, False))
    own = [crossings_of(curves, 0.1) for curves in (smooth, patterned)]
    assert [reading_of(curves) for curves in (smooth, patterned)] == ["interpolated", "first"]
    assert crossings_of(smooth, 0.1, "first") == own[1] != own[0]
    assert crossings_of(patterned, 0.1, "interpolated") == own[0]


def test_reproducible_errors_take_the_noise_of_single_passes_out_of_times():
    """Passes are the noisier the shorter they are: seconds by the clock spread more than twice as much as samples at a rate."""
    rng = np.random.default_rng(4)
    spread = {}
    for reproducible in (False, True):
        times = []
        for _ in range(200):
            passes = np.diff(CHECKPOINTS, prepend=0)
            seconds = np.cumsum(rng.gamma(6.0 * passes) / 6.0)
            cell = curve(CHECKPOINTS, seconds, 1.0 / CHECKPOINTS, smooth=True, reproducible=reproducible)
            times.append(crossing_seconds(cell, 0.2).x.low)
        spread[reproducible] = np.std(np.log(times))
        assert np.mean(times) == pytest.approx(5.0, rel=0.05)
    assert spread[True] < 0.04 and spread[False] > 2 * spread[True]


def test_cold_time_adds_what_came_before_the_first_ray():
    curves = seeds_curves(np.random.default_rng(1), smooth=True, reproducible=True)
    found = crossings_of(curves, 0.1)
    warm, cold = (time_to_quality(found, fixed) for fixed in ([], [2.0] * 5))
    expected = geometric_interval([2.0 + crossing.x.low for crossing in found])
    assert cold[:3] == pytest.approx(expected[:3]) and cold[3:] == warm[3:] and warm.seconds < cold.seconds - 1.9


def test_what_was_not_reached_stays_a_bound():
    """Two that fell short after 2 s, one that failed after 1 s, one that failed at once, one that was there at first."""
    curves = [curve([1, 2], [1, 2], [1, 0.5])] * 2 + [curve([1], [1], [1]), curve([], [], []), curve([1], [1], [0.1])]
    for reading in ("first", "interpolated"):
        each = crossings_of(curves, 0.1, reading)
        assert [one.x for one in each] == [(2, math.inf), (2, math.inf), (1, math.inf), (0, math.inf), (0, 1)]
        found = time_to_quality(each)
        assert reached_text(found) == "1/5 ≤" and (found.reached, found.at_first, found.seeds) == (1, 1, 5)
        assert found.seconds == math.inf


def test_a_time_is_reliable_where_its_error_stands_ten_standard_errors_above_zero():
    errors = 1.0 / CHECKPOINTS
    for noise, reliable in ((0.05, True), (0.099, True), (0.11, False), (math.nan, False)):
        for smooth in (True, False):
            cells = [curve(CHECKPOINTS, CHECKPOINTS, errors, noise * errors, smooth=smooth)] * 2
            reached, short = (time_to_quality(crossings_of(cells, target)) for target in (0.1, 1e-6))
            assert (reached.reached, reached.reliable) == (2, reliable)
            assert (short.reached, short.reliable) == (0, reliable)


def test_nothing_is_raised_by_the_noise_of_the_reference():
    """An error far below the noise holds the target, and is not reliable; formerly it counted as three standard errors."""
    cells = [curve([1, 2, 4], [1, 2, 4], [1, 1e-5, 1e-6], [1e-3] * 3)]
    (found,) = crossings_of(cells, 1e-4)
    assert found.x == (2, 2) and not time_to_quality([found]).reliable


@pytest.mark.parametrize("error", [math.nan, math.inf, 0.0, -1.0, 1e300, 5e-324])
@pytest.mark.parametrize("smooth", [True, False])
def test_numbers_at_the_ends_of_their_range_give_no_exception(error, smooth):
    with np.errstate(all="raise"):
        odd = curve([1, 2], [0.1, 0.2], [error, error], [error, error], smooth=smooth)
        quality = time_to_quality(crossings_of([odd, odd], 1e-3))
        assert quality.reached == (2 if error in (0.0, -1.0, 5e-324) else 0) and not quality.reliable
        assert convergence_slope([odd, odd], common_samples([[odd, odd]])).verdict == "unknown"


# Slopes


def seeds_of(errors, samples=CHECKPOINTS, se=0.0):
    return [curve(samples, samples, each, se * each) for each in errors]


@pytest.mark.parametrize(
    ("exponent", "verdict"), [(-0.5, "monte carlo"), (-0.9, "steeper"), (0.0, "shallower"), (-0.35, "shallower")]
)
def test_the_slope_of_rmse_is_found_and_named(exponent, verdict):
    rng = np.random.default_rng(5)
    curves = seeds_of([CHECKPOINTS ** (2 * exponent) * rng.lognormal(0, 0.03, CHECKPOINTS.size) for _ in range(5)])
    slope = convergence_slope(curves, CHECKPOINTS)
    assert slope.value == pytest.approx(exponent, abs=0.02) and slope.verdict == verdict
    assert (slope.seeds, slope.first, slope.last) == (5, 1, 256)


def test_slopes_of_independent_samples():
    """Of 200 races of five seeds the intervals cover -1/2 in at least 90 % (nominal 95 %), and at most 4 % call it steeper or
    shallower without being within the margin. Four in five are monte carlo."""
    rng = np.random.default_rng(11)
    slopes = [convergence_slope(seeds_of([independent(rng, 800) for _ in range(5)]), CHECKPOINTS) for _ in range(200)]
    verdicts = [slope.verdict for slope in slopes]
    assert np.mean([slope.low <= -0.5 <= slope.high for slope in slopes]) > 0.9
    assert (verdicts.count("steeper") + verdicts.count("shallower")) / 200 < 0.04
    assert verdicts.count("monte carlo") > 160


def test_a_wide_interval_is_unknown():
    """Three seeds of 20 pixels: formerly monte carlo wherever the interval held -1/2."""
    rng = np.random.default_rng(2)
    slope = convergence_slope(seeds_of([independent(rng, 20) for _ in range(3)]), CHECKPOINTS)
    assert slope.low < -0.55 and slope.high > -0.45 and slope.verdict == "unknown"


def test_one_estimator_has_one_slope_whoever_runs_it_for_longer():
    """The error bends from n^-1 to n^-2: fitted each over its own samples, the slopes are -0.63 and -0.76."""
    errors = (1.0 / CHECKPOINTS) / (1.0 + CHECKPOINTS / 16.0)
    rng = np.random.default_rng(3)
    noisy = [errors * rng.lognormal(0, 0.01) for _ in range(3)]
    slow, fast = seeds_of([e[:9] for e in noisy], CHECKPOINTS[:9]), seeds_of(noisy)
    apart = [convergence_slope(seeds, common_samples([seeds])).value for seeds in (slow, fast)]
    assert apart[0] - apart[1] > 0.1
    common = common_samples([slow, fast])
    assert common.tolist() == CHECKPOINTS[:9].tolist()
    assert convergence_slope(slow, common).value == convergence_slope(fast, common).value


def test_a_contestant_with_too_few_samples_is_left_out_and_takes_nothing_from_the_others():
    errors = [1.0 / CHECKPOINTS] * 3
    whole, short = seeds_of(errors), seeds_of([e[:5] for e in errors], CHECKPOINTS[:5])
    noise = np.where(CHECKPOINTS > 4, 1.0, 0.0)
    blind = [each._replace(se=noise) for each in seeds_of(errors)]
    common = common_samples([whole, short, blind])
    assert common.tolist() == CHECKPOINTS.tolist()
    assert convergence_slope(whole, common).verdict == "monte carlo"
    for left_out in (short, blind):
        slope = convergence_slope(left_out, common)
        assert slope.verdict == "unknown" and math.isnan(slope.value)
    assert common_samples([short]).size == 0 and common_samples([]).size == 0


def test_ranges_that_do_not_meet_leave_out_the_shorter_one():
    low, high = seeds_of([1.0 / CHECKPOINTS[:8]], CHECKPOINTS[:8]), seeds_of([1.0 / CHECKPOINTS[7:]], CHECKPOINTS[7:])
    assert common_samples([low, high]).tolist() == CHECKPOINTS[7:].tolist()


def test_a_slope_uses_only_errors_that_the_reference_resolves():
    error = np.maximum(1.0 / CHECKPOINTS, 1 / 16)
    se = np.where(CHECKPOINTS > 16, error / 9.0, error / 11.0)
    seeds = [curve(CHECKPOINTS, CHECKPOINTS, error, se)] * 2
    assert convergence_slope(seeds, common_samples([seeds])).value == pytest.approx(-0.5, abs=1e-9)
