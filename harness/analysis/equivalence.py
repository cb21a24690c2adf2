"""Whether contestants make the same image, from the images that a run stored: pairs of engines, and what they rest on.

Images are compared in pairs of one block, in two ways. At equal samples: the most that all blocks of both have; every
configuration has the same seeds, so engines that share samplers share their noise, and it cancels. At unequal samples: the
last image of each, which is the better one where the noise is not shared. Of the two the one with the smaller standard error
is taken, whatever it finds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from harness.metrics import Reference
from harness.statistics import Equivalence, equivalence
from harness.statistics.bias import expected_variance
from harness.statistics.equivalence import shared_alpha
from harness.store.records import Cell, Point, Settings
from harness.store.results import Contestant, Results

SIMILARITY_WEIGHTS = {"sampler": 16, "threads": 8, "accelerator": 4, "precision": 2, "label": 1}
"""What counts how much when the nearest relative among another engine's contestants is looked for."""
Images = Mapping[int, np.ndarray]


class Comparison(NamedTuple):
    """An equivalence, and what it rests on: images and samples per pixel of each side, and whether the samples are equal."""

    found: Equivalence
    replicates: tuple[int, int]
    spp: tuple[int, int]
    paired: bool


class EnginePair(NamedTuple):
    """Two engines on one scene under the same settings; `comparison` None where images are missing or do not vary."""

    first: Contestant
    second: Contestant
    comparison: Comparison | None

    @property
    def verdict(self) -> str:
        return self.comparison.found.verdict if self.comparison else "unknown"


class Replicates:
    """A contestant's images, one a seed; the most recent few sets are kept in memory."""

    def __init__(self, results: Results, keep: int = 8) -> None:
        self.results, self.keep = results, keep
        self.held: dict[tuple[int, int | None], Images] = {}
        self.references: dict[str, Reference | None] = {}

    def reference(self, contestant: Contestant) -> Reference | None:
        """The reference that a contestant was compared with; None where it is missing."""
        key = str(contestant.done[0].reference_id)
        if key not in self.references:
            self.references = {key: self.results.reference(key)}
        return self.references[key]

    def of(self, contestant: Contestant, spp: int | None = None) -> Images:
        """Block -> (h, w, 3): two or more finite, distinct images at `spp` samples or at each cell's last; or nothing."""
        key = (id(contestant), spp)
        if key not in self.held:
            while len(self.held) >= self.keep:
                self.held.pop(next(iter(self.held)))
            self.held[key] = self._load(contestant, spp)
        else:
            self.held[key] = self.held.pop(key)
        return self.held[key]

    def _load(self, contestant: Contestant, spp: int | None) -> Images:
        found = {cell.block: self.results.image(last_pictured(cell, spp)) for cell in contestant.done}
        images = {block: image for block, image in found.items() if image is not None and np.isfinite(image).all()}
        stack = list(images.values())
        alike = len(stack) > 1 and all(image.shape == stack[0].shape for image in stack)
        return images if alike and not np.array_equal(stack[0], stack[1]) else {}


def last_pictured(cell: Cell, spp: int | None = None) -> Point | None:
    """The last checkpoint whose image was kept, or the one at `spp`; None if there is none."""
    return next((point for point in reversed(cell.points) if point.image and spp in (None, point.spp)), None)


def pictured_spp(cells: Iterable[Cell], spp: int | None = None) -> list[int]:
    """The samples of `last_pictured` of each cell that has one."""
    return [point.spp for cell in cells if (point := last_pictured(cell, spp)) is not None]


def common_spp(*contestants: Contestant, pictured: bool = False) -> int | None:
    """The most samples at which every done cell of all of them has a checkpoint (and its image)."""
    return max(shared_spp(*contestants, pictured=pictured), default=None)


def shared_spp(*contestants: Contestant, pictured: bool = False) -> set[int]:
    """The samples at which every done cell of all of them has a checkpoint (and its image)."""
    sets = [
        {point.spp for point in cell.points if point.image or not pictured}
        for contestant in contestants
        for cell in contestant.done
    ]
    return set.intersection(*sets) if sets else set()


def compared(first: Contestant, second: Contestant, images: Replicates, alpha: float) -> Comparison | None:
    """Their images at equal samples or their last ones, whichever has the smaller standard error."""
    spp = common_spp(first, second, pictured=True)
    found = [_compared(first, second, images, alpha, at) for at in dict.fromkeys([spp, None])]
    usable = [comparison for comparison in found if comparison is not None]
    return min(usable, key=lambda comparison: comparison.found.high - comparison.found.low, default=None)


def _compared(first: Contestant, second: Contestant, images: Replicates, alpha: float, spp: int | None) -> Comparison | None:
    ours, theirs = images.of(first, spp), images.of(second, spp)
    shared = sorted(ours.keys() & theirs.keys())
    a, b = [ours[block] for block in shared], [theirs[block] for block in shared]
    if len(shared) < 2 or a[0].shape != b[0].shape:
        return None
    samples = [pictured_spp([cell for cell in each.done if cell.block in shared], spp) for each in (first, second)]
    paired = samples[0] == samples[1]
    least = None if paired else _least_variance(images.reference(first), a[0].shape, samples)
    found = equivalence(a, b, images.results.config.equivalence.margins, alpha, least)
    typical = int(np.median(samples[0])), int(np.median(samples[1]))
    return Comparison(found, (len(a), len(b)), typical, paired)


