"""The metrics follow their formulas, keep the reference's noise out, and never hide a bad pixel."""

import math

import numpy as np
import pytest

from harness.metrics import Reference, measure

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
    assert scores["psnr"] == math.inf and scores["ssim"] == pytest.approx(1) and scores.get("flip", 0.0) == 0


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


def test_standard_error_covers_a_zero_error():
    """A perfect image: |corrected| < 3 SE but for 0.4 % of 200 trials; more than 5 outside has p < 1e-3."""
    rng = np.random.default_rng(3)
    outside = 0
    for _ in range(200):
        scores = measure(TRUTH, reference_of(TRUTH, 64, 0.1, rng), 0.01)
        outside += abs(scores["relmse_e0.01_corrected"]) > 3 * scores["relmse_e0.01_se"]
    assert outside <= 5


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
    assert all(scores[key] == math.inf for key in ("relmse_e0.01", "relmse_e0.01_trimmed", "mse", "mape", "smape"))
    assert math.isnan(scores["ssim"]) and math.isnan(scores["psnr"])


def test_black_reference_pixels_count():
    black = np.zeros((16, 16, 3))
    scores = measure(black + 0.1, exact_reference(black), 0.01)
    assert scores["relmse_e0.01"] == pytest.approx(1) and scores["mape"] == pytest.approx(10)


def test_psnr_of_a_known_difference():
    """sRGB(0.5) - sRGB(0.25) from the standard's formula."""
    a, b = np.full((16, 16, 3), 0.5), np.full((16, 16, 3), 0.25)
    step = 1.055 * (0.5 ** (1 / 2.4) - 0.25 ** (1 / 2.4))
    assert measure(a, exact_reference(b), 0.01)["psnr"] == pytest.approx(-20 * math.log10(step), rel=1e-9)


def test_perceptual_scores_worsen_with_noise():
    rng = np.random.default_rng(4)
    few, many = (measure(TRUTH + rng.normal(0, s, TRUTH.shape), exact_reference(), 0.01) for s in (0.02, 0.3))
    assert few["ssim"] > many["ssim"] and few["psnr"] > many["psnr"]
    assert "flip" not in few or few["flip"] < many["flip"]


def test_mean_radiance_is_reported_a_channel():
    scores = measure(TRUTH * [1, 2, 3], exact_reference(), 0.01)
    assert [scores[f"mean_{c}"] for c in "rgb"] == pytest.approx((TRUTH * [1, 2, 3]).mean(axis=(0, 1)).tolist())


def test_shapes_and_epsilon_are_checked():
    with pytest.raises(ValueError, match="shape"):
        measure(TRUTH[:3], exact_reference(), 0.01)
    with pytest.raises(ValueError, match="epsilon"):
        measure(TRUTH, exact_reference(), 0.0)
