"""Imported scenes against Mitsuba itself: `python -m tests.benchmarks.imported_scenes FILE... [--engines numba numpy=16]`.

Mitsuba takes each XML file as it is, the other engines what the importer makes of it, all with a path tracer of the same
depth without roulette, independent random numbers and a box filter. The blocks of all take turns. Shown are the bounds of the
equivalence rules on the image mean and on tiles of 16 x 16 pixels, and paths per second, each ratio from the pairs of one turn.
`name=spp` gives an engine another number of samples per pixel and block.

With `--image FILE.exr`, of another renderer, the first engine is compared with that instead, of which each pixel of ours
covers a whole number. Another filter moves light across edges, so that tiles of 16 x 16 pixels with contrast are left out.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

import engines
from engines.image import read_image
from harness.statistics.equivalence import Margins, equivalence

PEER = "mitsuba"
MARGINS = Margins(image=0.01, tile=0.05)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
TILE = 16
CONTRAST = 0.15
"""Standard deviation over mean above which a tile has an edge."""


class Contestant:
    """A warm renderer with the image and the seconds of every block."""

    def __init__(self, word: str, scene: engines.Scene, settings: dict[str, Any], spp: int) -> None:
        self.name, _, own = word.partition("=")
        self.spp = int(own or spp)
        chosen = engines.Settings(**settings, precision=None if self.name == "numpy" else "float32")
        engine = engines.engine(self.name)
        if reason := engine.why_not(scene, chosen):
            raise engines.Unsupported(reason)
        self._renderer = engine.prepare(scene, chosen)
        self._renderer.warm_up()
        self._sums = self._renderer.render(1).sums.copy()
        self.images: list[np.ndarray] = []
        self.seconds: list[float] = []

    def render(self) -> None:
        """One block: samples that no other block has."""
        begin = time.perf_counter()
        sums = self._renderer.render(self.spp).sums
        self.seconds.append(time.perf_counter() - begin)
        self.images.append((sums - self._sums) / self.spp)
        self._sums = sums.copy()

    def rates(self) -> list[float]:
        """Paths per second of every block."""
        height, width = self._sums.shape[:2]
        return [width * height * self.spp / seconds for seconds in self.seconds]


def size_of(scene: engines.Scene, width: int | None) -> tuple[int, int]:
    own = scene.camera.resolution
    return own if width is None else (width, max(1, round(width * own[1] / own[0])))


def compare(file: str, given: argparse.Namespace) -> None:
    scene = engines.load_scene(file, natively=True)
    width, height = size_of(scene, given.width)
    depth = given.depth or (scene.shader or {}).get("max_depth", 6)
    settings = {
        "width": width,
        "height": height,
        "threads": given.threads,
        "sampler": "random",
        "shader": {"name": "path_tracer", "max_depth": depth, "rr_depth": 1_000_000},
    }
    print(f"{file}: {width} x {height}, depth {depth}, {given.blocks} blocks of {given.spp} spp")
    found: list[Contestant] = []
    for word in (PEER, *given.engines):
        try:
            found.append(Contestant(word, scene, settings, given.spp))
        except engines.RaybenchError as problem:
            print(f"  {word:12} {problem}")
    for block in range(given.blocks):
        for contestant in found[:: -1 if block % 2 else 1]:
            contestant.render()
    peer = next((contestant for contestant in found if contestant.name == PEER), None)
    for contestant in found:
        line = f"  {contestant.name:12}{statistics.median(contestant.rates()) / 1e6:9.3f} million paths/s"
        if peer is not None and contestant is not peer:
            ratios = [one / other for one, other in zip(contestant.rates(), peer.rates(), strict=True)]
            same = equivalence(peer.images, contestant.images, MARGINS)
            line += f"{statistics.median(ratios):7.2f} ({min(ratios):.2f} to {max(ratios):.2f})   {same.verdict}: mean"
            line += f" {same.difference:+.3%} (at most {same.image_bound:.3%}), tiles at most {same.tile_bound:.2%},"
            line += f" worst at {same.worst_tile}"
        print(line, flush=True)
        if given.output is not None:
            name = f"{Path(file).resolve().parent.name}_{contestant.name}.npy"
            np.save(given.output / name, np.mean(contestant.images, axis=0))


def compare_image(file: str, given: argparse.Namespace) -> None:
    """Luminance of an image of another renderer, and of ours with Sobol points, by tiles without edges."""
    scene = engines.load_scene(file)
    theirs = read_image(given.image) @ LUMINANCE
    width, height = size_of(scene, given.width)
    columns, rows = theirs.shape[1] // width, theirs.shape[0] // height
    theirs = theirs.reshape(height, rows, width, columns).mean((1, 3))
    settings = engines.Settings(
        width,
        height,
        sampler="sobol",
        threads=given.threads,
        precision="float32",
        shader={"name": "path_tracer", "max_depth": given.depth or 64, "rr_depth": 1_000_000},
    )
    ours = engines.engine(given.engines[0]).prepare(scene, settings).render(given.spp).mean() @ LUMINANCE
    tiles = [image.reshape(height // TILE, TILE, width // TILE, TILE).swapaxes(1, 2) for image in (ours, theirs)]
    means = [tile.mean((2, 3)) for tile in tiles]
    even = tiles[1].std((2, 3)) < CONTRAST * means[1]
    difference = (means[0] / means[1] - 1)[even]
    print(f"{file}: {width} x {height}, depth {given.depth or 64}, {given.engines[0]}, {given.spp} spp, against {given.image}")
    print(f"  mean {ours.mean() / theirs.mean() - 1:+.3%}; of {difference.size} of {even.size} tiles, those without edges:")
    worst, most = np.abs(difference).max(), np.quantile(np.abs(difference), 0.95)
    print(f"  median {np.median(difference):+.3%}, 95 % within {most:.2%}, worst {worst:.2%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", help="XML files of Mitsuba's, or names of scenes")
    parser.add_argument("--engines", nargs="*", default=["numba", "embree"])
    parser.add_argument("--width", type=int, default=None, help="pixels; by default as the file has it")
    parser.add_argument("--spp", type=int, default=64, help="of a block")
    parser.add_argument("--blocks", type=int, default=8)
    parser.add_argument("--depth", type=int, default=None, help="segments; by default as the file has it")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--output", type=Path, default=None, help="folder for the images, as .npy")
    parser.add_argument("--image", type=Path, default=None, help="an EXR of another renderer, to compare with")
    given = parser.parse_args()
    for file in given.files:
        (compare if given.image is None else compare_image)(file, given)


if __name__ == "__main__":
    main()
