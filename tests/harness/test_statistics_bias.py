"""Bias against the reference, by simulation with the radiance and the noise of cornell_box, and with noise that is worse."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.metrics import Reference
from harness.report.tables.equivalence import bias_text
from harness.statistics import bias_estimate
from harness.store import reference_arrays
from harness.store.results import load_results

EPSILON, SPP, FEW, REPLICATES = 0.01, 64, 4, 8
BASELINE = Path(__file__).resolve().parents[2] / "results" / "baseline"


@pytest.fixture(scope="module")
def box():
    """(radiance of cornell_box, variance of one sample), both (h, w, 3), as the committed reference has them."""
    results = load_results(BASELINE)
    (key,) = [key for key, event in results.references.items() if event.scene == "cornell_box"][:1]
    found = reference_arrays(BASELINE, key)
    return found.mean, found.variance * found.spp


def renders(rng, truth, variance, count, spp=SPP):
    """`count` images of `spp` samples: gamma noise of skewness 2.8."""
    noise = (rng.gamma(0.5, 1.0, (count, *truth.shape)) - 0.5) / np.sqrt(0.5)
    return list(truth + np.sqrt(variance / spp) * noise)


def reference_of(rng, truth, variance, spp=16_384):
    found = np.stack(renders(rng, truth, variance, REPLICATES, spp // REPLICATES))
    return Reference(
        found.mean(axis=0), found[::2].mean(axis=0), found[1::2].mean(axis=0), found.var(axis=0, ddof=1) / REPLICATES, spp
    )


def estimate(rng, box, wrong, count=5, spp=SPP):
    return bias_estimate(renders(rng, wrong, box[1], count, spp), reference_of(rng, *box), EPSILON, [spp] * count)


def one_row_down(image):
    return np.concatenate([image[:1], image[:-1]])


def a_row_of_the_light_black(image):
    """The rows of a committed reference are 64 and more: the light's brightest one goes out."""
    wrong = image.copy()
    wrong[image.sum(axis=(1, 2)).argmax()][image[image.sum(axis=(1, 2)).argmax()].max(axis=1) > 3] = 0
    return wrong


@pytest.mark.parametrize("wrong", [one_row_down, a_row_of_the_light_black])
def test_what_is_wrong_in_few_pixels_is_found_on_five_seeds(box, wrong):
    rng = np.random.default_rng(1)
    for _ in range(10):
        assert "biased_tile" in estimate(rng, box, wrong(box[0])).flags


def test_two_percent_less_light_is_found_and_the_bound_is_one_of_radiance(box):
    """Of the squared bias over R^2 + epsilon this box shows a fraction: the pixels alone flagged it once in 8 runs."""
    rng = np.random.default_rng(2)
    found = [estimate(rng, box, 0.98 * box[0], spp=FEW) for _ in range(8)]
    assert all(each.biased_image for each in found) and sum(each.biased for each in found) <= 4
    assert all(each.difference == pytest.approx(-0.02, abs=0.006) for each in found)
    right = [estimate(rng, box, box[0], spp=FEW) for _ in range(8)]
    assert not any(each.flags for each in right)
    assert all(each.image_bound < 0.01 for each in right), "what was promised is less than what is found"


def test_one_percent_is_always_found_at_three_blocks_and_the_pixels_alone_do_not_find_it():
    rng, truth = np.random.default_rng(3), np.random.default_rng(0).uniform(0.2, 1.5, (96, 96, 3))
    noise, found = (0.3 * truth) ** 2 * SPP, np.zeros(2, int)
    for _ in range(40):
        seen = estimate(rng, (truth, noise), 1.01 * truth, 3)
        found += seen.biased_image, seen.biased
    assert found[0] == 40 and found[1] <= 8


@pytest.mark.parametrize("count", [2, 3, 5])
def test_tiles_raise_no_false_alarm_and_image_means_few(box, count):
    """Together 400 simulations; of 0.3 % for the mean, more than 5 of 134 has p < 1e-5."""
    rng = np.random.default_rng(4)
    part = box[0][:48, :48], box[1][:48, :48]
    found = [estimate(rng, part, part[0], count) for _ in range(134)]
    assert not any(each.biased_tile for each in found)
    assert sum(each.biased_image for each in found) <= 5


def test_rare_bright_samples_that_most_images_miss_are_no_bias():
    """All noise comes in one sample of 5,000. Without the reference's variance every image of 4 samples was flagged."""
    rng, truth, odds = np.random.default_rng(5), np.full((48, 48, 3), 0.5), 2e-4

    def draw(spp):
        hits = rng.binomial(spp, odds, (48, 48, 1)) / spp
        return truth * (1 + (hits - odds) / np.sqrt(odds * (1 - odds)))

    flagged = np.zeros(2, int)
    for _ in range(20):
        found = np.stack([draw(1024) for _ in range(REPLICATES)])
        halves = found[::2].mean(axis=0), found[1::2].mean(axis=0)
        reference = Reference(found.mean(axis=0), *halves, found.var(axis=0, ddof=1) / REPLICATES, 1024 * REPLICATES)
        images = [draw(4) for _ in range(3)]
        for way, spp in enumerate(([4] * 3, [])):
            seen = bias_estimate(images, reference, EPSILON, spp)
            flagged[way] += seen.biased_tile or seen.biased_image
    assert flagged[0] == 0 and flagged[1] >= 18


def test_the_noise_of_a_reference_counts(box):
    """A reference of as many samples as the images: its own error is no bias of theirs."""
    rng = np.random.default_rng(6)
    reference = reference_of(rng, *box, spp=5 * SPP // REPLICATES * REPLICATES)
    found = bias_estimate(renders(rng, box[0], box[1], 5), reference, EPSILON, [SPP] * 5)
    assert not found.biased_tile and not found.biased_image


def test_words_are_bounds_in_radiance_or_say_what_is_wrong(box):
    rng = np.random.default_rng(7)
    found = (SimpleNamespace(bias=estimate(rng, box, image)) for image in (box[0], 1.05 * box[0]))
    right, wrong = map(bias_text, found)
    assert right.startswith("mean < 0.") and ", tiles < " in right
    assert "mean +5" in wrong and "flagged" in wrong
