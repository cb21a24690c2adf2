"""Whether contenders make the same image, from the images that a run stored: pairs of engines, and what they rest on.

Every configuration has the same seeds, block by block. Engines that share samplers then share their noise, and the
difference of their images is known far better than either image: where both have pictures at the same number of
samples, means are compared in pairs of one seed. Pixels and tiles are compared as if seeds were independent, which is on
the safe side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from harness.statistics import Equivalence, equivalence
from harness.statistics.equivalence import MARGIN, shared_alpha
from harness.store.results import Contender, Event, Results, Settings

SIMILARITY_WEIGHTS = {"sampler": 16, "threads": 8, "accelerator": 4, "precision": 2, "label": 1}
"""What counts how much when the nearest relative among another engine's contenders is looked for."""
Images = Mapping[int, np.ndarray]


class Comparison(NamedTuple):
    """An equivalence, and what it rests on: images and samples per pixel of each side, and whether seeds were paired."""

    found: Equivalence
    replicates: tuple[int, int]
    spp: tuple[int, int]
    paired: bool


class EnginePair(NamedTuple):
    """Two engines on one scene under the same settings; `comparison` None where images are missing or do not vary."""

    first: Contender
    second: Contender
    comparison: Comparison | None

    @property
    def verdict(self) -> str:
        return self.comparison.found.verdict if self.comparison else "unknown"


class Replicates:
    """A contender's images, one a seed; the most recent few sets are kept in memory."""

    def __init__(self, results: Results, keep: int = 8) -> None:
        self.results, self.keep = results, keep
        self.held: dict[tuple[int, int | None], Images] = {}

    def of(self, contender: Contender, spp: int | None = None) -> Images:
        """Block -> (h, w, 3): two or more finite, distinct images at `spp` samples or at each cell's last; or nothing."""
        key = (id(contender), spp)
        if key not in self.held:
            while len(self.held) >= self.keep:
                self.held.pop(next(iter(self.held)))
            self.held[key] = self._load(contender, spp)
        else:
            self.held[key] = self.held.pop(key)
        return self.held[key]

    def _load(self, contender: Contender, spp: int | None) -> Images:
        found = {cell["block"]: self.results.image(last_pictured(cell, spp)) for cell in contender.done}
        images = {block: image for block, image in found.items() if image is not None and np.isfinite(image).all()}
        stack = list(images.values())
        alike = len(stack) > 1 and all(image.shape == stack[0].shape for image in stack)
        return images if alike and not np.array_equal(stack[0], stack[1]) else {}


def last_pictured(cell: Event, spp: int | None = None) -> Event:
    """The last checkpoint whose image was kept, or the one at `spp`; an empty one if there is none."""
    return next((p for p in reversed(cell["points"]) if p.get("image") and spp in (None, p["spp"])), {})


def common_spp(*contenders: Contender, pictured: bool = False) -> int | None:
    """The most samples at which every done cell of all of them has a checkpoint (and its image)."""
    sets = [{point["spp"] for point in cell["points"] if point.get("image") or not pictured}
            for contender in contenders for cell in contender.done]  # fmt: skip
    return max(set.intersection(*sets), default=None) if sets else None


def compared(first: Contender, second: Contender, images: Replicates, alpha: float) -> Comparison | None:
    """Their last images, or those at equal samples in pairs of one seed: whichever would see the smaller bias."""
    spp = common_spp(first, second, pictured=True)
    found = [_compared(first, second, images, alpha, at) for at in dict.fromkeys([None, spp])]
    usable = [comparison for comparison in found if comparison is not None]
    return min(usable, key=lambda comparison: comparison.found.detectable, default=None)


def _compared(
    first: Contender, second: Contender, images: Replicates, alpha: float, spp: int | None
) -> Comparison | None:  # fmt: skip
    ours, theirs = images.of(first, spp), images.of(second, spp)
    if spp is not None:
        shared = sorted(ours.keys() & theirs.keys())
        ours, theirs = ({block: side[block] for block in shared} for side in (ours, theirs))
    a, b = list(ours.values()), list(theirs.values())
    if min(len(a), len(b)) < 2 or a[0].shape != b[0].shape:
        return None
    paired = spp is not None
    samples = (spp, spp) if paired else (_typical_spp(first), _typical_spp(second))
    found = equivalence(np.stack(a), np.stack(b), alpha=alpha, paired=paired)
    return Comparison(found, (len(a), len(b)), samples, paired)


