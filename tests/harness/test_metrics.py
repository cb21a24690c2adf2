"""The metrics follow their formulas, keep the reference's noise out, and never hide a bad pixel."""

import math

import numpy as np
import pytest

from harness.metrics import (
    Reference,
    as_error,
    corrected_error_map,
    epsilon_of,
    error_words,
    measure,
    metric_name,
    metric_title,
    standard_error,
)
from tests.needs import needs

TRUTH = np.random.default_rng(1).uniform(0.05, 1.5, (48, 40, 3))


def reference_of(truth, spp, sigma, rng):
    """A reference whose samples have standard deviation `sigma`; `spp` of them in all."""
    halves = [truth + rng.normal(0, sigma / math.sqrt(spp / 2), truth.shape) for _ in range(2)]
    return Reference((halves[0] + halves[1]) / 2, *halves, np.full(truth.shape, sigma**2 / spp), spp)


def exact_reference(truth=TRUTH):
    return Reference(truth, truth, truth, np.zeros_like(truth), 1 << 20)


def test_relmse_agrees_with_a_loop_over_pixels():
    image = TRUTH[:5, :4] * 1.1 + 0.02
    total = 0.0
    for y in range(5):
        for x in range(4):
            for c in range(3):
                a, r = float(image[y, x, c]), float(TRUTH[y, x, c])
                total += (a - r) * (a - r) / (r * r + 0.01)
    assert measure(image, exact_reference(TRUTH[:5, :4]), 0.01)["relmse_e0.01"] == pytest.approx(total / 60, rel=1e-12)


def test_names_carry_epsilon():
    keys = measure(TRUTH, exact_reference(), 1e-3)
    assert {"relmse_e0.001", "relmse_e0.001_corrected", "relmse_e0.001_se", "relmse_e0.001_trimmed"} <= set(keys)


def test_an_image_equal_to_its_reference_has_no_error():
    scores = measure(TRUTH, exact_reference(), 0.01)
    assert scores["relmse_e0.01"] == scores["mse"] == scores["mape"] == scores["smape"] == scores["nonfinite"] == 0
    assert scores["psnr"] == math.inf and scores["ssim"] == pytest.approx(1)


def test_uncorrected_error_is_inflated_by_reference_noise_and_corrected_is_not():
    """At n = N the plain error doubles; the corrected one must be within 4 % of the truth (5 standard errors)."""
    rng = np.random.default_rng(2)
    plain, corrected, truth = [], [], []
    for _ in range(40):
        image = TRUTH + rng.normal(0, 0.1, TRUTH.shape)
        scores = measure(image, reference_of(TRUTH, 64, 0.8, rng), 0.01)
        plain.append(scores["mse"])
        corrected.append(scores["mse_corrected"])
        truth.append(((image - TRUTH) ** 2).mean())
    assert np.mean(plain) / np.mean(truth) == pytest.approx(2, rel=0.04)
    assert np.mean(corrected) / np.mean(truth) == pytest.approx(1, rel=0.04)


