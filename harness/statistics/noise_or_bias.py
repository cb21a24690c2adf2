"""Is an error noise or bias? Over seeds: Welch's test in every tile, and how much of the error all seeds have in common at each
spatial frequency.

Jung, Hanika and Dachsbacher 2020, "Detecting bias in Monte Carlo renderers using Welch's t-test"; Celarek, Jakob, Wimmer and
Lehtinen 2019, "Quantifying the error of light transport algorithms".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr  # scipy.stats takes a second to import

from harness.metrics import Reference
from harness.statistics.bias import noise_of

Array = NDArray[np.float64]
FEWEST_SEEDS = 3
"""Below this many images there is no test."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear sRGB (Rec. 709)."""
TILES, LEAST_TILE, LARGEST_TILE = 1024, 4, 16
"""About so many square tiles an image has, of so many pixels along a side: their means are nearer to normal than pixels are."""
RINGS = 12
KS_FACTOR = 1.63
"""Over the root of n: what the distance of n independent uniform numbers from their distribution exceeds in 1 % of cases
(Kolmogorov 1933)."""
CLEAR = 4.0
"""Standard errors above zero from which on seeds have an error in common."""


class Uniformity(NamedTuple):
    """How far p values are from uniform, as those of unbiased images are.

    `distance` is that of Kolmogorov and Smirnov; chance leaves it below `limit` in 99 % of cases, for as many independent tiles
    as the spread of the images' means over seeds says that there are (`independent` of `tiles`). `small` is the share of p
    values below 0.05.
    """

    distance: float
    limit: float
    small: float
    tiles: int
    independent: float

    @property
    def uniform(self) -> bool:
        return self.distance <= self.limit


class Welch(NamedTuple):
    """`p` (rows, columns): the two-sided p value of each tile of `side` x `side` pixels, NaN where nothing varies; and how far
    all of them are from uniform."""

    p: Array
    side: int
    uniformity: Uniformity


class Spectrum(NamedTuple):
    """(k,) over rings of spatial frequency, in cycles per pixel: the squared error over the squared mean luminance of the
    reference. White noise is a flat line.

    `power` is the mean over seeds, between `low` and `high`; `common` what the errors of all seeds have in common, whose
    expectation is the squared bias (it may be negative), with its standard error `common_se`. Neither holds the reference's
    noise.
    """

    frequency: Array
    power: Array
    low: Array
    high: Array
    common: Array
    common_se: Array

    @property
    def biased(self) -> NDArray[np.bool_]:
        """Rings in which the common error stands `CLEAR` standard errors above zero."""
        return self.common > CLEAR * self.common_se


def luminance(image: Array) -> Array:
    """(h, w) of (h, w, 3)."""
    return np.asarray(image @ LUMINANCE, np.float64)


def deviation(images: Sequence[Array]) -> Array:
    """(h, w): the standard deviation over seeds of each pixel's luminance; two images (h, w, 3) or more."""
    return np.asarray(np.std([luminance(image) for image in images], axis=0, ddof=1), np.float64)


def welch(images: Sequence[Array], reference: Reference) -> Welch:
    """Welch's test of `images` (h, w, 3), one a seed, against the reference, on the mean luminance of tiles.

    t = (A - R) / sqrt(s^2 / n + v) with s^2 over the n images and v the variance of the reference's mean, which counts as
    known: it rests on many samples. Raises ValueError for fewer than `FEWEST_SEEDS` images.
    """
    n = len(images)
    if n < FEWEST_SEEDS:
        raise ValueError(f"{n} images: {FEWEST_SEEDS} or more are expected")
    height, width = images[0].shape[:2]
    side = min(max(round(math.sqrt(height * width / TILES)), LEAST_TILE), LARGEST_TILE, height, width)
    tiles = np.stack([_tiles(luminance(image), side) for image in images])
    noise = _tiles((np.sqrt(noise_of(reference)) @ LUMINANCE) ** 2, side) / side**2
    spread = tiles.var(axis=0, ddof=1)
    own = spread / n
    variance = own + noise
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (tiles.mean(axis=0) - _tiles(luminance(reference.mean), side)) / np.sqrt(variance)
        freedom = variance**2 / (own**2 / (n - 1))
        p = np.where(spread > 0, 2 * stdtr(freedom, -abs(t)), np.nan)
        scores = ((tiles - tiles.mean(axis=0)) / np.sqrt(spread))[:, spread > 0]
    return Welch(p, side, uniformity(p[np.isfinite(p)], scores))