def _typical_spp(contender: Contender) -> int:
    return int(np.median([last_pictured(cell).get("spp", 0) for cell in contender.done]))


Known = Mapping[tuple[Settings, Settings], Comparison]


def engine_pairs(results: Results, images: Replicates, known: Known) -> list[EnginePair]:
    """Every pair of engines on the same scene, shader, size, sampler and machine: of each the nearest relatives.

    `known` has what was concluded before the images were given up.
    """
    groups: dict[tuple[str, ...], list[Contender]] = {}
    for contender in results.contenders:
        s = contender.settings
        if contender.done and not s.label:
            groups.setdefault((s.scene, s.shader, s.size, s.sampler, s.machine), []).append(contender)
    pairs = [pair for members in groups.values() for pair in _nearest(members)]
    alpha = shared_alpha(len(pairs))
    return [EnginePair(a, b, compared(a, b, images, alpha) or known.get((a.settings, b.settings))) for a, b in pairs]


def _nearest(members: Sequence[Contender]) -> Iterator[tuple[Contender, Contender]]:
    engines = list(dict.fromkeys(contender.settings.engine for contender in members))
    for a, b in combinations(engines, 2):
        ours, theirs = ([c for c in members if c.settings.engine == engine] for engine in (a, b))
        yield max(((x, y) for x in ours for y in theirs), key=lambda pair: similarity(*pair))


def similarity(one: Contender, other: Contender) -> int:
    """How much two contenders have in common, by the weights of `SIMILARITY_WEIGHTS`."""
    return sum(weight for axis, weight in SIMILARITY_WEIGHTS.items()
               if getattr(one.settings, axis) == getattr(other.settings, axis))  # fmt: skip


def describe_pair(pair: EnginePair) -> str:
    """What was found, in a sentence or two, with the numbers it rests on."""
    names = f"{pair.first.name} and {pair.second.name}"
    if pair.comparison is None:
        return f"{names}: not compared, for there are no two different images of each."
    found, (k, m), (n, o), paired = pair.comparison
    samples = f"{n} spp" if n == o else f"{n} and {o} spp"
    rests = f"{k} and {m} images of {samples}{', pairs of one seed' if paired else ''}"
    return f"{names} {describe(found)} ({rests})."


def describe(found: Equivalence, margin: float = MARGIN) -> str:
    """The verdict on two engines as the rest of a sentence, and the bias that would have been seen."""
    interval = f"between {percent(found.low)} and {percent(found.high)}"
    sentence = {
        "equivalent": f"make the same image: the means differ by {interval}, less than {100 * margin:g} %, and "
                      "neither pixels nor tiles stand out",
        "different": f"make different images: {'; '.join(_reasons(found, margin))}",
        "inconclusive": f"are not separated, nor shown to be equal: the means differ by {interval}, and only less than "
                        f"{100 * margin:g} % would count as equal",
    }[found.verdict]  # fmt: skip
    return f"{sentence}. A bias of {percent(found.detectable).removeprefix('+')} would have been seen"


def percent(share: float) -> str:
    """A share in percent with its sign; what is below a thousandth of a percent is as good as none."""
    return "0.001 %" if abs(share) < 1e-5 else f"{100 * share:+.2g} %"


def _reasons(found: Equivalence, margin: float) -> list[str]:
    """Which of the tests a pair failed."""
    reasons = []
    if not -margin < found.low <= found.high < margin and found.image_p < found.alpha:
        reasons.append(f"the means differ by {percent(found.difference)}")
    if found.tile_p < found.tile_threshold:
        reasons.append("tiles stand out")
    if found.pixel_p < found.pixel_threshold:
        reasons.append(f"{found.pixels_outside} values of pixels stand out")
    if found.ks_p < found.alpha:
        reasons.append("more tiles differ than chance allows")
    return reasons