def scene_and_noise(rng, relative):
    """A truth (24, 20, 3) with a lamp, and n samples of skewed noise about it, each of `relative` size, grey or coloured."""
    truth = rng.lognormal(-1, 0.7, (24, 20, 1)) * rng.uniform(0.3, 1, (24, 20, 3))
    truth[3:6, 4:8] = 8.0
    sigma = relative * (0.05 + truth) * rng.lognormal(0, 0.5, (24, 20, 1))

    def image(n, channels):
        drawn = rng.gamma(0.3 * n, 1.0, (24, 20, channels))
        return truth + sigma * (drawn - 0.3 * n) / math.sqrt(0.3) / n

    return truth, image


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("spp", [1, 16, 256])
def test_the_standard_error_is_that_by_the_noise_of_the_reference(spp, channels):
    """200 references of 1024 samples, one image: 0.92 to 1.13 of the true standard error, which is itself known to 5 %, where
    channels err alike and where they do not. The spread over pixels, which stood for it before, is another number; so is the
    formula without the noise of the denominator where the error is larger than the radiance."""
    rng = np.random.default_rng(3 + spp)
    _, draw = scene_and_noise(rng, 0.3)
    image = draw(spp, channels)
    found, before, plain = [], [], []
    for _ in range(200):
        halves = draw(512, channels), draw(512, channels)
        reference = Reference((halves[0] + halves[1]) / 2, *halves, np.zeros_like(halves[0]), 1024)
        found.append(measure(image, reference, 0.01))
        before.append(standard_error(corrected_error_map(image, reference, 0.01)))
        parts = (image - reference.mean) * (halves[0] - halves[1]) / (reference.mean**2 + 0.01)
        plain.append(math.sqrt((parts.sum(axis=2) ** 2).sum()) / parts.size)
    for name in ("relmse_e0.01", "mse"):
        true = np.std([scores[f"{name}_corrected"] for scores in found], ddof=1)
        ratio = math.sqrt(np.mean([scores[f"{name}_se"] ** 2 for scores in found])) / true
        assert 0.92 / 1.1 < ratio < 1.13 * 1.1
    true = np.std([scores["relmse_e0.01_corrected"] for scores in found], ddof=1)
    assert not 0.5 < np.mean(before) / true < 2
    assert spp > 1 or np.mean(plain) / true < 0.8


def test_the_shift_by_a_noisy_denominator_counts_as_noise():
    """Where single pixels of the reference are known to some 10 %, the corrected relMSE is 7 % too large, and spreads by 10 %:
    the figure is that of both, by 0.9 to 1.4."""
    rng = np.random.default_rng(5)
    truth, draw = scene_and_noise(rng, 2.0)
    image = draw(16, 1)
    exact = measure(image, exact_reference(truth), 0.01)["relmse_e0.01"]
    found = []
    for _ in range(100):
        halves = draw(512, 1), draw(512, 1)
        found.append(measure(image, Reference((halves[0] + halves[1]) / 2, *halves, np.zeros_like(truth), 1024), 0.01))
    errors = np.array([scores["relmse_e0.01_corrected"] for scores in found])
    figure = math.sqrt(np.mean([scores["relmse_e0.01_se"] ** 2 for scores in found]))
    off = math.sqrt(((errors - exact) ** 2).mean())
    assert errors.mean() / exact > 1.03 and 0.9 < figure / off < 1.4


def test_a_perfect_image_has_an_error_of_noise_alone():
    """|corrected| < 3 standard errors but for 0.3 % of 200 trials; more than 5 outside has p < 1e-3."""
    rng = np.random.default_rng(3)
    outside = 0
    for _ in range(200):
        scores = measure(TRUTH, reference_of(TRUTH, 64, 0.1, rng), 0.01)
        outside += abs(scores["relmse_e0.01_corrected"]) > 3 * scores["relmse_e0.01_se"]
    assert outside <= 5


def test_the_trimmed_metric_may_have_targets_and_says_its_epsilon():
    name = metric_name("trimmed_relmse", 0.01)
    assert (name, epsilon_of(name), metric_title(name)) == ("relmse_e0.01_trimmed", 0.01, "trimmed relMSE (ε = 0.01)")
    assert error_words(name) == "not corrected for the reference's noise" and error_words("relmse_e0.01") == "noise-corrected"


@pytest.mark.parametrize("metric", ["relmse_e0.01_trimmed", "mae", "mape", "smape", "psnr", "ssim"])
def test_the_noise_in_uncorrected_metrics_is_seen_by_the_halves(metric):
    """Against the truth, which no experiment has: the figure is 0.8 to 1.4 of the true effect where that is 1 to 30 % of the
    error; where noise is all that is left it stays far above a tenth of the score."""
    rng = np.random.default_rng(6)
    truth, draw = scene_and_noise(rng, 1.0)
    shares = []
    for spp in (16, 64, 256, 4096):
        image = draw(spp, 3)
        exact = as_error(metric, measure(image, exact_reference(truth), 0.01)[metric])
        effects, figures = [], []
        for _ in range(20):
            halves = draw(512, 3), draw(512, 3)
            reference = Reference((halves[0] + halves[1]) / 2, *halves, np.zeros_like(truth), 1024)
            scores = measure(image, reference, 0.01, metric)
            effects.append(as_error(metric, scores[metric]) - exact)
            figures.append(scores[f"{metric}_se"])
        effect, figure = (math.sqrt(np.mean(np.square(values))) for values in (effects, figures))
        shares.append((effect / exact, figure / effect, figure / (exact + np.mean(effects))))
    assert all(0.8 < found < 1.4 for _, found, _ in shares[:3])
    assert shares[1][2] < 0.1 and shares[3][2] > 0.3


