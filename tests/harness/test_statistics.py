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
    median_interval,
    noise_floor,
    on_bias_floor,
    paired_speedup,
    parallel_speedups,
    pareto_front,
    too_good_per_sample,
    unpaired_ratio,
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


@pytest.mark.parametrize(("size", "least"), [(5, 0.90), (9, 0.90), (25, 0.90)])
def test_the_median_of_skewed_times_is_covered(size, least):
    """At most 93.75 % for five seeds; 300 trials below 90 % have p < 0.005 there."""

    def trial(rng):
        estimate = median_interval(rng.lognormal(0, 0.5, size))
        return estimate.low, 1.0, estimate.high

    assert coverage(trial, 300) >= least


def test_a_median_of_censored_times_stays_censored():
    assert median_interval([1, 2, math.inf, math.inf, math.inf]).value == math.inf
    most = median_interval([1, 2, 3, math.inf, math.inf])
    assert most.value == 3 and most.low == 1 and most.high == math.inf


def test_one_value_has_no_interval_and_none_is_nothing():
    assert median_interval([4.0])[0] == 4 and math.isnan(median_interval([4.0]).low)
    assert math.isnan(mean_interval([]).value) and median_interval([math.nan]).n == 0


def test_efficiency_is_what_its_name_says():
    assert efficiency([0.1, 0.1, -1.0], [2, 2, 2]).value == pytest.approx(5)


# Speed-ups


def test_pairing_removes_the_drift_of_a_block():
    drift = {0: 1.0, 1: 1.5, 2: 0.7, 3: 2.0, 4: 1.2}
    speedup = paired_speedup({b: 4 * d for b, d in drift.items()}, {b: 2 * d for b, d in drift.items()})
    assert speedup.ratio == pytest.approx(2) and speedup.low == pytest.approx(2) and speedup.verdict == "faster"


def test_identical_engines_are_a_tie_but_for_five_percent():
    """600 trials of equal engines: false verdicts expected 5 %, more than 8 % has p < 1e-3."""
    rng = np.random.default_rng(7)
    wrong = 0
    for _ in range(600):
        times = rng.lognormal(0, 0.02, (2, 5)) * rng.lognormal(0, 0.2, 5)
        wrong += paired_speedup(*({b: row[b] for b in range(5)} for row in times)).verdict != "tie"
    assert wrong / 600 < 0.08


def test_speedup_intervals_cover():
    def trial(rng):
        drift = rng.lognormal(0, 0.3, 5)
        base, other = (scale * drift * rng.lognormal(0, 0.05, 5) for scale in (3.0, 2.0))
        speedup = paired_speedup(dict(enumerate(base)), dict(enumerate(other)))
        return speedup.low, 1.5, speedup.high

    assert coverage(trial, 600) > 0.92


def test_a_difference_inside_the_noise_floor_is_a_tie():
    base, other = dict.fromkeys(range(5), 1.02), dict.fromkeys(range(5), 1.0)
    assert paired_speedup(base, other).verdict == "faster"
    assert paired_speedup(base, other, floor=0.05).verdict == "tie"
    assert paired_speedup(other, base, floor=0.05).verdict == "tie"


def test_unpaired_ratios_cover():
    def trial(rng):
        estimate = unpaired_ratio(rng.lognormal(0, 0.05, 5), 1.2 * rng.lognormal(0, 0.1, 6))
        return estimate.low, 1.2, estimate.high

    assert coverage(trial, 600) > 0.92
    assert math.isnan(unpaired_ratio([1.0], [1.0, 2.0]).value)


def test_the_noise_floor_bounds_an_a_a_control():
    rng = np.random.default_rng(8)
    floor = noise_floor(*(dict(enumerate(rng.lognormal(0, 0.02, 8))) for _ in range(2)))
    assert 0.005 < floor < 0.1 and math.isnan(noise_floor({0: 1.0}, {0: 1.0}))


def test_censored_pairs_need_five_that_agree():
    never, fast = dict.fromkeys(range(5), math.inf), dict.fromkeys(range(5), 1.0)
    assert paired_speedup(never, fast).verdict == "faster" and paired_speedup(fast, never).verdict == "slower"
    assert paired_speedup({0: math.inf, 1: 1.0}, {0: 1.0, 1: 0.5}).verdict == "unknown"
    assert paired_speedup(never, never).pairs == 0


def test_pairs_censored_on_either_side_have_a_ratio_that_nobody_knows():
    speedup = paired_speedup({0: math.inf, 1: 1.0}, {0: 1.0, 1: math.inf})
    assert math.isnan(speedup.ratio) and (speedup.low, speedup.high, speedup.verdict) == (0.0, math.inf, "unknown")


# Threads


def amdahl_times(f, rng, sigma=0.01):
    return {p: {b: (f + (1 - f) / p) * rng.lognormal(0, sigma) for b in range(5)} for p in (1, 2, 4, 8)}


def test_amdahl_fraction_is_covered():
    """A bootstrap of five blocks is narrow: nominal 95 %, about 85 % true; 100 trials."""

    def trial(rng):
        fit = amdahl_fit(amdahl_times(0.1, rng))
        return fit.low, 0.1, fit.high

    assert coverage(trial, 100) > 0.7


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
        efficiency([error, error], [0.1, 5e-324])
    assert too_good_per_sample({0: error, 1: error}, {0: 1e10, 1: 1e10}) == (error == 5e-324)
    assert too_good_per_sample({0: 1e10, 1: 1e10}, {0: error, 1: error}) == (error == 1e300)
