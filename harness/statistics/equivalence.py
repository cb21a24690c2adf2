"""Do two engines make the same image? Welch tests a pixel, an 8x8 tile and the whole image, and a margin test.

Per-pixel tests alone pass a 1 % brightness error, a mean alone passes errors that cancel: hence three scales. A
test that finds nothing proves nothing: hence TOST, whose "equivalent" is a positive verdict, and the smallest bias
that could have been seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import smirnov, stdtr, stdtrit  # scipy.stats takes a second to import

Array = NDArray[np.float64]

TILE = 8
ALPHA = 0.01
"""Family-wise false-alarm rate of each scale (Sidak over its tests)."""
MARGIN = 0.01
"""TOST: images whose means differ by less than this share of the mean count as equivalent."""
ROUNDING = 1e-5
"""Relative difference that float32 arithmetic explains where there is no noise at all."""


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Smallest p values against their Sidak thresholds, and the whole image's relative difference (B - A) / A.

    `low`, `high`: 90 % interval of the relative difference, inside the margin exactly when both one-sided tests reject.
    `detectable`: the relative bias of the image mean found with 80 % power. `ks_p`: one-sided Kolmogorov-Smirnov on the
    tiles' p values, small where too many are small. `alpha`: the false-alarm rate of each scale that was allowed.
    """

    pixel_p: float
    pixel_threshold: float
    pixels_outside: int
    tile_p: float
    tile_threshold: float
    image_p: float
    ks_p: float
    difference: float
    low: float
    high: float
    detectable: float
    verdict: str
    alpha: float = ALPHA


def equivalence(
    first: ArrayLike, second: ArrayLike, margin: float = MARGIN, alpha: float = ALPHA, paired: bool = False
) -> Equivalence:
    """Compares replicate means `first` (k, h, w, 3) and `second` (m, h, w, 3), independent seeds, k and m at least 2.

    `paired`: first[i] and second[i] share a seed, and perhaps their noise. The image means are then compared by their
    differences; pixels and tiles as if they were independent, which finds less, never more.

    Verdict: `different` where pixels or tiles reject (Sidak, `alpha` a scale), where the tiles' p values are too small
    as a whole (KS), or where the image mean differs significantly and is not within the margin; `equivalent` where
    TOST puts the mean within `margin`; else `inconclusive`. Heavy-tailed pixels make Welch's test conservative.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if a.shape[1:] != b.shape[1:] or min(len(a), len(b)) < 2 or (paired and len(a) != len(b)):
        raise ValueError(f"replicates {a.shape} and {b.shape}: two or more of one shape are wanted on each side")
    pixel = welch_p(a, b, _tile_variance)
    tile = welch_p(tile_means(a), tile_means(b))
    image_a, image_b = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
    if paired:  # Student's test of the differences is Welch's test against a sample without spread
        image_a, image_b = np.full_like(image_a, image_a.mean()), image_a.mean() + (image_b - image_a)
    image = float(welch_p(image_a, image_b))
    ks = too_small_p(tile)
    difference, low, high, detectable = _relative_difference(image_a, image_b)
    thresholds = [1 - (1 - alpha) ** (1 / p.size) for p in (pixel, tile)]
    within = -margin < low and high < margin
    rejected = pixel.min() < thresholds[0] or tile.min() < thresholds[1] or ks < alpha
    different = rejected or (image < alpha and not within)
    verdict = "different" if different else "equivalent" if within else "inconclusive"
    outside = int((pixel < thresholds[0]).sum())
    return Equivalence(float(pixel.min()), thresholds[0], outside, float(tile.min()), thresholds[1], image, ks,
                       difference, low, high, detectable, verdict, alpha)  # fmt: skip


def too_small_p(found: Array) -> float:
    """p of the one-sided Kolmogorov-Smirnov test that p values are as large as uniform ones (Birnbaum and Tingey 1951)."""
    ordered = np.sort(found, axis=None)
    above = (np.arange(1, ordered.size + 1) / ordered.size - ordered).max()
    return float(smirnov(ordered.size, max(float(above), 0.0)))


def shared_alpha(comparisons: int) -> float:
    """The `alpha` of each of several comparisons that raise a false alarm a scale with probability `ALPHA` together."""
    return -math.expm1(math.log1p(-ALPHA) / max(comparisons, 1))


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


def _relative_difference(first: Array, second: Array) -> tuple[float, float, float, float]:
    """(mean(B)-mean(A)) / mean(A), its 90 % Welch interval, and the difference seen with 80 % power at 5 %."""
    scale = abs(float(first.mean()))
    if scale == 0:
        return (0.0, 0.0, 0.0, 0.0) if not second.any() else (math.inf, -math.inf, math.inf, math.inf)
    var_a, var_b = first.var(ddof=1) / len(first), second.var(ddof=1) / len(second)
    se = math.sqrt(var_a + var_b)
    difference = float(second.mean() - first.mean())
    if se == 0:
        return difference / scale, difference / scale, difference / scale, 0.0
    freedom = se**4 / (var_a**2 / (len(first) - 1) + var_b**2 / (len(second) - 1))
    half = float(stdtrit(freedom, 0.95)) * se
    detectable = (stdtrit(freedom, 0.975) + stdtrit(freedom, 0.8)) * se
    return difference / scale, (difference - half) / scale, (difference + half) / scale, float(detectable / scale)
