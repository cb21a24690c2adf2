"""The estimators find a truth that is known, and their intervals cover it as often as they say."""

import math

import numpy as np
import pytest

from harness.metrics import Reference
from harness.statistics import (
    amdahl_fit,
    bias_estimate,
    convergence_slope,
    ecdf,
    efficiency,
    first_crossing,
    mean_interval,
    monotone_fit,
    on_bias_floor,
    parallel_speedups,
    pareto_front,
    reliable_errors,
    time_to_quality,
    too_good_per_sample,
)
from harness.statistics.convergence import curve

SPP = 2.0 ** np.arange(9)


def coverage(trial, trials):
    """Share of `trials` whose interval (low, high) holds the truth: trial(rng) -> (low, truth, high)."""
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(trials):
        low, truth, high = trial(rng)
        hits += low <= truth <= high
    return hits / trials


# Intervals


def test_the_mean_of_five_is_covered_as_promised():
    """Nominal 95 % over 600 normal samples; below 92 % has p < 1e-3."""

    def trial(rng):
        estimate = mean_interval(rng.normal(3, 2, 5))
        return estimate.low, 3, estimate.high

    assert coverage(trial, 600) > 0.92


def test_one_value_has_no_interval_and_none_is_nothing():
    assert mean_interval([4.0])[0] == 4 and math.isnan(mean_interval([4.0]).low)
    assert math.isnan(mean_interval([]).value) and mean_interval([math.nan]).n == 0


# Convergence


@pytest.mark.parametrize(
    ("exponent", "verdict"), [(-0.5, "monte carlo"), (-0.9, "steeper"), (0.0, "flat"), (-0.35, "slower")]
)
def test_the_slope_of_rmse_is_found_and_named(exponent, verdict):
    rng = np.random.default_rng(5)
    curves = [curve(SPP, SPP ** (2 * exponent) * rng.lognormal(0, 0.03, SPP.size)) for _ in range(5)]
    slope = convergence_slope(curves)
    assert slope.value == pytest.approx(exponent, abs=0.02) and slope.verdict == verdict and slope.seeds == 5


def test_slope_intervals_cover_although_checkpoints_share_samples():
    """Cumulative means of the same samples: nominal 95 % over 200 trials; below 90 % has p < 3e-3."""

    def trial(rng):
        curves = []
        for _ in range(5):
            sums = np.cumsum(rng.normal(0, 1, (400, 256)), axis=1)
            curves.append(curve(SPP, [((sums[:, int(n) - 1] / n) ** 2).mean() for n in SPP]))
        slope = convergence_slope(curves)
        return slope.low, -0.5, slope.high

    assert coverage(trial, 200) > 0.9


def test_the_slope_ignores_points_below_the_noise_of_the_reference():
    error = np.maximum(1 / SPP, 1 / 16)
    se = np.where(SPP > 16, 1.0, 1e-4)
    assert convergence_slope([curve(SPP, error, se)] * 2).value == pytest.approx(-0.5, abs=1e-9)


def test_monotone_fit_agrees_with_scikit_style_definition():
    """The least-squares optimum has zero residual sum in every pool and never rises; min-max formula as oracle."""
    y = np.random.default_rng(6).normal(0, 1, 30) - np.arange(30) * 0.1
    # max over starts of min over ends of means, for decreasing fits with the roles swapped
    oracle = [min(max(y[i : j + 1].mean() for j in range(k, 30)) for i in range(k + 1)) for k in range(30)]
    assert monotone_fit(y) == pytest.approx(oracle)


def test_the_crossing_of_a_power_law_is_exact():
    seconds = np.array([0.1, 0.3, 0.9, 2.7])
    crossing = first_crossing(seconds, 2.0 / seconds, 5.0)
    assert crossing.state == "reached" and crossing.x == pytest.approx(0.4)


def test_nothing_is_extrapolated():
    seconds = np.array([1.0, 2.0, 4.0])
    late, early = first_crossing(seconds, 1 / seconds, 0.1), first_crossing(seconds, 1 / seconds, 7.0)
    assert (late.x, late.state, late.last) == (math.inf, "censored", 4.0)
    assert (early.x, early.state) == (1.0, "at_first")


