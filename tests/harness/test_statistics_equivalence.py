"""Equivalence of two engines, by simulation: bounds cover the truth, are as narrow as stated, and see what a mean hides."""

import math

import numpy as np
import pytest
from scipy import stats

from harness.analysis.equivalence import bound, bounds, describe, percent
from harness.statistics.equivalence import Margins, equivalence
from harness.statistics.tiles import differences, tile_means

SHAPE = (64, 64, 3)
TRUTH = np.random.default_rng(0).uniform(0.2, 1.5, SHAPE)
FINE = Margins(0.005, 0.05)


def images(rng, image, count=5, sigma=0.1, skewed=True):
    """(count, h, w, 3): relative noise of mean zero, gamma of skewness 2.8 as path tracing has it, or Gaussian."""
    shape = (count, *image.shape)
    noise = (rng.gamma(0.5, 1.0, shape) - 0.5) / np.sqrt(0.5) if skewed else rng.normal(size=shape)
    return image * (1 + sigma * noise)


def two_wrong_tiles(share=0.1):
    """The truth with one tile brighter and another darker by the same radiance: the mean is what it was."""
    wrong, step = TRUTH.copy(), share * TRUTH[:16, :16].mean()
    wrong[:16, :16] += step
    wrong[32:48, 16:32] -= step
    return wrong


@pytest.mark.parametrize("skewed", [False, True])
def test_two_tiles_that_are_wrong_by_ten_percent_are_not_equivalent_though_the_means_are_equal(skewed):
    """The rule before this one, a margin on the mean alone, called them equivalent at this noise."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        found = equivalence(images(rng, TRUTH, skewed=skewed), images(rng, two_wrong_tiles(), skewed=skewed), FINE)
        assert found.verdict == "different" and found.image_bound < 0.005 and 0.07 < found.tile_bound < 0.15
        assert found.worst_tile in ((0, 0), (16, 32))


def test_bounds_of_a_tile_have_the_stated_size_on_256_pixels_and_a_t_interval_for_each_has_not():
    """2.4 % at three blocks and 1.5 % at seven, at 8.5 % of noise; Student's interval, Sidak-corrected, 76 % and 5 %."""
    rng = np.random.default_rng(2)
    truth = rng.uniform(0.2, 1.5, (256, 256, 1)) * np.ones(3)
    for blocks, low, high, least_t in ((3, 0.021, 0.027, 0.5), (7, 0.0135, 0.0175, 0.04)):
        sides = [truth * (1 + 0.085 * rng.normal(size=(blocks, 256, 256, 1))) for _ in range(2)]
        found = equivalence(*sides)
        assert low < found.tile_bound < high and found.verdict == "equivalent" and found.image_bound < 0.002
        tiles = np.array([tile_means(b - a)[:, :, 0] for a, b in zip(*sides, strict=True)]) / tile_means(truth)[:, :, 0]
        half = stats.t.ppf(1 - 0.05 / 512, blocks - 1) * tiles.std(axis=0, ddof=1) / math.sqrt(blocks)
        assert (abs(tiles.mean(axis=0)) + half).max() > least_t


@pytest.mark.parametrize("blocks", [2, 3, 7])
def test_bounds_cover_the_true_differences(blocks):
    """The mean is off by 0.3 %, a tile by 4 %: 95 % and more are promised; below 181 of 200 has p < 0.005."""
    rng, small = np.random.default_rng(3), TRUTH[:48, :48]
    other = 1.003 * small
    other[16:32, 16:32] *= 1.04
    true_image = float((other.mean(axis=(0, 1)) - small.mean(axis=(0, 1))).max() / ((small + other) / 2).mean())
    covered = np.zeros(2, int)
    for _ in range(200):
        found = equivalence(images(rng, small, blocks), images(rng, other, blocks))
        covered += found.image_bound >= 0.999 * true_image, found.tile_bound >= 0.042
    assert (covered >= 181).all(), covered


@pytest.mark.parametrize("skewed", [False, True])
def test_equal_images_are_called_different_in_at_most_one_percent(skewed):
    """Margins of nothing, where any difference counts. More than 9 of 300 has p < 0.002."""
    rng, nothing, small = np.random.default_rng(4), Margins(1e-9, 1e-9), TRUTH[:48, :48]
    alarms = sum(
        equivalence(images(rng, small, 3, 0.3, skewed), images(rng, small, 3, 0.3, skewed), nothing).verdict == "different"
        for _ in range(300)
    )
    assert alarms <= 9


def test_noise_that_pixels_share_widens_the_bounds():
    """Noise of squares of 8 pixels: each pixel's spread on its own would promise a bound eight times too narrow."""
    rng, missed = np.random.default_rng(5), 0
    for _ in range(40):
        sides = [TRUTH * (1 + 0.1 * np.kron(rng.normal(size=(4, 8, 8, 1)), np.ones((1, 8, 8, 1)))) for _ in range(2)]
        found = differences([b - a for a, b in zip(*sides, strict=True)])
        missed += (abs(found.tiles) > 4.5 * found.tiles_se).sum() + (abs(found.image) > 4.5 * found.image_se).sum()
    assert missed == 0


