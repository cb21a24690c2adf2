"""What `raybench equivalence` does: it tests whether engines render the same image, by pixels, tiles and the whole image."""

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
from harness.analysis.equivalence import describe
from harness.config import paths
from harness.config.settings import require_commands, require_imports
from harness.console import allow_here, consoles
from harness.measure.pool import Pool, WorkerFailed
from harness.report.tables.model import number_text
from harness.statistics import Equivalence, equivalence
from harness.statistics.equivalence import shared_alpha

COLOURS = {"equivalent": "green", "inconclusive": "yellow", "different": "bold red"}


class EquivalenceOptions(NamedTuple):
    """The command line: `replicates` independent images of `size` per engine; means within `margin` (a share) are equal."""

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


def compare(options: EquivalenceOptions) -> int:
    """Prints a row for every pair of engines. Returns the exit code: 1 where a pair is different."""
    if len(options.engines) < 2:
        raise ConfigError(f"--engines {','.join(options.engines)}: two or more are needed, as in numpy,numba")
    if options.replicates < 2:
        raise ConfigError(f"--replicates {options.replicates}: two or more are needed")
    allow_here(options.allow_imports)
    for name in options.engines:
        require_imports(name, options.allow_imports)
        require_commands(name, options.allow_commands)
        if ":" not in name and not is_file(name) and name not in known_names():
            raise UnknownName("engine", name, known_names())
    path = paths.find("scenes", options.scene)
    scene, settings = load_scene(path, allow_imports=options.allow_imports), settings_of(options)
    request = {"scene_path": str(path), "scene_hash": scene.content_hash, "settings": settings, "spp": options.spp}
    with tempfile.TemporaryDirectory() as folder, Pool(options.allow_imports, Path(folder) / "worker.log") as pool:
        images = [
            _images(pool, name, request, options.seed + place * options.replicates, options.replicates)
            for place, name in enumerate(options.engines)
        ]
    pairs = list(combinations(range(len(options.engines)), 2))
    alpha = shared_alpha(len(pairs))
    rows = [
        (options.engines[a], options.engines[b], equivalence(images[a], images[b], options.margin, alpha)) for a, b in pairs
    ]
    _show(scene, options, rows)
    return int(any(found.verdict == "different" for _, _, found in rows))


def settings_of(options: EquivalenceOptions) -> dict[str, Any]:
    """The settings of every image, as a worker process reads them."""
    found = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", options.size)
    if found is None:
        raise ConfigError(f"--size {options.size}: must look like 64x64")
    width, height = int(found[1]), int(found[2])
    return {"width": width, "height": height, "shader": {"name": options.shader}, "sampler": {"name": "random"},
            "accelerator": {"name": "auto"}, "precision": None, "threads": 1}  # fmt: skip


def _images(pool: Pool, engine: str, request: Mapping[str, Any], first: int, replicates: int) -> NDArray[np.float64]:
    """(replicates, height, width, 3) images with seeds from `first` on, rendered in a worker process.

    No two engines share seeds. Raises `RendererFailed`, also where the process died.
    """
    try:
        films = pool.replicates(engine, request, range(first, first + replicates))
        images = np.stack([np.array(film.mean(), np.float64) for film, _ in films])
    except WorkerFailed as error:
        raise RendererFailed(f"{engine}: {error}") from error
    if not np.isfinite(images).all():
        raise RendererFailed(f"{engine}: its images are not finite")
    return images


def _show(scene: Scene, options: EquivalenceOptions, rows: Sequence[tuple[str, str, Equivalence]]) -> None:
    stdout = consoles()[0]
    names = ("A", "B", "pixels p", "tiles p", "KS p", "image p", "(B - A) / A", "90 % interval", "detectable", "verdict")
    table = Table(*names, box=None, header_style="dim", pad_edge=False)
    for first, second, found in rows:
        numbers = (found.pixel_p, found.tile_p, found.ks_p, found.image_p)
        shares = [f"{100 * share:+.3f} %" for share in (found.difference, found.low, found.high)]
        table.add_row(first, second, *map(number_text, numbers), shares[0], f"{shares[1]} to {shares[2]}",
                      f"{100 * found.detectable:.3f} %", f"[{COLOURS[found.verdict]}]{found.verdict}[/]")  # fmt: skip
    stdout.print(table)
    for first, second, found in rows:
        stdout.print(f"{first} and {second} {describe(found, options.margin)}.", markup=False, soft_wrap=True)
    if any(found.verdict == "inconclusive" for _, _, found in rows):
        stdout.print("Four times as many --spp or --replicates halve an interval.", markup=False)
    found = rows[0][2]
    note = (
        f"{scene.name}, {options.size}, {options.replicates} images of {options.spp} spp per engine, each with its own seed. "
        f"Different: p below {number_text(found.pixel_threshold)} for a pixel, {number_text(found.tile_threshold)} for a "
        f"tile, {number_text(found.alpha)} for all tiles (KS), or {number_text(found.alpha)} for the image with an interval "
        f"not within the margin of {100 * options.margin:g} %. Each of the four tests has a false alarm rate of 1 % for "
        f"{'the pair' if len(rows) == 1 else 'all pairs together'}. "
        "Detectable: the bias of the mean that is found with a power of 80 %."
    )
    stdout.print(note, style="dim", markup=False, soft_wrap=True)