def test_bad_points_never_reach_a_target():
    assert first_crossing([1, 2], [math.nan, math.inf], 10.0).state == "censored"
    assert first_crossing([], [], 1.0).state == "censored"
    assert first_crossing([1, 2, 4], [1.0, math.inf, 0.25], 0.5).x == pytest.approx(2.0)


def test_a_lucky_dip_is_not_the_crossing():
    """One point far below the curve is pooled with its worse successors."""
    seconds, error = 2.0 ** np.arange(6), np.array([32, 16, 0.9, 12, 4, 2.0])
    assert first_crossing(seconds, error, 1.0).state == "censored"


# Time to quality


def seeds_curves(rng, sigma=0.1, seeds=5):
    return [curve(SPP * 0.01, rng.lognormal(0, sigma) / SPP, np.zeros_like(SPP)) for _ in range(seeds)]


def test_time_to_quality_covers_the_mean_seed():
    """Each seed's curve is 0.01 e / t, so the geometric mean of the crossings of 0.1 is at 0.1 s; nominal 95 %."""

    def trial(rng):
        quality = time_to_quality(seeds_curves(rng), [0.0] * 5, 0.1)
        return quality.low, 0.1, quality.high

    assert coverage(trial, 400) > 0.92


def test_cold_time_adds_what_came_before_the_first_ray():
    curves = seeds_curves(np.random.default_rng(1))
    warm, cold = (time_to_quality(curves, [fixed] * 5, 0.1) for fixed in (0.0, 2.0))
    assert [c.low - w.low for c, w in zip(cold.crossings, warm.crossings, strict=True)] == pytest.approx([2] * 5)


def test_unreached_seeds_are_counted_and_leave_a_lower_bound():
    curves = [curve([1, 2], [1, 0.5])] * 2 + [curve([1, 2], [1, 0.05])] * 3
    some = time_to_quality(curves, [0.0] * 5, 0.1)
    assert some.verdict() == "3/5" and some.value == some.high == math.inf and 0 < some.low < 2
    early = time_to_quality([curve([1, 2], [0.05, 0.01])] * 3, [0.0] * 3, 0.1)
    assert early.verdict() == "3/3 ≤" and (early.low, early.high) == (0, 1) and early.crossings[0] == (0, 1)


def test_a_target_under_the_reference_noise_is_not_reached_by_noise():
    assert reliable_errors([-0.1, 0.5], [0.01, 0.01]).tolist() == [0.03, 0.5]
    noisy = curve([1, 2, 4], [1, 1e-5, -1e-5], [1e-3] * 3)
    assert time_to_quality([noisy], [0.0], 1e-4).reached == 0 and time_to_quality([noisy], [0.0], 0.1).reached == 1


def test_efficiency_is_what_its_name_says():
    assert efficiency([0.1, 0.1, -1.0], [2, 2, 2]).value == pytest.approx(5)


# Threads


def amdahl_times(f, rng, sigma=0.01):
    return {p: {b: (f + (1 - f) / p) * rng.lognormal(0, sigma) for b in range(5)} for p in (1, 2, 4, 8)}


def test_amdahl_fraction_is_covered():
    """Nominal 95 % over 200 trials; below 90 % has p < 3e-3."""

    def trial(rng):
        fit = amdahl_fit(amdahl_times(0.1, rng))
        return fit.low, 0.1, fit.high

    assert coverage(trial, 200) > 0.9


def test_amdahl_is_exact_without_noise_and_silent_without_one_thread():
    times = {p: dict.fromkeys(range(3), 0.25 + 0.75 / p) for p in (1, 2, 4)}
    assert amdahl_fit(times).value == pytest.approx(0.25)
    assert math.isnan(amdahl_fit({p: times[p] for p in (2, 4)}).value) and math.isnan(amdahl_fit({}).value)


def test_parallel_efficiency_is_speedup_over_threads():
    rows = parallel_speedups({p: dict.fromkeys(range(3), 0.25 + 0.75 / p) for p in (1, 2, 4)})
    assert [row.speedup.value for row in rows] == pytest.approx([1, 1.6, 1 / 0.4375])
    assert [row.efficiency.value for row in rows] == pytest.approx([1, 0.8, 1 / 1.75])


