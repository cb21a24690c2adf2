"""The mean difference of images over blocks, in tiles and as a whole, each with its standard error.

A tile has 16 x 16 pixels, and every channel is taken on its own. Three to seven blocks give a tile's own spread two to six
degrees of freedom, which bounds little. The spread of each of its 256 pixels, summed, gives hundreds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc  # scipy.stats takes a second to import

Array = NDArray[np.float64]

TILE = 16
DARKEST = 0.1
"""A tile darker than this share of the image's mean is compared with that share instead of its own radiance."""
SHARED_NOISE_P = 1e-3
"""Below this p value (chi-squared) the image means spread more over blocks than tiles do: their own spread is taken."""


class Differences(NamedTuple):
    """Mean differences in radiance with standard errors: `tiles`, `tiles_se` (rows, columns, 3), `image`, `image_se` (3,).

    `blocks` is how many images each side has.
    """

    tiles: Array
    tiles_se: Array
    image: Array
    image_se: Array
    blocks: int


class TileSample(NamedTuple):
    """What the images of n blocks say of their tiles: `means` (n, rows, columns, 3), one tile mean a block; `within`
    (rows, columns, 3), the variance of a block's tile mean by the spread of its pixels; `sizes` (rows, columns, 1), pixels.

    `fixed` and `least` (rows, columns, 3) are variances of tile means, see `tile_sample` and `differences`.
    """

    means: Array
    within: Array
    sizes: Array
    fixed: Array | None = None
    least: Array | None = None


def tile_sample(
    images: Iterable[Array], fixed_variance: Array | None = None, least_variance: Array | None = None
) -> TileSample:
    """The tiles of `images` (h, w, 3) that come one by one. `fixed_variance` (h, w, 3) is added: that of what all blocks have
    in common, as of a reference; `least_variance` is as in `differences`. Raises ValueError for less than two images."""
    means = []
    mean: Array = np.zeros((1, 1, 1))
    squares: Array = np.zeros((1, 1, 1))
    for count, image in enumerate(images, 1):
        delta = image - mean
        mean = mean + delta / count
        squares = squares + delta * (image - mean)  # Welford 1962: a small spread survives a large mean
        means.append(tile_means(image))
    if len(means) < 2:
        raise ValueError(f"{len(means)} images: two or more are expected on each side")
    sizes = tile_sizes(mean)
    fixed, least = (None if v is None else tile_sums(v) / sizes**2 for v in (fixed_variance, least_variance))
    return TileSample(np.stack(means), tile_sums(squares) / (len(means) - 1) / sizes**2, sizes, fixed, least)


def differences(images: Iterable[Array], least_variance: Array | None = None) -> Differences:
    """What the mean of `images`, each a difference (h, w, 3) of one block, says about tiles and image; two or more.

    The variance of a tile mean is F sum(s^2) / (n N^2) over its N pixels, with s^2 over the n blocks and
    F = max(1, variance of the tile means between blocks / (sum(s^2) / N^2)), averaged over tiles: above 1 where neighbouring
    pixels share noise. `least_variance` (h, w, 3) is what s^2 is known to be at least: a tile whose few samples missed all
    that is rare and bright has too small a spread and too small a mean at once. Raises ValueError for less than two images.
    """
    return differences_of(tile_sample(images, least_variance=least_variance))


def differences_of(sample: TileSample) -> Differences:
    """`differences` from tile means."""
    n = len(sample.means)
    within, weights = sample.within, sample.sizes / sample.sizes.sum()
    factor = inflation(sample.means.var(axis=0, ddof=1), within)
    image_within = _of_image(within, weights)
    if sample.least is not None:
        within = np.maximum(within, sample.least)
        image_within = np.maximum(image_within, _of_image(sample.least, weights))
    image_within = factor * image_within
    image_means = (sample.means * weights).sum(axis=(1, 2))
    image_between = image_means.var(axis=0, ddof=1)
    ratio = image_between / np.where(image_within > 0, image_within, 1.0)
    shared = chdtrc(n - 1, ratio * (n - 1)) < SHARED_NOISE_P
    tiles_variance = factor * within / n
    image_variance = np.where(shared, image_between, image_within) / n
    if sample.fixed is not None:
        tiles_variance = tiles_variance + sample.fixed
        image_variance = image_variance + _of_image(sample.fixed, weights)
    return Differences(sample.means.mean(axis=0), np.sqrt(tiles_variance), image_means.mean(axis=0), np.sqrt(image_variance), n)


def _of_image(variances: Array, weights: Array) -> Array:
    """(3,): the variance of the image mean from those of tile means with their shares of the pixels."""
    return np.asarray((variances * weights**2).sum(axis=(0, 1)), np.float64)


def inflation(between: Array, within: Array) -> float:
    """F: how far variances `between` exceed those that pixels `within` the tiles explain, averaged over tiles; at least 1."""
    noisy = within > 0
    return max(1.0, float((between[noisy] / within[noisy]).mean())) if noisy.any() else 1.0


def tile_scale(image: Array) -> Array:
    """(rows, columns, 3): what a tile's difference is relative to, in radiance: the tile's channel or the mean of its
    channels, whichever is larger, and no less than `DARKEST` of the image's mean."""
    return np.maximum(_scale(tile_means(image)), DARKEST * abs(float(image.mean())))


def image_scale(image: Array) -> Array:
    """(3,): what the difference of image means is relative to: the channel or the mean of all, whichever is larger."""
    return _scale(image.mean(axis=(0, 1)))


def _scale(means: Array) -> Array:
    return np.maximum(abs(means), abs(means.mean(axis=-1, keepdims=True)))


def relative(difference: Array, scale: Array | float) -> Array:
    """difference / scale; 0 where both are 0, infinite where the scale alone is."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(difference == 0, 0.0, np.asarray(difference / scale, np.float64))


def largest(bounds: Array) -> tuple[float, tuple[int, int]]:
    """The largest of tiles' bounds (rows, columns, 3), and the first pixel (x, y) of its tile."""
    row, column, _ = (int(index) for index in np.unravel_index(int(bounds.argmax()), bounds.shape))
    return float(bounds.max()), (column * TILE, row * TILE)


def family_z(z: float, tests: int) -> float:
    """The z that `tests` independent tests take to raise a false alarm as seldom as one test at `z` (Sidak 1967)."""
    from scipy.special import ndtri

    alone = math.erfc(z / math.sqrt(2))
    return float(-ndtri(-math.expm1(math.log1p(-alone) / tests) / 2))


# --- tiles ----------------------------------------------------------------------------------------------------------


def tile_means(image: Array) -> Array:
    """(rows, columns, 3) means over TILE x TILE pixels of `image` (h, w, 3); narrow last ones join their neighbours."""
    return tile_sums(image) / tile_sizes(image)


def tile_sums(image: Array) -> Array:
    """(rows, columns, 3) sums over the same tiles."""
    edges_y, edges_x = _edges(image.shape[0]), _edges(image.shape[1])
    return np.asarray(np.add.reduceat(np.add.reduceat(image, edges_y, axis=0), edges_x, axis=1), np.float64)


def tile_sizes(image: Array) -> Array:
    """(rows, columns, 1): the pixels of each tile."""
    heights, widths = (np.diff(np.append(_edges(size), size)) for size in image.shape[:2])
    return np.outer(heights, widths)[:, :, None].astype(np.float64)


def _edges(size: int) -> NDArray[np.int64]:
    return np.arange(max(size // TILE, 1)) * TILE
