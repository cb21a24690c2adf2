"""Does an engine converge to the reference, and is it what it says it is? Three tests for bias, sanity flags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.metrics import Reference, standard_error
from harness.statistics.convergence import NOISE_ERRORS
from harness.statistics.equivalence import IMAGE_Z, TILE_Z
from harness.statistics.intervals import mean_interval
from harness.statistics.tiles import (
    TILE,
    Differences,
    TileSample,
    differences_of,
    family_z,
    image_scale,
    inflation,
    largest,
    relative,
    tile_means,
    tile_sample,
    tile_scale,
    tile_sizes,
    tile_sums,
)

Image = NDArray[np.float64]

IMAGE_FLAG_Z, TILE_FLAG_Z = family_z(3.0, 3), family_z(4.5, 3)
"""3 standard errors of the image mean, 4.5 of a tile, corrected for three channels (Sidak)."""
ROUNDED = 1e-5
"""Relative error of a radiance that was rounded to float32 on its way: smaller differences are no bias."""
TOO_GOOD = 1.1
"""Error x samples of the baseline over that of an engine; above this the engine is too good per sample."""


class BiasEstimate(NamedTuple):
    """Three statistics against the reference; all but `squared` and `se` are shares of the radiance.

    Pixels: `squared` is the squared bias over R^2 + eps, averaged, with its standard error (it may be negative) over `pairs` of
    seeds; `weight` is mean(R^2 / (R^2 + eps)), by which a uniform bias enters it. Image mean A - R: `difference` in the channel
    farthest off, `image_z` the most standard errors that a channel is off, `image_bound` the most that it can be. Tiles of
    16 x 16 pixels: `worst_tile` is the first pixel (x, y) of the one that is off by most standard errors, `tile_z`;
    `tile_difference` by how much; `tile_bound` the most that any tile can be off. NaN where it is unknown.
    """

    squared: float
    se: float
    pairs: int
    weight: float = math.nan
    difference: float = math.nan
    image_z: float = math.nan
    image_bound: float = math.nan
    tile_difference: float = math.nan
    tile_z: float = math.nan
    tile_bound: float = math.nan
    worst_tile: tuple[int, int] = (0, 0)

    @property
    def biased(self) -> bool:
        """Whether the pixels show a bias: over 3 se above zero (one-sided, 0.2 % false alarms)."""
        return self.squared > NOISE_ERRORS * self.se

    @property
    def biased_image(self) -> bool:
        return self.image_z > IMAGE_FLAG_Z

    @property
    def biased_tile(self) -> bool:
        return self.tile_z > TILE_FLAG_Z

    @property
    def root(self) -> float:
        """The bias of the pixels as a share of the radiance, if it is uniform; 0 where the estimate is negative."""
        weight = self.weight if self.weight > 0 else 1.0
        return math.sqrt(max(self.squared, 0.0) / weight)

    @property
    def flags(self) -> list[str]:
        """Names of those of the three tests that found a bias."""
        found = {"biased": self.biased, "biased_image": self.biased_image, "biased_tile": self.biased_tile}
        return [name for name, seen in found.items() if seen]


def bias_estimate(images: Sequence[Image], reference: Reference, epsilon: float, spp: Sequence[int] = ()) -> BiasEstimate:
    """Pixels, image mean and tiles of `images`, one a seed, against the reference; needs two images.

    `spp`: the samples per pixel of each image. With them a tile's variance is at least that of the reference's estimator at
    so many samples, so that missing what is rare and bright is no bias.

    Pixels: mean((A-R1)(B-R2) / (R^2+eps)) over all ordered pairs of different seeds A, B. Renders and reference halves are
    independent of each other, so all noise cancels in expectation. The sum over pairs is
    (sum(A)-kR1)(sum(A)-kR2) - sum((A-R1)(A-R2)), over k(k-1). Image mean and tiles: see `statistics.tiles`; the reference's
    variance is added to that of the images.
    """
    k = len(images)
    if k < 2:
        return BiasEstimate(math.nan, math.nan, 0)
    total = np.zeros_like(reference.mean)
    own = np.zeros_like(reference.mean)
    for image in images:
        total += image
        own += (image - reference.half_1) * (image - reference.half_2)
    products = ((total - k * reference.half_1) * (total - k * reference.half_2) - own) / (k * (k - 1))
    denominator = reference.mean**2 + epsilon
    products /= denominator
    weight = float((reference.mean**2 / denominator).mean())
    pixels = {"squared": float(products.mean()), "se": standard_error(products), "pairs": k * (k - 1) // 2, "weight": weight}
    return radiance_bias(radiance_sample(images, reference, spp))._replace(**pixels)


class RadianceSample(NamedTuple):
    """The tiles of images less the reference, and what differences are relative to: `truth` and `tile_scale` (rows, columns, 3)
    and `image_scale` (3,), in radiance."""

    tiles: TileSample
    truth: Image
    tile_scale: Image
    image_scale: Image


def radiance_sample(images: Sequence[Image], reference: Reference, spp: Sequence[int] = ()) -> RadianceSample:
    """What the tests on image mean and tiles look at; two images or more, `spp` as in `bias_estimate`."""
    least = expected_variance(reference, spp) if spp else None
    tiles = tile_sample((image - reference.mean for image in images), noise_of(reference), least)
    return RadianceSample(tiles, tile_means(reference.mean), tile_scale(reference.mean), image_scale(reference.mean))


def radiance_bias(sample: RadianceSample) -> BiasEstimate:
    """The estimate on image mean and tiles alone."""
    return bias_of(differences_of(sample.tiles), sample)


def bias_of(found: Differences, sample: RadianceSample) -> BiasEstimate:
    """`radiance_bias` from the differences of the sample's tiles."""
    image, tiles = relative(found.image, sample.image_scale), relative(found.tiles, sample.tile_scale)
    image_se = np.hypot(relative(found.image_se, sample.image_scale), ROUNDED)
    tiles_se = np.hypot(relative(found.tiles_se, sample.tile_scale), ROUNDED)
    tile_z, (x, y) = largest(abs(tiles) / tiles_se)
    worst = tiles[y // TILE, x // TILE]
    return BiasEstimate(
        math.nan,
        math.nan,
        0,
        difference=_farthest(image),
        image_z=float((abs(image) / image_se).max()),
        image_bound=float((abs(image) + IMAGE_Z * image_se).max()),
        tile_difference=_farthest(worst),
        tile_z=tile_z,
        tile_bound=largest(abs(tiles) + TILE_Z * tiles_se)[0],
        worst_tile=(x, y),
    )


def _farthest(channels: Image) -> float:
    return float(channels[np.argmax(abs(channels))])


def expected_variance(reference: Reference, spp: Sequence[int]) -> Image:
    """(h, w, 3): the variance of images of `spp` samples by the reference's estimator, averaged; too low for Sobol points."""
    return reference.variance * (reference.spp * float(np.mean(1 / np.asarray(spp, np.float64))))


def noise_of(reference: Reference) -> Image:
    """(h, w, 3): the variance of the reference's mean, larger where its halves differ by more than its pixels explain."""
    sizes = tile_sizes(reference.mean)
    halves = tile_means(reference.half_1 - reference.half_2) / 2
    return inflation(halves**2, tile_sums(reference.variance) / sizes**2) * reference.variance


def on_bias_floor(bias: BiasEstimate, corrected_error: float) -> bool:
    """Whether a significant bias makes up half or more of the error that is left: more samples will hardly help."""
    return bias.biased and bias.squared >= 0.5 * corrected_error


def too_good_per_sample(error_times_spp: Mapping[int, float], baseline: Mapping[int, float]) -> bool:
    """Whether error x samples is below the baseline estimator's by more than `TOO_GOOD`, by a 99 % interval over seeds.

    Both map seed (or block) to error x samples, of independent samples or of one sample each, with the same shader. An engine
    that needs fewer samples than the estimator it claims to run has another estimator, clamps, or denoises.
    """
    common = [key for key in baseline if key in error_times_spp]
    pairs = [(baseline[key], error_times_spp[key]) for key in common]
    # A difference of logarithms: the quotient of finite numbers may be zero or infinite.
    logs = [math.log(base) - math.log(other) for base, other in pairs if 0 < base < math.inf and 0 < other < math.inf]
    return bool(mean_interval(logs, 0.99).low > math.log(TOO_GOOD))
