"""The estimators find a truth that is known, and their intervals cover it as often as they say."""

import math

import numpy as np
import pytest

from harness.metrics import Reference
from harness.statistics import (
    amdahl_fit,
    bias_estimate,
    ecdf,
    efficiency,
    mean_interval,
    on_bias_floor,
    parallel_speedups,
    pareto_front,
    too_good_per_sample,
)


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
    estimates = [
        bias_estimate([1 + rng.normal(0, 0.3, SHAPE) for _ in range(4)], noisy_reference(rng), 0.01) for _ in range(150)
    ]
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
    pairs = [
        ((images[i] - reference.half_1) * (images[j] - reference.half_2) / (reference.mean**2 + 0.01)).mean()
        for i in range(3)
        for j in range(3)
        if i != j
    ]
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
        efficiency([error, error], [0.1, 5e-324])
    assert too_good_per_sample({0: error, 1: error}, {0: 1e10, 1: 1e10}) == (error == 5e-324)
    assert too_good_per_sample({0: 1e10, 1: 1e10}, {0: error, 1: error}) == (error == 1e300)