def test_only_the_metric_of_the_targets_pays_for_the_halves():
    assert "ssim_se" not in measure(TRUTH, exact_reference(), 0.01)
    assert measure(TRUTH, exact_reference(), 0.01, "ssim")["ssim_se"] == 0
    broken = np.full_like(TRUTH, np.nan)
    assert measure(broken, exact_reference(), 0.01, "psnr")["psnr_se"] == math.inf


def test_trimmed_error_forgets_one_firefly_in_a_thousand():
    image = TRUTH + 0.01
    image[7, 9] = 1000.0
    scores = measure(image, exact_reference(), 0.01)
    assert scores["relmse_e0.01"] > 100
    assert 0 < scores["relmse_e0.01_trimmed"] < 0.01


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_nonfinite_pixel_is_counted_and_makes_the_error_infinite(value):
    image = TRUTH.copy()
    image[3, 4, 1] = image[0, 0, 0] = image[0, 0, 2] = value
    scores = measure(image, exact_reference(), 0.01)
    assert scores["nonfinite"] == 2
    assert all(scores[key] == math.inf for key in ("relmse_e0.01", "relmse_e0.01_trimmed", "mse", "mae", "mape", "smape"))
    assert math.isnan(scores["ssim"]) and math.isnan(scores["psnr"])


def test_black_reference_pixels_count():
    black = np.zeros((16, 16, 3))
    scores = measure(black + 0.1, exact_reference(black), 0.01)
    assert scores["relmse_e0.01"] == pytest.approx(1) and scores["mape"] == pytest.approx(10)
    assert scores["mae"] == pytest.approx(0.1)


def test_psnr_of_a_known_difference():
    """sRGB(0.5) - sRGB(0.25) from the standard's formula."""
    a, b = np.full((16, 16, 3), 0.5), np.full((16, 16, 3), 0.25)
    step = 1.055 * (0.5 ** (1 / 2.4) - 0.25 ** (1 / 2.4))
    assert measure(a, exact_reference(b), 0.01)["psnr"] == pytest.approx(-20 * math.log10(step), rel=1e-9)


def test_perceptual_scores_worsen_with_noise():
    rng = np.random.default_rng(4)
    few, many = (measure(TRUTH + rng.normal(0, s, TRUTH.shape), exact_reference(), 0.01) for s in (0.02, 0.3))
    assert few["ssim"] > many["ssim"] and few["psnr"] > many["psnr"]


@needs("flip")
def test_flip_is_zero_without_an_error_and_rises_with_noise():
    rng = np.random.default_rng(4)
    none, few, many = (measure(TRUTH + rng.normal(0, s, TRUTH.shape), exact_reference(), 0.01) for s in (0.0, 0.02, 0.3))
    assert 0 == none["flip"] < few["flip"] < many["flip"]


def test_mean_radiance_is_reported_a_channel():
    scores = measure(TRUTH * [1, 2, 3], exact_reference(), 0.01)
    assert [scores[f"mean_{c}"] for c in "rgb"] == pytest.approx((TRUTH * [1, 2, 3]).mean(axis=(0, 1)).tolist())


def test_shapes_and_epsilon_are_checked():
    with pytest.raises(ValueError, match="shape"):
        measure(TRUTH[:3], exact_reference(), 0.01)
    with pytest.raises(ValueError, match="epsilon"):
        measure(TRUTH, exact_reference(), 0.0)
