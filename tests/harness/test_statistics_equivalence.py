"""Equivalence of two engines: no false alarms between equals, and each scale sees what only it can see."""

import numpy as np
import pytest
from scipy import stats

from harness.statistics.equivalence import equivalence, tile_means, welch_p

SHAPE = (40, 44, 3)
TRUTH = np.random.default_rng(0).uniform(0.2, 1.5, SHAPE)


def replicates(rng, image, sigma=0.05, count=5):
    """Skewed noise of mean zero, as path tracing has it."""
    return image + sigma * (rng.gamma(0.5, 1.0, (count, *SHAPE)) - 0.5) / np.sqrt(0.5)


def test_equal_engines_are_equivalent_and_seldom_called_different():
    """Three tests at 1 % and one at 1 %: 4 % at most; more than 6 of 60 has p < 1e-2."""
    rng = np.random.default_rng(1)
    verdicts = [equivalence(replicates(rng, TRUTH), replicates(rng, TRUTH)).verdict for _ in range(60)]
    assert verdicts.count("different") <= 6 and verdicts.count("equivalent") >= 50


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