def uniformity(p: Array, scores: Array) -> Uniformity:
    """How far `p` (m,) is from uniform. `scores` (n, m): the same tiles' deviations from their mean over n seeds, in standard
    deviations; where tiles share noise, the means of seeds spread more than those of m independent tiles."""
    count = p.size
    if count == 0:
        return Uniformity(math.nan, math.nan, math.nan, 0, 0.0)
    steps = np.arange(count + 1) / count
    ordered = np.sort(p)
    distance = float(max((steps[1:] - ordered).max(), (ordered - steps[:-1]).max()))
    independent = count / max(1.0, count * float(scores.mean(axis=1).var(ddof=1)))
    return Uniformity(distance, KS_FACTOR / math.sqrt(independent), float((p < 0.05).mean()), count, independent)


def spectrum(images: Sequence[Array], reference: Reference) -> Spectrum:
    """The error of `images` (h, w, 3), one a seed, over spatial frequency; two images or more.

    The common error is the mean of Re(conj(F(A - R1)) F(B - R2)) over ordered pairs of different seeds: as for `bias_estimate`,
    all noise cancels in expectation. Its standard error follows from the noise's power, of images and reference, and from the
    number of frequencies in a ring: fewer count where a few pixels have most of the noise, for then frequencies share it.
    """
    k, (height, width) = len(images), images[0].shape[:2]
    scale = float(luminance(reference.mean).mean()) or 1.0
    truth, *halves = (luminance(image) / scale for image in (reference.mean, reference.half_1, reference.half_2))
    frequencies = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width)[None, :]).ravel()
    edges = np.geomspace(1 / max(height, width), 0.5, RINGS + 1)
    ring = np.searchsorted(edges, frequencies, side="right") - 1
    inside = (frequencies >= edges[0] * (1 - 1e-9)) & (frequencies <= 0.5)
    ring = np.clip(ring, 0, RINGS - 1)[inside]
    modes = np.bincount(ring, minlength=RINGS).astype(np.float64)

    def rings(values: Array) -> Array:
        with np.errstate(invalid="ignore"):
            return np.bincount(ring, values.ravel()[inside], RINGS) / modes

    def transformed(error: Array) -> NDArray[np.complex128]:
        return np.fft.fft2(error, norm="ortho")

    noise = float(((np.sqrt(noise_of(reference)) @ LUMINANCE) ** 2).mean()) / scale**2
    power, sums, own = [], [np.zeros((height, width), np.complex128) for _ in halves], np.zeros((height, width))
    for image in images:
        light = luminance(image) / scale
        power.append(rings(np.square(abs(transformed(light - truth)), dtype=np.float64)) - noise)
        both = [transformed(light - half) for half in halves]
        own += (both[0].conj() * both[1]).real
        sums = [total + part for total, part in zip(sums, both, strict=True)]
    pairs = k * (k - 1)
    common = rings(((sums[0].conj() * sums[1]).real - own) / pairs)
    mean = np.mean(power, axis=0)
    spread = mean - np.maximum(common, 0.0)
    spread = np.maximum(spread, max(float(np.nanmedian(spread)), 0.0))  # rings of few frequencies may be quiet by luck
    error = np.sqrt(2 * (spread**2 / pairs + 2 * noise * spread / k + 2 * noise**2) / np.maximum(modes / _gathering(images), 1))
    known = modes > 0
    rows = np.sqrt(edges[:-1] * edges[1:]), mean, np.min(power, axis=0), np.max(power, axis=0), common, error
    return Spectrum(*(array[known] for array in rows))


def _gathering(images: Sequence[Array]) -> float:
    """How much more the variance of pixels is gathered in a few than if all had the same: mean(v^2) / mean(v)^2, at least 1."""
    variance = deviation(images) ** 2
    mean = float(variance.mean())
    own = 1 + 2 / (len(images) - 1)  # what estimates of equal variances have
    return max(float((variance**2).mean()) / mean**2 / own, 1.0) if mean > 0 else 1.0


def _tiles(values: Array, side: int) -> Array:
    """The means of `side` x `side` pixels of `values` (h, w); a rest at the right and lower edge is left out."""
    rows, columns = (size // side for size in values.shape)
    return values[: rows * side, : columns * side].reshape(rows, side, columns, side).mean(axis=(1, 3))