# Fronts


def test_only_separated_intervals_dominate():
    time, error = np.array([1, 2, 2.0, 4]), np.array([4, 3, 4.2, 1.0])
    assert pareto_front(time, time, error, error).tolist() == [True, True, False, True]
    assert pareto_front(time * 0.4, time * 1.6, error, error).tolist() == [True] * 4
    assert pareto_front([math.nan, 1], [1, 1], [1, 1], [1, 1]).tolist() == [False, True]


def test_ecdf_counts_what_was_never_solved():
    times, share = ecdf([3, 1, math.inf, math.inf])
    assert times.tolist() == [1, 3] and share.tolist() == [0.25, 0.5] and ecdf([])[0].size == 0


# Bias and sanity

SHAPE = (32, 32, 3)


def noisy_reference(rng, sigma=0.02):
    halves = [1 + rng.normal(0, sigma, SHAPE) for _ in range(2)]
    return Reference((halves[0] + halves[1]) / 2, *halves, np.full(SHAPE, sigma**2 / 2), 100)


def test_an_unbiased_engine_is_not_flagged():
    """One-sided 3 se: 0.2 % of 150 trials; more than 3 flags has p < 1e-3. The estimate is centred on 0."""
    rng = np.random.default_rng(9)
    estimates = [bias_estimate([1 + rng.normal(0, 0.3, SHAPE) for _ in range(4)], noisy_reference(rng), 0.01)
                 for _ in range(150)]  # fmt: skip
    assert sum(estimate.biased for estimate in estimates) <= 3
    assert abs(np.mean([e.squared for e in estimates])) < 4 * np.mean([e.se for e in estimates]) / math.sqrt(150)


def test_a_five_percent_bias_under_thirty_percent_noise_is_found():
    rng = np.random.default_rng(10)
    estimate = bias_estimate([1.05 + rng.normal(0, 0.3, SHAPE) for _ in range(4)], noisy_reference(rng), 0.01)
    assert estimate.biased and estimate.root == pytest.approx(0.05, rel=0.2) and estimate.pairs == 6
    assert on_bias_floor(estimate, 0.004) and not on_bias_floor(estimate, 0.02)


def test_bias_agrees_with_a_loop_over_pairs():
    rng = np.random.default_rng(12)
    images, reference = [1 + rng.normal(0, 0.3, SHAPE) for _ in range(3)], noisy_reference(rng)
    pairs = [((images[i] - reference.half_1) * (images[j] - reference.half_2) / (reference.mean**2 + 0.01)).mean()
             for i in range(3) for j in range(3) if i != j]  # fmt: skip
    assert bias_estimate(images, reference, 0.01).squared == pytest.approx(np.mean(pairs))
    assert math.isnan(bias_estimate(images[:1], reference, 0.01).squared)


def test_an_engine_that_is_too_good_per_sample_is_flagged():
    rng = np.random.default_rng(13)
    honest = dict(enumerate(rng.lognormal(0, 0.02, 5)))
    equal, clamped = (dict(enumerate(scale * rng.lognormal(0, 0.02, 5))) for scale in (1.0, 0.5))
    assert too_good_per_sample(clamped, honest) and not too_good_per_sample(equal, honest)
    assert not too_good_per_sample({0: 0.1}, {0: 1.0})


@pytest.mark.parametrize("error", [math.nan, math.inf, 0.0, -1.0, 1e300, 5e-324])
def test_numbers_at_the_ends_of_their_range_give_no_exception_and_win_nothing(error):
    with np.errstate(all="raise"):
        odd = curve([0.1, 0.2], [error, error], [error, error])
        assert first_crossing(odd.x, reliable_errors(odd.error, odd.se), 1e-3).state in ("censored", "at_first")
        quality = time_to_quality([odd, odd], [0.0, 0.0], 1e-3)
        assert quality.reached == (2 if error == 5e-324 else 0)
        convergence_slope([odd, odd])
        efficiency([error, error], [0.1, 5e-324])
    assert too_good_per_sample({0: error, 1: error}, {0: 1e10, 1: 1e10}) == (error == 5e-324)
    assert too_good_per_sample({0: 1e10, 1: 1e10}, {0: error, 1: error}) == (error == 1e300)
