"""How often the rules of this package are wrong, and what they find, on synthetic contestants made of a run's own noise.

Times are residuals of ln seconds, drawn anew for every contestant and block, and what persists of a contestant over all
blocks, drawn from the run's persistent spread; images enter as tile means. What judges them are `race` and `bias_of`, which
judge the run.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.statistics.bias import RadianceSample, bias_of
from harness.statistics.ratios import FEWEST_BLOCKS, MARGIN, PersistentSpread, Race, persistent_spread, race, twin_pairs
from harness.statistics.tiles import Differences, differences_of, relative

Array = NDArray[np.float64]

SLOWER = (0.05, 0.20)
"""By how much the slower contestants are slower."""
BIASED_IMAGE, BIASED_TILE = 0.01, 0.10
"""By how much the biased ones are: all over, and in one tile."""
FOUND = 0.8
"""The share of repetitions in which the smallest bias is found."""
BIASES = tuple(float(f"{10 ** (step / 10):.2g}") / 1e4 for step in range(41))
"""0.01 % to 100 %, ten a decade: between these the smallest bias is looked for."""


class RaceNoise(NamedTuple):
    """A race as calibration needs it: `residuals` (m,) of ln seconds, scaled; contestants and blocks; `spread`, that of the run
    on this machine; `clock`, the clock's resolution over the shortest time."""

    residuals: Array
    contestants: int
    blocks: int
    spread: PersistentSpread
    clock: float = 0.0


class RaceFigures(NamedTuple):
    """Shares of the repetitions: a single winner among identical contestants; a true ratio within its 95 % interval; `slower`
    said of one that is slower by each of `SLOWER`. `false_differences`: how often `faster` or `slower` is said in a race of
    identical contestants; None in archives that were made before it was counted."""

    false_winners: float
    coverage: float
    power: tuple[float, float]
    false_differences: float | None = None


class BiasFigures(NamedTuple):
    """Smallest bias that is found in `FOUND` of the repetitions, all over and in one tile, as shares of the radiance; infinite
    beyond 100 %. Shares of the repetitions in which `BIASED_IMAGE` and `BIASED_TILE` are found, and no bias is."""

    smallest_image: float
    smallest_tile: float
    found_image: float
    found_tile: float
    false_alarms: float


def scaled_residuals(logs: Array) -> Array | None:
    """Residuals of contestant + block of ln seconds (k, n), flat, scaled by sqrt(n k / ((n - 1)(k - 1))), by which the fit has
    narrowed them; None for less than two contestants or three blocks."""
    k, n = logs.shape
    if k < 2 or n < FEWEST_BLOCKS:
        return None
    residuals = logs - logs.mean(axis=1, keepdims=True) - logs.mean(axis=0) + logs.mean()
    return (residuals * math.sqrt(n * k / ((n - 1) * (k - 1)))).ravel()


def race_figures(
    noises: Sequence[RaceNoise], repetitions: int, rng: np.random.Generator, margin: float = MARGIN
) -> RaceFigures:
    """Runs each kind of synthetic race `repetitions` times, with the noise of each of `noises` (one or more) in turn.

    The second contestant is the slower one; all are compared with the first. Each race has as many twins as the run, from which
    its spread is found anew.
    """
    winners, differences, covered, intervals = 0, 0, 0, 0
    power = [0] * len(SLOWER)
    for repetition in range(repetitions):
        noise = noises[repetition % len(noises)]
        found = _race(noise, 0.0, rng, margin)
        winners += int(found.possible_winner.sum()) == 1
        differences += sum(ratio.verdict in ("faster", "slower") for ratio in found.ratios)
        kinds = [(found, 0.0)]
        for at, share in enumerate(SLOWER):
            found = _race(noise, math.log1p(share), rng, margin)
            power[at] += found.ratios[0].verdict == "slower"
            kinds.append((found, share))
        for found, share in kinds:
            truths = [1 / (1 + share), *[1.0] * (len(found.ratios) - 1)]
            covered += sum(ratio.low <= truth <= ratio.high for ratio, truth in zip(found.ratios, truths, strict=True))
            intervals += len(found.ratios)
    five, twenty = (count / repetitions for count in power)
    return RaceFigures(winners / repetitions, covered / intervals, (five, twenty), differences / repetitions)


