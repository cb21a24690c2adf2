"""Welch's test and the error spectrum find bias, and no more of it than chance in images that have none."""

import numpy as np
import pytest

from harness.metrics import Reference
from harness.statistics.noise_or_bias import deviation, luminance, spectrum, welch

SIZE = (64, 64)
TRUTH = 0.5 + 0.4 * np.random.default_rng(0).random((*SIZE, 3))


def reference(rng, noise=0.002):
    halves = [TRUTH + noise * np.sqrt(2) * rng.normal(size=TRUTH.shape) for _ in range(2)]
    return Reference((halves[0] + halves[1]) / 2, *halves, np.full(TRUTH.shape, noise**2), 4096)


def noisy(rng, seeds, truth=TRUTH, skewed=False):
    draw = (lambda: rng.exponential(size=truth.shape) - 1) if skewed else (lambda: rng.normal(size=truth.shape))
    return [truth * (1 + 0.2 * draw()) for _ in range(seeds)]


@pytest.mark.parametrize(("seeds", "skewed"), [(3, False), (5, False), (7, True)])
def test_without_bias_p_values_are_uniform_but_for_one_run_in_a_hundred(seeds, skewed):
    rng = np.random.default_rng(seeds)
    found = [welch(noisy(rng, seeds, skewed=skewed), reference(rng)).uniformity for _ in range(100)]
    assert sum(not each.uniform for each in found) <= 5
    assert 0.04 < np.mean([each.small for each in found]) < 0.06


@pytest.mark.parametrize("seeds", [3, 7])
def test_a_bias_of_five_percent_is_found_where_it_is(seeds):
    rng, biased = np.random.default_rng(seeds), TRUTH.copy()
    biased[:, 32:] *= 1.05
    found = welch(noisy(rng, seeds, biased), reference(rng))
    half = found.p.shape[1] // 2
    assert not found.uniformity.uniform
    assert np.median(found.p[:, half:]) < 0.2 and np.median(found.p[:, :half]) > 0.3


def test_noise_that_tiles_share_is_no_bias():
    """All pixels of an image share a factor: were all tiles independent, a fifth of the runs or more would show a bias."""
    rng, found = np.random.default_rng(1), []
    for _ in range(100):
        images = [image * (1 + 0.02 * rng.normal()) for image in noisy(rng, 5)]
        found.append(welch(images, reference(rng)).uniformity)
    assert sum(each.distance > 1.63 / np.sqrt(each.tiles) for each in found) > 20
    assert sum(not each.uniform for each in found) <= 10 and np.median([each.independent for each in found]) < 50


def test_black_tiles_have_no_p_value():
    rng, truth = np.random.default_rng(1), TRUTH.copy()
    truth[:16] = 0
    dark = Reference(truth, truth, truth, np.zeros_like(truth), 4096)
    found = welch(noisy(rng, 3, truth), dark)
    assert np.isnan(found.p[:4]).all() and np.isfinite(found.p[4:]).all() and found.uniformity.tiles == 12 * 16


def test_too_few_images_are_refused():
    with pytest.raises(ValueError, match="2 images: 3 or more"):
        welch(noisy(np.random.default_rng(1), 2), reference(np.random.default_rng(1)))


def test_the_spectrum_of_white_noise_is_flat_at_its_variance_and_has_nothing_in_common():
    rng = np.random.default_rng(3)
    images = noisy(rng, 6)
    found = spectrum(images, reference(rng))
    expected = deviation(images).var() + deviation(images).mean() ** 2
    scale = luminance(TRUTH).mean() ** 2
    np.testing.assert_allclose(found.power[4:], expected / scale, rtol=0.15)
    assert not found.biased.any()
    assert (found.low <= found.power).all() and (found.power <= found.high).all()


def test_seeds_of_gathered_noise_and_a_noisy_reference_have_nothing_in_common_but_by_chance():
    rng, false = np.random.default_rng(5), 0
    for _ in range(60):
        images = noisy(rng, 3, skewed=True)
        for image in images:
            image[rng.integers(0, 64, 20), rng.integers(0, 64, 20)] += 5.0
            image[:8, :8] += rng.normal(size=(8, 8, 3))
        false += bool(spectrum(images, reference(rng, 0.1)).biased.any())
    assert false <= 3


def test_a_bias_shows_at_its_frequency_with_its_power():
    rng = np.random.default_rng(4)
    wave = 0.05 * np.sin(2 * np.pi * np.arange(SIZE[1]) / 4)  # a quarter of a cycle a pixel
    found = spectrum(noisy(rng, 5, TRUTH + wave[None, :, None]), reference(rng))
    at = int(np.argmin(abs(found.frequency - 0.25)))
    assert found.biased[at] and int(found.common.argmax()) in (at - 1, at, at + 1)
    assert found.biased.sum() <= 2


def test_a_bias_of_the_whole_shows_at_low_frequencies():
    rng = np.random.default_rng(6)
    bright = TRUTH + 0.05 * np.linspace(0, 1, SIZE[0])[:, None, None] ** 2
    found = spectrum(noisy(rng, 5, bright), reference(rng))
    assert found.biased[0] and not found.biased[-3:].any()


def test_the_deviation_is_that_of_each_pixel_over_seeds():
    images = [np.full((2, 2, 3), value) for value in (1.0, 2.0, 3.0)]
    np.testing.assert_allclose(deviation(images), 1.0)