def test_an_offset_of_whole_images_is_no_small_error_of_the_mean():
    rng = np.random.default_rng(6)
    offsets = 0.02 * rng.normal(size=(5, 1, 1, 1))
    found = differences(list(images(rng, TRUTH) - TRUTH + offsets))
    assert found.image_se == pytest.approx(offsets.std(ddof=1) / math.sqrt(5), rel=0.3)


def test_a_colour_that_is_wrong_is_seen_where_grey_is_right():
    rng = np.random.default_rng(7)
    tinted = TRUTH * (1.02, 1.0, 0.98)
    assert equivalence(images(rng, TRUTH), images(rng, tinted)).verdict == "different"


def test_images_of_one_seed_are_compared_without_their_noise_and_identical_ones_say_so():
    rng = np.random.default_rng(8)
    shared = images(rng, TRUTH, sigma=0.5)
    rounded = shared * (1 + 1e-5 * rng.normal(size=shared.shape))
    rounded[:, ::9, ::9] *= 1 + 0.2 * rng.normal(size=(5, 8, 8, 1))  # a hundredth of the paths went another way
    found = equivalence(shared, rounded)
    assert found.verdict == "identical" and found.passed and 0.98 < found.same_pixels < 0.99
    assert "identical up to rounding in 98." in describe(found)
    brighter = equivalence(shared, 1.003 * shared)
    assert brighter.verdict == "equivalent" and brighter.high - brighter.low < 1e-3 and brighter.same_pixels == 0
    assert equivalence(shared, 1.03 * shared).verdict == "different"
    corner = shared.copy()
    corner[:, :10, :10] *= 2  # identical but for 2.4 % of the pixels, all in one place
    assert equivalence(shared, corner).verdict == "different"


def test_unequal_samples_are_compared_as_they_are():
    """Eight times the variance on one side, and that from block to block: equal images stay equal, wrong ones do not."""
    rng, spreads = np.random.default_rng(9), (0.3, 0.1, 0.3, 0.1, 0.1)
    verdicts = []
    for factor in (1.0, 1.03):
        few = [images(rng, TRUTH, 1, spread)[0] for spread in spreads]
        verdicts.append(equivalence(few, images(rng, factor * TRUTH, sigma=0.03), Margins(0.01, 0.15)).verdict)
    assert verdicts == ["equivalent", "different"]


def test_few_samples_that_missed_what_is_rare_are_no_difference_where_its_variance_is_known():
    """A tenth of the radiance comes in one sample of 3,000: of 4 samples per pixel most tiles see none of it."""
    rng, few, false = np.random.default_rng(10), 4, np.zeros(2, int)
    for _ in range(20):
        rare = [0.9 * TRUTH + 0.1 * TRUTH * rng.binomial(few, 1 / 3000, (64, 64, 1)) * 3000 / few for _ in range(3)]
        many = images(rng, TRUTH, 3, 0.01)
        for way, least in enumerate((None, (0.1 * TRUTH) ** 2 * 3000 / few)):
            false[way] += equivalence(rare, many, Margins(0.02, 0.05), least_variance=least).verdict == "different"
    assert false[0] >= 18 and false[1] == 0


def test_much_noise_is_unresolved_and_bounds_say_how_far_apart_the_images_may_be():
    rng = np.random.default_rng(11)
    found = equivalence(images(rng, TRUTH, 3, 3.0), images(rng, TRUTH, 3, 3.0))
    assert found.verdict == "unresolved" and found.tile_bound > 0.2 and not found.passed
    assert "0.5 % and 5 % are allowed" in describe(found)


def test_images_without_noise():
    same = np.broadcast_to(TRUTH, (3, *SHAPE))
    assert equivalence(same, same * (1 + 1e-7)).verdict == "identical"
    assert equivalence(same, same * 1.01).verdict == "different"
    black = np.zeros((2, 20, 20, 3))
    found = equivalence(black, black)
    assert found.verdict == "identical" and found.tile_bound == found.image_bound == 0
    assert equivalence(black, black + 1).verdict == "different"


def test_tiles_average_their_pixels():
    image = np.random.default_rng(12).uniform(size=(39, 32, 3))
    tiles = tile_means(image)
    assert tiles.shape == (2, 2, 3)
    assert tiles[1, 0, 2] == pytest.approx(image[16:39, 0:16, 2].mean())
    assert tile_means(image[:5, :6]).shape == (1, 1, 3)


def test_shapes_and_counts_are_checked():
    with pytest.raises(ValueError, match="two or more"):
        equivalence(TRUTH[None], TRUTH[None])
    with pytest.raises(ValueError, match="must be equal"):
        equivalence([TRUTH, TRUTH], [TRUTH, TRUTH[:8]])


def test_bounds_are_rounded_up_and_nothing_is_nothing():
    assert [bound(x) for x in (0.0, 7.91e-4, 0.0801, 0.18999, 1.9e-7, 1.0)] == [
        "0 %",
        "0.08 %",
        "8.1 %",
        "19 %",
        "1.9e-05 %",
        "100 %",
    ]
    assert bounds(8e-4, 0.019) == "image means differ by at most 0.08 %, no tile by more than 1.9 %"
    assert percent(0.0) == "0 %" and percent(-0.0123) == "-1.2 %"
