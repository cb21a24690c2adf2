"""References: converged images with their own error known.

A reference is the mean of an even number of independent images ("replicates", each under its own seed). The even ones
make one half, the odd ones the other; the variance of every pixel is the spread of the replicates, which holds for
quasi-random samplers too. On disk it is a film whose samples are the replicates:

    results/references/<scene hash>/<id>/film-0032.npz    sums, squares, even sums, counts after 32 replicates
                                         meta.json        what was asked, progress, checksum, provenance
                                         reference.exr    for eyes: mean, variance, both halves

One that is interrupted goes on where it was; one of more samples starts from the largest that is there with the same
seeds, and is the same to the bit as one made at once.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from engines.errors import ConfigError
from engines.film import Film
from harness import machine
from harness.identity import digest
from harness.pool import WorkerFailed, film_of
from harness.store import write_json

if TYPE_CHECKING:
    from harness.metrics import Reference

META = "meta.json"
SAVE_EVERY_SECONDS = 20.0
Report = Callable[[int, int], None]
"""Told (replicates done, replicates wanted)."""


class Images(Protocol):
    """Who renders replicates: `pool.Pool` here, `cluster.Cluster` on other machines."""

    def replicates(self, engine: str, request: Mapping[str, Any], seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """The image under each seed, in order, with the seconds it took. Raises `WorkerFailed`."""
        ...


@dataclass(frozen=True, slots=True)
class Certifier:
    """A second engine that is to make the same image; `why_not` says why it cannot."""

    engine: str
    version: str
    settings: Mapping[str, Any]
    why_not: str | None


@dataclass(frozen=True, slots=True)
class ReferenceWanted:
    """A reference that cells need: `asked` is the preimage of its id, `settings` what the engine gets."""

    scene_name: str
    scene_path: str
    scene_hash: str
    asked: Mapping[str, Any]
    settings: Mapping[str, Any]
    certifier: Certifier | None = None

    @property
    def reference_id(self) -> str:
        return digest(self.asked)

    @property
    def family(self) -> str:
        """The same for references that differ in the number of replicates alone."""
        return digest({key: value for key, value in self.asked.items() if key != "replicates"})

    @property
    def spp(self) -> int:
        return self.asked["replicates"] * self.asked["replicate_spp"]

    def describe(self) -> str:
        """Scene, size and samples in a few words."""
        return f"{self.scene_name} {self.asked['width']}x{self.asked['height']} {self.spp} spp"

    def folder(self, root: Path) -> Path:
        return root / self.scene_hash[:16] / self.reference_id


def ready(wanted: ReferenceWanted, root: Path) -> bool:
    """Whether it is on disk, whole and fresh; one that is damaged or stale is refused with what to do."""
    folder = wanted.folder(root)
    if not (folder / META).exists():
        return False
    meta = _meta(folder)
    _refuse_stale(folder, meta, wanted.reference_id, wanted.scene_hash)
    return bool(meta["complete"])


def make(wanted: ReferenceWanted, root: Path, pool: Images, report: Report) -> dict[str, Any]:
    """Renders what is missing and returns its metadata. Raises `WorkerFailed` when the engine fails."""
    folder = wanted.folder(root)
    film, seconds = _start(wanted, root)
    first, count = film.spp, wanted.asked["replicates"]
    if first < count:
        report(first, count)
        saved = monotonic()
        seeds = range(wanted.asked["seed"] + first, wanted.asked["seed"] + count)
        for replicate, more in replicates(wanted, seeds, pool):
            seconds += more
            _add(film, replicate, wanted)
            if monotonic() - saved > SAVE_EVERY_SECONDS:
                _save(folder, wanted, film, seconds)
                saved = monotonic()
            if film.spp < count:
                report(film.spp, count)
    meta = _save(folder, wanted, film, seconds)
    film.save(folder / "reference.exr", provenance=_text(meta))
    report(count, count)
    return meta


def replicates(
    wanted: ReferenceWanted, seeds: Iterable[int], pool: Images, engine: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Iterator[tuple[Film, float]]:  # fmt: skip
    """The reference's image under each seed, with the seconds it took; by another engine where one is named."""
    request = {
        "scene_path": wanted.scene_path, "scene_hash": wanted.scene_hash, "settings": dict(settings or wanted.settings),
        "spp": wanted.asked["replicate_spp"],
    }  # fmt: skip
    yield from pool.replicates(engine or wanted.asked["engine"], request, list(seeds))


def read(folder: Path, reference_id: str, scene_hash: str) -> Reference:
    """The arrays of a complete reference; refused when its scene, its id or its checksum is another."""
    from harness.metrics import Reference

    meta = _meta(folder)
    _refuse_stale(folder, meta, reference_id, scene_hash)
    if not meta["complete"]:
        raise ConfigError(f"{folder}: this reference was not finished: run the experiment again")
    film = _film(folder, meta)
    spp = meta["asked"]["replicates"] * meta["asked"]["replicate_spp"]
    return Reference(film.mean(), film.half(0), film.half(1), film.variance_of_mean(), spp)


