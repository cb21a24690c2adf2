"""What `raybench verify --against` does: it bounds how far the images of engines lie apart, in the mean and in any tile."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from engines.choices import Choice
from engines.errors import ConfigError, RendererFailed, UnknownName
from engines.registry import is_known, known_names
from engines.scene import Scene
from harness.analysis.equivalence import bound, describe
from harness.config import paths
from harness.config.settings import SceneFile
from harness.console import consoles
from harness.measure.pool import Pool, WorkerFailed
from harness.measure.requests import ReferenceRequest
from harness.metrics import DEFAULT_MARGINS, Margins
from harness.processes import allow_here
from harness.settings import CellSettings, require_commands, require_imports
from harness.statistics import Equivalence, equivalence
from harness.statistics.equivalence import shared_alpha

COLOURS = {"identical": "green", "equivalent": "green", "unresolved": "yellow", "different": "bold red"}


class EquivalenceOptions(NamedTuple):
    """The command line: `replicates` independent images of `size` per engine, equivalent within `margins`."""

    scene: str
    engines: Sequence[str]
    replicates: int = 16
    spp: int = 16
    size: tuple[int, int] = (64, 64)
    shader: str = "path_tracer"
    margins: Margins = DEFAULT_MARGINS
    seed: int = 1
    same_seeds: bool = False
    allow_imports: bool = False
    allow_commands: bool = False
    allow_outside: bool = False
    parameters: Mapping[str, str] = MappingProxyType({})


def compare(options: EquivalenceOptions) -> int:
    """Prints a row for every pair of engines. Returns the exit code: 1 where a pair is different."""
    if len(options.engines) < 2:
        raise ConfigError(f"--engine {','.join(options.engines)}: two or more are needed, as in numpy,numba")
    if options.replicates < 2:
        raise ConfigError(f"--replicates {options.replicates}: two or more are needed")
    if not (0 < options.margins.image <= 1 and 0 < options.margins.tile <= 1):
        raise ConfigError(f"--margin {options.margins.image:g} --tile-margin {options.margins.tile:g}: must be in (0, 1]")
    allow_here(options.allow_imports)
    for name in options.engines:
        require_imports(name, options.allow_imports)
        require_commands(name, options.allow_commands)
        if not is_known(name):
            raise UnknownName("engine", name, known_names())
    path = paths.find("scenes", options.scene)
    file = SceneFile(options.scene, str(path), tuple(options.parameters.items()), options.allow_outside)
    scene, settings = file.load(options.allow_imports), settings_of(options)
    request = ReferenceRequest(file, scene.identity, settings, options.spp)
    apart = 0 if options.same_seeds else options.replicates
    with tempfile.TemporaryDirectory() as folder, Pool(options.allow_imports, Path(folder) / "worker.log") as pool:
        images = [
            _images(pool, name, request, options.seed + place * apart, options.replicates)
            for place, name in enumerate(options.engines)
        ]
    pairs = list(combinations(range(len(options.engines)), 2))
    alpha = shared_alpha(len(pairs))
    rows = [
        (options.engines[a], options.engines[b], equivalence(images[a], images[b], options.margins, alpha)) for a, b in pairs
    ]
    _show(scene, options, rows)
    return int(any(result.verdict == "different" for _, _, result in rows))


def settings_of(options: EquivalenceOptions) -> CellSettings:
    """The settings of every image."""
    width, height = options.size
    return CellSettings(Choice("auto"), None, 1, Choice(options.shader), Choice("random"), width, height)


def _images(pool: Pool, engine: str, request: ReferenceRequest, first: int, replicates: int) -> NDArray[np.float64]:
    """(replicates, height, width, 3) images with seeds from `first` on, rendered in a worker process.

    Raises `RendererFailed` for bad samples, and where the process died.
    """
    means, bad = [], 0
    try:
        for film, _ in pool.replicates(engine, request, range(first, first + replicates)):
            means.append(np.array(film.mean(), np.float64))
            bad += film.bad_samples
    except WorkerFailed as error:
        raise RendererFailed(f"{engine}: {error}") from error
    if bad:
        raise RendererFailed(f"{engine}: {bad} samples of its images are NaN or infinite: finite radiance is expected")
    images = np.stack(means)
    if not np.isfinite(images).all():
        raise RendererFailed(f"{engine}: its images are not finite")
    return images


def _show(scene: Scene, options: EquivalenceOptions, rows: Sequence[tuple[str, str, Equivalence]]) -> None:
    stdout, (width, height) = consoles()[0], options.size
    names = ("A", "B", "(B - A) / mean", "95 % interval", "means at most", "tiles at most", "verdict")
    table = Table(*names, box=None, header_style="dim", pad_edge=False)
    for first, second, result in rows:
        shares = [f"{100 * share:+.3f} %" for share in (result.difference, result.low, result.high)]
        table.add_row(
            first,
            second,
            shares[0],
            f"{shares[1]} to {shares[2]}",
            bound(result.image_bound),
            bound(result.tile_bound),
            f"[{COLOURS[result.verdict]}]{result.verdict}[/]",
        )
    stdout.print(table)
    for first, second, result in rows:
        stdout.print(f"{first} and {second} {describe(result)}.", markup=False, soft_wrap=True)
    if any(result.verdict == "unresolved" for _, _, result in rows):
        stdout.print("Four times as many --spp or --replicates halve a bound.", markup=False)
    image, tile = options.margins
    seeds = "in pairs of one seed" if options.same_seeds else "each with its own seed"
    note = (
        f"{scene.name}, {width}x{height}, {options.replicates} images of {options.spp} spp per engine, {seeds}. "
        f"Equivalent: the image means differ by at most {100 * image:g} % and no tile of 16x16 pixels by more than "
        f"{100 * tile:g} %, in any channel (95 %). Different: surely more than one of these, with 1 % false alarms for "
        f"{'the pair' if len(rows) == 1 else 'all pairs together'}."
    )
    stdout.print(note, style="dim", markup=False, soft_wrap=True)
