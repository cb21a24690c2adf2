"""What `raybench equivalence` does: do engines make the same image of a scene, at the scale of pixels, tiles and image?"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from engines.errors import ConfigError, RendererFailed, UnknownName
from engines.registry import is_file, known_names
from engines.scene import Scene, load_scene
from harness.analysis.equivalence import conclusion
from harness.config import paths as catalog
from harness.config.settings import require_commands, require_imports
from harness.console import allow_here, consoles
from harness.measure.pool import Pool, WorkerFailed
from harness.report.tables.model import number_text
from harness.statistics import Equivalence, equivalence
from harness.statistics.equivalence import shared_alpha

COLOURS = {"equivalent": "green", "inconclusive": "yellow", "different": "bold red"}


class Asked(NamedTuple):
    """The command line: how many independent images of which size, and the margin within which means are the same."""

    scene: str
    engines: Sequence[str]
    replicates: int = 16
    spp: int = 16
    size: str = "64x64"
    shader: str = "path_tracer"
    margin: float = 0.01
    seed: int = 1
    allow_imports: bool = False
    allow_commands: bool = False


def compare(asked: Asked) -> int:
    """Prints a row for every pair of engines; 1 where a pair is different."""
    if len(asked.engines) < 2:
        raise ConfigError(f"--engines {','.join(asked.engines)}: two or more are wanted, as in numpy,numba")
    if asked.replicates < 2:
        raise ConfigError(f"--replicates {asked.replicates}: two or more are wanted")
    allow_here(asked.allow_imports)
    for name in asked.engines:
        require_imports(name, asked.allow_imports)
        require_commands(name, asked.allow_commands)
        if ":" not in name and not is_file(name) and name not in known_names():
            raise UnknownName("engine", name, known_names())
    path = catalog.find("scenes", asked.scene)
    scene, settings = load_scene(path, allow_imports=asked.allow_imports), settings_of(asked)
    request = {"scene_path": str(path), "scene_hash": scene.content_hash, "settings": settings, "spp": asked.spp}
    with tempfile.TemporaryDirectory() as folder, Pool(asked.allow_imports, Path(folder) / "worker.log") as pool:
        images = [
            _images(pool, name, request, asked.seed + place * asked.replicates, asked.replicates)
            for place, name in enumerate(asked.engines)
        ]
    pairs = list(combinations(range(len(asked.engines)), 2))
    alpha = shared_alpha(len(pairs))
    rows = [
        (asked.engines[a], asked.engines[b], equivalence(images[a], images[b], asked.margin, alpha)) for a, b in pairs
    ]
    _show(scene, asked, rows)
    return int(any(found.verdict == "different" for _, _, found in rows))


def settings_of(asked: Asked) -> dict[str, Any]:
    """The settings of every image, as a worker takes them."""
    found = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", asked.size)
    if found is None:
        raise ConfigError(f"--size {asked.size}: must look like 64x64")
    width, height = int(found[1]), int(found[2])
    return {"width": width, "height": height, "shader": {"name": asked.shader}, "sampler": {"name": "random"},
            "accelerator": {"name": "auto"}, "precision": None, "threads": 1}  # fmt: skip


def _images(pool: Pool, engine: str, request: Mapping[str, Any], first: int, replicates: int) -> NDArray[np.float64]:
    """(replicates, height, width, 3) images with seeds of their own: no two engines share random numbers.

    They are rendered in a process of the engine's own. Raises `RendererFailed`, also where that process died.
    """
    try:
        films = pool.replicates(engine, request, range(first, first + replicates))
        images = np.stack([np.array(film.mean(), np.float64) for film, _ in films])
    except WorkerFailed as error:
        raise RendererFailed(f"{engine}: {error}") from error
    if not np.isfinite(images).all():
        raise RendererFailed(f"{engine}: its images are not finite")
    return images


def _show(scene: Scene, asked: Asked, rows: Sequence[tuple[str, str, Equivalence]]) -> None:
    stdout = consoles()[0]
    names = (
        "A",
        "B",
        "pixels p",
        "tiles p",
        "KS p",
        "image p",
        "(B - A) / A",
        "90 % interval",
        "detectable",
        "verdict",
    )
    table = Table(*names, box=None, header_style="dim", pad_edge=False)
    for first, second, found in rows:
        numbers = (found.pixel_p, found.tile_p, found.ks_p, found.image_p)
        shares = [f"{100 * share:+.3f} %" for share in (found.difference, found.low, found.high)]
        table.add_row(first, second, *map(number_text, numbers), shares[0], f"{shares[1]} to {shares[2]}",
                      f"{100 * found.detectable:.3f} %", f"[{COLOURS[found.verdict]}]{found.verdict}[/]")  # fmt: skip
    stdout.print(table)
    for first, second, found in rows:
        stdout.print(f"{first} and {second} {conclusion(found, asked.margin)}.", markup=False, soft_wrap=True)
    if any(found.verdict == "inconclusive" for _, _, found in rows):
        stdout.print("Four times --spp, or --replicates, halve an interval.", markup=False)
    found = rows[0][2]
    words = (
        f"{scene.name}, {asked.size}, {asked.replicates} images of {asked.spp} spp an engine, all of seeds of their own. "
        f"Different: p below {number_text(found.pixel_threshold)} for a pixel, {number_text(found.tile_threshold)} for a "
        f"tile, {number_text(found.alpha)} for the tiles together (KS), or {number_text(found.alpha)} for the image with "
        f"an interval that leaves the margin of {100 * asked.margin:g} %; each of the four gives "
        f"{'the pair' if len(rows) == 1 else 'all pairs together'} a false alarm of 1 %. "
        "Detectable: the bias of the mean that is seen with 80 % power."
    )
    stdout.print(words, style="dim", markup=False, soft_wrap=True)