def event(wanted: ReferenceWanted, root: Path, results: Path) -> dict[str, Any]:
    """What `events.jsonl` says of a reference."""
    meta = _meta(wanted.folder(root))
    return {
        "event": "reference", "scene": wanted.scene_name, "scene_hash": wanted.scene_hash,
        "reference_id": wanted.reference_id, "folder": os.path.relpath(wanted.folder(root), results),
        "engine": wanted.asked["engine"], "spp": wanted.spp, "width": wanted.asked["width"],
        "height": wanted.asked["height"], "shader": wanted.asked["shader"], "seconds": meta["seconds"],
    }  # fmt: skip


def copy_small(source: Path, target: Path) -> None:
    """Copies a reference with its arrays in float32, compressed. Its metadata names what is there."""
    meta = _meta(source)
    target.mkdir(parents=True, exist_ok=True)
    with np.load(source / meta["file"]) as arrays:
        small = {key: array.astype(np.float32) if array.dtype == np.float64 else array for key, array in arrays.items()}
    np.savez_compressed(target / meta["file"], **small)
    write_json(target / META, {**meta, "sha256": _checksum(target / meta["file"])})


# --- on disk --------------------------------------------------------------------------------------------------------


def _start(wanted: ReferenceWanted, root: Path) -> tuple[Film, float]:
    """The film to go on with and the seconds it took: this reference's own, the largest relative's, or an empty one."""
    best: tuple[int, Path, dict[str, Any]] | None = None
    for path in sorted(wanted.folder(root).parent.glob(f"*/{META}")):
        try:
            meta = _meta(path.parent)
        except ConfigError:
            continue
        done = meta.get("done", 0)
        related = meta.get("family") == wanted.family and done <= wanted.asked["replicates"]
        if related and (best is None or done > best[0]):
            best = done, path.parent, meta
    if best is None:
        return Film(wanted.asked["width"], wanted.asked["height"]), 0.0
    return _film(best[1], best[2]), best[2]["seconds"]


def _add(film: Film, replicate: Film, wanted: ReferenceWanted) -> None:
    image = replicate.mean()
    if not np.isfinite(image).all():
        raise WorkerFailed(f"reference of {wanted.scene_name}: the engine's image is not finite")
    film.add(image)


def _save(folder: Path, wanted: ReferenceWanted, film: Film, seconds: float) -> dict[str, Any]:
    """Writes arrays, then the metadata that names them, then removes older arrays: a crash leaves one or the other."""
    folder.mkdir(parents=True, exist_ok=True)
    name = f"film-{film.spp:04d}.npz"
    with (folder / f"{name}.new").open("wb") as file:
        np.savez(
            file, sums=film.sums, squares=film.squares, even_sums=film.even_sums, counts=film.counts, bad_samples=0
        )
        file.flush()
        os.fsync(file.fileno())
    os.replace(folder / f"{name}.new", folder / name)
    meta = {
        "reference_id": wanted.reference_id, "family": wanted.family, "scene": wanted.scene_name,
        "scene_hash": wanted.scene_hash, "asked": dict(wanted.asked), "done": film.spp,
        "complete": film.spp == wanted.asked["replicates"], "file": name, "sha256": _checksum(folder / name),
        "seconds": seconds, "time": datetime.now(UTC).isoformat(timespec="seconds"), "machine": machine.provenance(),
    }  # fmt: skip
    write_json(folder / META, meta)
    for old in folder.glob("film-*"):
        if old.name != name:
            old.unlink()
    return meta


def _film(folder: Path, meta: Mapping[str, Any]) -> Film:
    path = folder / meta["file"]
    if not path.exists() or _checksum(path) != meta["sha256"]:
        raise ConfigError(f"{path}: missing, or its checksum is not the recorded one: remove {folder} to make it anew")
    return film_of(path)


def _meta(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / META).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{folder / META}: cannot be read: {error}: remove {folder} to make it anew") from error


def _refuse_stale(folder: Path, meta: Mapping[str, Any], reference_id: str, scene_hash: str) -> None:
    if meta["scene_hash"] != scene_hash:
        raise ConfigError(f"{folder}: stale: the scene has changed since this reference was made: remove the folder")
    if meta["reference_id"] != reference_id or digest(meta["asked"]) != reference_id:
        raise ConfigError(f"{folder}: stale: it holds another reference than {reference_id}: remove the folder")


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _text(meta: Mapping[str, Any]) -> dict[str, str]:
    """Metadata for an image's header."""
    return {key: json.dumps(meta[key]) for key in ("reference_id", "scene", "scene_hash", "asked", "time")}
