"""Do two engines make the same image? Bounds on the difference of the image means and of every tile, against margins.

A test that finds nothing proves nothing; a bound says how far apart the images can be. "Equivalent" is therefore a positive
verdict: both bounds lie within margins that were set beforehand (Schuirmann 1987).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from harness.metrics import DEFAULT_MARGINS, Margins
from harness.statistics.tiles import Differences, differences, image_scale, largest, relative, tile_scale

Array = NDArray[np.float64]

ALPHA = 0.01
"""Rate at which equal images are called different: Sidak's correction is over tiles, channels and comparisons."""
IMAGE_Z, TILE_Z = 1.96, 1.645
"""Standard errors that a bound of the image mean, and of a tile, lies beyond the difference that was seen."""
ROUNDING = 1e-3
"""Relative difference of a pixel that float32 arithmetic explains along its paths."""
ROUNDED_SHARE = 0.95
"""Share of the pixels that must agree up to `ROUNDING`: in the others rounding sent a path another way."""


EquivalenceVerdict = Literal["identical", "equivalent", "different", "unresolved"]


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Bounds on the difference B - A of two images, all as shares of the radiance.

    `difference` [`low`, `high`]: of the image means, in the channel with the largest bound, with a 95 % interval.
    `image_bound`: what the image means differ by at most; `tile_bound`: what any 16 x 16 tile differs by at most, `worst_tile`
    its first pixel (x, y). `same_pixels`: the share of pixels that agree up to rounding, in the pair with the fewest.
    `verdict`: identical (up to rounding, and equivalent), equivalent, different or unresolved. `alpha`: the rate at which
    equal images would be called different.
    """

    verdict: EquivalenceVerdict
    difference: float
    low: float
    high: float
    image_bound: float
    tile_bound: float
    worst_tile: tuple[int, int]
    image_margin: float
    tile_margin: float
    same_pixels: float = math.nan
    alpha: float = ALPHA

    @property
    def passed(self) -> bool:
        """Whether the images are shown to be the same within the margins."""
        return self.verdict in ("identical", "equivalent")


def equivalence(
    first: Sequence[Array] | Array,
    second: Sequence[Array] | Array,
    margins: Margins = DEFAULT_MARGINS,
    alpha: float = ALPHA,
    least_variance: Array | None = None,
) -> Equivalence:
    """Compares the images `first` (n, h, w, 3) and `second`, in pairs of one block; n at least 2.

    Blocks are independent of each other. The two images of a pair may share their noise, which then cancels, or not; and
    they may have different numbers of samples, also from block to block: the spread of the differences holds all of it.
    `least_variance`: see `tiles.differences`. Raises ValueError where shapes or numbers differ.
    """
    if len(first) != len(second) or len(first) < 2:
        raise ValueError(f"{len(first)} and {len(second)} images: two or more pairs are expected")
    shapes = {image.shape for image in (*first, *second)}
    if len(shapes) > 1:
        raise ValueError(f"images of shapes {shapes}: must be equal")
    images = (np.subtract(b, a, dtype=np.float64) for a, b in zip(first, second, strict=True))
    found = differences(images, least_variance=least_variance)
    level = sum(a + b for a, b in zip(first, second, strict=True)) / (2 * len(first))
    same = min(rounded_share(a, b) for a, b in zip(first, second, strict=True))
    judged = judge(found, np.asarray(level), margins, alpha)
    identical = judged.verdict == "equivalent" and same >= ROUNDED_SHARE
    return replace(judged, same_pixels=same, verdict="identical" if identical else judged.verdict)


def judge(found: Differences, level: Array, margins: Margins, alpha: float = ALPHA) -> Equivalence:
    """The verdict on differences of images whose mean radiance is `level` (h, w, 3)."""
    image, image_se = (relative(values, image_scale(level)) for values in (found.image, found.image_se))
    tiles, tiles_se = (relative(values, tile_scale(level)) for values in (found.tiles, found.tiles_se))
    channel = int(np.argmax(abs(image) + IMAGE_Z * image_se))
    difference, half = float(image[channel]), IMAGE_Z * float(image_se[channel])
    tile_bound, worst = largest(abs(tiles) + TILE_Z * tiles_se)
    image_bound = abs(difference) + half
    outside = [
        (abs(values) - sidak_z(alpha, values.size) * se).max() > margin
        for values, se, margin in ((image, image_se, margins.image), (tiles, tiles_se, margins.tile))
    ]
    within = image_bound <= margins.image and tile_bound <= margins.tile
    verdict: EquivalenceVerdict = "different" if any(outside) else "equivalent" if within else "unresolved"
    return Equivalence(
        verdict,
        difference,
        difference - half,
        difference + half,
        image_bound,
        tile_bound,
        worst,
        margins.image,
        margins.tile,
        alpha=alpha,
    )


def rounded_share(first: Array, second: Array) -> float:
    """The share of pixels that are the same up to rounding: that takes the same random numbers, or no noise at all."""
    limit = ROUNDING * np.maximum(abs(first), abs(second))
    return float(np.logical_and.reduce(abs(first - second) <= limit, axis=2).mean())


def sidak_z(alpha: float, tests: int) -> float:
    """Standard errors beyond which one of `tests` normal differences lies with probability `alpha` (Sidak 1967)."""
    return float(-ndtri(-math.expm1(math.log1p(-alpha) / tests) / 2))


def shared_alpha(comparisons: int) -> float:
    """The `alpha` of each of several comparisons that call equal images different with probability `ALPHA` together."""
    return -math.expm1(math.log1p(-ALPHA) / max(comparisons, 1))
