"""Welch tests at three scales, for tests of engines: sharper than the bounds of `harness.statistics.equivalence`, which say how
far images may lie apart, for one wrong pixel is enough.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

Array = NDArray[np.float64]
TILE = 8
ROUNDING = 1e-5
"""Relative difference that float32 arithmetic explains where there is no noise at all."""


class ImageTests(NamedTuple):
    """Smallest p values against their Sidak thresholds; `difference` (B - A) / A of the means, and the relative bias of the
    mean that is found with 80 % power."""

    pixel_p: float
    pixel_threshold: float
    tile_p: float
    tile_threshold: float
    image_p: float
    difference: float
    detectable: float
    alpha: float
    margin: float

    @property
    def different(self) -> bool:
        """Whether one of the three scales finds a difference; of means, one of more than `margin`."""
        means = self.image_p < self.alpha and abs(self.difference) > self.margin
        return self.pixel_p < self.pixel_threshold or self.tile_p < self.tile_threshold or means


def image_tests(a: Array, b: Array, alpha: float, margin: float = 0.0) -> ImageTests:
    """Compares replicates (k, h, w, 3) and (m, h, w, 3) of independent seeds, with `alpha` false alarms a scale."""
    pixel, tile = welch_p(a, b, _tile_variance), welch_p(tile_means(a), tile_means(b))
    means = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
    thresholds = [1 - (1 - alpha) ** (1 / p.size) for p in (pixel, tile)]
    scale, freedom = abs(float(means[0].mean())), min(len(a), len(b)) - 1
    se = math.sqrt(sum(mean.var(ddof=1) / len(mean) for mean in means))
    detectable = float((stdtrit(freedom, 0.975) + stdtrit(freedom, 0.8)) * se) / scale
    difference = float(means[1].mean() - means[0].mean()) / scale
    return ImageTests(
        float(pixel.min()),
        thresholds[0],
        float(tile.min()),
        thresholds[1],
        float(welch_p(*means)),
        difference,
        detectable,
        alpha,
        margin,
    )


def welch_p(first: Array, second: Array, least: Callable[[Array], Array] | None = None) -> Array:
    """Two-sided p values of Welch's t test (Welch 1947) along axis 0, of the shape of one replicate.

    `least(variance)` gives a lower bound for the variances. Without any spread, p is 1 for values equal up to float32
    rounding and 0 for others.
    """
    k, m = len(first), len(second)
    mean_a, mean_b = first.mean(axis=0), second.mean(axis=0)
    var_a, var_b = first.var(axis=0, ddof=1) / k, second.var(axis=0, ddof=1) / m
    if least is not None:
        var_a, var_b = np.maximum(var_a, least(var_a)), np.maximum(var_b, least(var_b))
    total = var_a + var_b
    rounding = ROUNDING * (abs(mean_a) + abs(mean_b)) / 2
    noisy = total > rounding**2
    safe = np.where(noisy, total, 1.0)
    freedom = safe**2 / np.maximum(var_a**2 / (k - 1) + var_b**2 / (m - 1), 1e-300)
    p = 2 * stdtr(np.maximum(freedom, 1.0), -abs(mean_a - mean_b) / np.sqrt(safe))
    return np.where(noisy, p, np.where(abs(mean_a - mean_b) <= 10 * rounding, 1.0, 0.0))


def _tile_variance(variance: Array) -> Array:
    """Each pixel's mean variance over its tile (h, w, 3).

    Few replicates of skewed noise that missed the bright samples are too low in mean and in variance at once, which
    makes Welch's t huge. Neighbours rarely miss together.
    """
    means = tile_means(variance[None])[0]
    rows = np.minimum(np.arange(variance.shape[0]) // TILE, means.shape[0] - 1)
    columns = np.minimum(np.arange(variance.shape[1]) // TILE, means.shape[1] - 1)
    return means[np.ix_(rows, columns)][:, :, None]


def tile_means(images: Array) -> Array:
    """(k, rows, columns) means over channels and TILE x TILE pixels; narrow last ones join its neighbour."""
    grey = images.mean(axis=3)
    rows, columns = (max(size // TILE, 1) for size in grey.shape[1:])
    edges_y, edges_x = np.arange(rows) * TILE, np.arange(columns) * TILE
    sums: Array = np.asarray(np.add.reduceat(np.add.reduceat(grey, edges_y, axis=1), edges_x, axis=2), np.float64)
    heights, widths = np.full((rows, 1), TILE), np.full((1, columns), TILE)
    heights[-1], widths[0, -1] = grey.shape[1] - edges_y[-1], grey.shape[2] - edges_x[-1]
    return sums / (heights * widths)