def _race(noise: RaceNoise, slower: float, rng: np.random.Generator, margin: float) -> Race:
    """A synthetic race. Its twins repeat contestants that take no part in it, as most twins of a run do."""
    k, twins = noise.contestants, noise.spread.twins
    logs = rng.choice(noise.residuals, (k + 2 * twins, noise.blocks))
    if twins:
        logs += rng.normal(0.0, math.sqrt(noise.spread.variance / 2), (len(logs), 1))
    logs[1] += slower
    ranked = np.arange(len(logs)) < k
    pairs = twin_pairs(logs, logs, [(row, row + twins) for row in range(k, k + twins)], ranked=ranked, clock=noise.clock)
    logs = logs[:k]
    return race(logs, logs, [(row, 0) for row in range(1, k)], persistent_spread(pairs), clock=noise.clock, margin=margin)


def bias_figures(samples: Sequence[RadianceSample], repetitions: int, rng: np.random.Generator) -> BiasFigures:
    """Which biases are found in `repetitions` synthetic contestants, with the image noise of each of `samples` (one or more) in
    turn. The tile is another in each."""
    smallest: tuple[list[float], list[float]] = ([], [])
    false_alarms = 0
    for repetition in range(repetitions):
        sample = _unbiased(samples[repetition % len(samples)], rng)
        found = differences_of(sample.tiles)
        false_alarms += _biased(sample, found, 0.0)
        one_tile = np.zeros_like(sample.truth)
        one_tile[int(rng.integers(len(one_tile))), int(rng.integers(one_tile.shape[1]))] = 1.0
        for kind, shape in enumerate((sample.truth, one_tile * sample.tile_scale)):
            at = bisect_left(BIASES, True, key=lambda bias, shape=shape: _biased(sample, found, bias * shape))
            smallest[kind].append(BIASES[at] if at < len(BIASES) else math.inf)
    image, tile = (float(np.quantile(values, FOUND, method="inverted_cdf")) for values in smallest)
    found_image, found_tile = (
        sum(value <= share for value in values) / repetitions
        for values, share in zip(smallest, (BIASED_IMAGE, BIASED_TILE), strict=True)
    )
    return BiasFigures(image, tile, found_image, found_tile, false_alarms / repetitions)


def _unbiased(sample: RadianceSample, rng: np.random.Generator) -> RadianceSample:
    """New noise for every block and tile, and a new error of the reference, which blocks have in common.

    Residuals of tile means are drawn in units of the standard error that their pixels give, from those of all tiles: three to
    seven of a single tile would be too few.
    """
    tiles = sample.tiles
    n = len(tiles.means)
    scale = np.sqrt(tiles.within)
    residuals = relative((tiles.means - tiles.means.mean(axis=0)) * math.sqrt(n / (n - 1)), np.where(scale > 0, scale, np.inf))
    pool = residuals[:, (scale > 0).any(axis=2)].reshape(-1, 3)
    drawn = pool[rng.integers(len(pool), size=tiles.means.shape[:3])] if len(pool) else 0.0
    common = 0.0 if tiles.fixed is None else rng.normal(size=tiles.fixed.shape) * np.sqrt(tiles.fixed)
    return sample._replace(tiles=tiles._replace(means=np.broadcast_to(drawn * scale + common, tiles.means.shape)))


def _biased(sample: RadianceSample, found: Differences, bias: Array | float) -> bool:
    """Whether a flag is raised with `bias`, in radiance, added to every block: means move, and variances stay."""
    weights = sample.tiles.sizes / sample.tiles.sizes.sum()
    moved = found._replace(tiles=found.tiles + bias, image=found.image + (bias * weights).sum(axis=(0, 1)))
    return bool(bias_of(moved, sample).flags)
