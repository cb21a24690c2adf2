"""Equivalence of two engines: no false alarms between equals, and each scale sees what only it can see."""

import numpy as np
import pytest
from scipy import stats

from harness.statistics.equivalence import equivalence, tile_means, too_small_p, welch_p

SHAPE = (40, 44, 3)
TRUTH = np.random.default_rng(0).uniform(0.2, 1.5, SHAPE)


def replicates(rng, image, sigma=0.05, count=5):
    """Skewed noise of mean zero, as path tracing has it."""
    return image + sigma * (rng.gamma(0.5, 1.0, (count, *SHAPE)) - 0.5) / np.sqrt(0.5)


SMALL = TRUTH[:24, :24]


def noisy(rng, image, skewed=True, count=5, sigma=0.05):
    """(count, h, w, 3) replicates: Gaussian noise, or gamma noise of skewness 2.8; both of mean zero."""
    shape = (count, *image.shape)
    noise = (rng.gamma(0.5, 1.0, shape) - 0.5) / np.sqrt(0.5) if skewed else rng.normal(size=shape)
    return image + sigma * noise


@pytest.mark.parametrize("skewed", [False, True])
def test_a_scale_raises_false_alarms_at_its_stated_rate_and_no_more(skewed):
    """300 A/A comparisons: 1 % is stated for pixels, tiles, the image and KS; more than 12 of one has p < 2e-5.

    The verdict rests on four tests, 4 % at most: more than 28 has p < 2e-5.
    """
    rng, alarms = np.random.default_rng(21), np.zeros(5, int)
    equivalent = 0
    for _ in range(300):
        found = equivalence(noisy(rng, SMALL, skewed), noisy(rng, SMALL, skewed))
        alarms += (found.pixel_p < found.pixel_threshold, found.tile_p < found.tile_threshold, found.image_p < 0.01,
                   found.ks_p < 0.01, found.verdict == "different")  # fmt: skip
        equivalent += found.verdict == "equivalent"
    assert (alarms[:4] <= 12).all() and alarms[4] <= 28, alarms
    assert equivalent >= 270


LAMP = 0.6 * np.exp(-((np.indices((24, 24)).transpose(1, 2, 0) - (6, 15)) ** 2).sum(-1) / 60)[..., None]
PLANTED = {
    "one percent of brightness": (SMALL + LAMP, 1.01 * (SMALL + LAMP)),
    "a shift by one pixel": (SMALL + LAMP, np.roll(SMALL + LAMP, 1, axis=1)),
    "a light counted twice": (SMALL + LAMP, SMALL + 2 * LAMP),
    "a light forgotten": (SMALL + LAMP, SMALL),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_error_is_always_found(name):
    """40 comparisons of 8 replicates, of skewed noise of 5 %."""
    rng = np.random.default_rng(22)
    right, wrong = PLANTED[name]
    for _ in range(40):
        assert equivalence(noisy(rng, right, count=8), noisy(rng, wrong, count=8)).verdict == "different"


def test_unequal_skewed_noise_raises_few_false_alarms():
    """Four times the noise on one side, skewness 2.8. At 4 % a comparison, more than 4 of 30 has p < 0.01."""
    rng = np.random.default_rng(12)
    verdicts = [equivalence(replicates(rng, TRUTH, 0.4), replicates(rng, TRUTH, 0.1)).verdict for _ in range(30)]
    assert verdicts.count("different") <= 4


def test_a_two_percent_brightness_error_passes_pixels_and_fails_the_image():
    rng = np.random.default_rng(2)
    result = equivalence(replicates(rng, TRUTH), replicates(rng, TRUTH * 1.02))
    assert result.pixel_p > result.pixel_threshold
    assert result.difference == pytest.approx(0.02, abs=0.005)
    assert result.verdict == "different" and result.image_p < 0.01


def test_a_wrong_tile_with_an_unchanged_mean_is_found():
    rng = np.random.default_rng(3)
    moved = TRUTH.copy()
    moved[8:16, 8:16] += 0.15
    moved[16:24, 16:24] -= 0.15
    result = equivalence(replicates(rng, TRUTH), replicates(rng, moved))
    assert result.tile_p < result.tile_threshold and result.image_p > 0.01 and result.verdict == "different"


def test_one_wrong_pixel_is_found():
    rng = np.random.default_rng(4)
    spot = TRUTH.copy()
    spot[20, 20] += 5.0
    result = equivalence(replicates(rng, TRUTH), replicates(rng, spot))
    assert 1 <= result.pixels_outside <= 3 and result.verdict == "different"


def test_a_faint_error_everywhere_is_found_by_the_distribution_of_p_values():
    rng = np.random.default_rng(5)
    checker = np.where(((np.indices(SHAPE[:2]) // 8).sum(axis=0) % 2 == 0)[..., None], 1.004, 0.996)
    result = equivalence(replicates(rng, TRUTH, 0.03), replicates(rng, TRUTH * checker, 0.03))
    assert result.ks_p < 0.01 and result.verdict == "different"


def test_much_noise_is_inconclusive_and_says_what_it_could_have_seen():
    rng = np.random.default_rng(6)
    result = equivalence(replicates(rng, TRUTH, 3.0, 3), replicates(rng, TRUTH, 3.0, 3))
    assert result.verdict == "inconclusive" and result.detectable > 0.01


def test_identical_images_without_noise_are_equivalent_and_a_shift_is_not():
    same = np.broadcast_to(TRUTH, (3, *SHAPE))
    assert equivalence(same, same * (1 + 1e-7)).verdict == "equivalent"
    assert equivalence(same, same * 1.001).verdict == "different"


def test_the_margin_test_covers_the_true_difference():
    """90 % interval of the relative difference; 80 of 100 has p < 2e-3."""
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(100):
        result = equivalence(replicates(rng, TRUTH), replicates(rng, TRUTH * 1.003))
        hits += result.low <= 0.003 <= result.high
    assert hits >= 80


def test_welch_agrees_with_scipy():
    rng = np.random.default_rng(8)
    a, b = rng.normal(1, 0.1, (5, 7, 6)), rng.normal(1.1, 0.3, (4, 7, 6))
    assert welch_p(a, b) == pytest.approx(stats.ttest_ind(a, b, equal_var=False).pvalue)


def test_tiles_average_their_pixels():
    images = np.random.default_rng(9).uniform(size=(2, 19, 16, 3))
    tiles = tile_means(images)
    assert tiles.shape == (2, 2, 2)
    assert tiles[1, 1, 0] == pytest.approx(images[1, 8:19, 0:8].mean())
    assert tile_means(images[:, :5, :6]).shape == (2, 1, 1)


def test_shapes_and_counts_are_checked():
    with pytest.raises(ValueError, match="two or more"):
        equivalence(TRUTH[None], TRUTH[None])


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_distribution_of_p_values_is_tested_as_scipy_tests_it(power):
    found = np.random.default_rng(4).random((5, 9, 3)) ** power
    expected = stats.kstest(found.ravel(), "uniform", alternative="greater").pvalue
    assert too_small_p(found) == pytest.approx(expected, rel=1e-9)