def _least_variance(reference: Reference | None, shape: tuple[int, ...], samples: Sequence[Sequence[int]]) -> np.ndarray | None:
    """What images of unequal samples differ by at least, for the side of few samples may have missed what is rare."""
    if reference is None or reference.mean.shape != shape:
        return None
    return expected_variance(reference, samples[0]) + expected_variance(reference, samples[1])


def same_images(before: Results, one: Contestant, after: Results, other: Contestant, comparisons: int) -> Equivalence | None:
    """The images of a contestant in two results folders at equal samples, in pairs of one block, as one of so many comparisons;
    None without two pairs."""
    spp = common_spp(one, other, pictured=True)
    if spp is None:
        return None
    ours, theirs = Replicates(before, keep=1).of(one, spp), Replicates(after, keep=1).of(other, spp)
    shared = sorted(ours.keys() & theirs.keys())
    if len(shared) < 2 or ours[shared[0]].shape != theirs[shared[0]].shape:
        return None
    pairs = [ours[block] for block in shared], [theirs[block] for block in shared]
    return equivalence(*pairs, after.config.equivalence.margins, shared_alpha(comparisons))


Known = Mapping[tuple[Settings, Settings], Comparison]


def engine_pairs(results: Results, images: Replicates, known: Known) -> list[EnginePair]:
    """Every pair of engines on the same scene, shader, size, sampler and machine: of each the nearest relatives.

    `known` has what was concluded before the images were given up.
    """
    groups: dict[object, list[Contestant]] = {}
    for contestant in results.contestants:
        s = contestant.settings
        if contestant.done and not s.label:
            groups.setdefault((s.scene, contestant.cells[0].reference_shader, s.size, s.sampler, s.machine), []).append(
                contestant
            )
    pairs = [pair for members in groups.values() for pair in _nearest(members)]
    alpha = shared_alpha(len(pairs))
    return [EnginePair(a, b, compared(a, b, images, alpha) or known.get((a.settings, b.settings))) for a, b in pairs]


def _nearest(members: Sequence[Contestant]) -> Iterator[tuple[Contestant, Contestant]]:
    engines = list(dict.fromkeys(contestant.settings.engine for contestant in members))
    for a, b in combinations(engines, 2):
        ours, theirs = ([c for c in members if c.settings.engine == engine] for engine in (a, b))
        yield max(((x, y) for x in ours for y in theirs), key=lambda pair: similarity(*pair))


def similarity(one: Contestant, other: Contestant) -> int:
    """How much two contestants have in common, by the weights of `SIMILARITY_WEIGHTS`."""
    return sum(
        weight for axis, weight in SIMILARITY_WEIGHTS.items() if getattr(one.settings, axis) == getattr(other.settings, axis)
    )


def rests_on(comparison: Comparison) -> str:
    """`5 pairs of images at 64 spp`."""
    n, o = comparison.spp
    samples = f"at {n} spp" if comparison.paired else f"at {n} and {o} spp" if n != o else f"at some {n} spp"
    return f"{comparison.replicates[0]} pairs of images {samples}"


def describe(found: Equivalence) -> str:
    """The verdict on two engines as the rest of a sentence, with its bounds."""
    margins = f"{100 * found.image_margin:g} % and {100 * found.tile_margin:g} %"
    same = f"{math.floor(1000 * found.same_pixels) / 10:g}" if not math.isnan(found.same_pixels) else ""
    x, y = found.worst_tile
    found_bounds = bounds(found.image_bound, found.tile_bound)
    return {
        "identical": f"draw the same numbers, and their images are identical up to rounding in {same} % of the pixels: "
        f"{found_bounds}",
        "equivalent": f"make equivalent images: {found_bounds}",
        "different": f"make different images: the image means differ by {percent(found.difference)} "
        f"[{percent(found.low)}, {percent(found.high)}], the tile at pixel ({x}, {y}) by up to "
        f"{bound(found.tile_bound)}, and {margins} are allowed",
        "unresolved": f"are neither shown to make the same image nor different ones: {found_bounds}, and {margins} are allowed",
    }[found.verdict]


def bounds(image: float, tile: float) -> str:
    """`image means differ by at most 0.08 %, no tile by more than 1.9 %`."""
    return f"image means differ by at most {bound(image)}, no tile by more than {bound(tile)}"


def bound(share: float) -> str:
    """An upper bound in percent, rounded up to two digits."""
    if not 0 < share < math.inf:
        return "0 %" if share == 0 else "an unknown amount"
    unit = 10.0 ** (math.floor(math.log10(100 * share)) - 1)
    return f"{math.ceil(100 * share / unit - 1e-9) * unit:.6g} %"


def percent(share: float) -> str:
    """A share in percent with its sign, to two digits or whole."""
    return f"{100 * share:+{'.0f' if abs(share) >= 0.995 else '.2g'}} %" if share else "0 %"
