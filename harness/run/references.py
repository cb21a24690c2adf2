"""References: converged images with their own error known.

A reference is the mean of an even number of independent images ("replicates", each under its own seed). The even ones
make one half, the odd ones the other; the variance of every pixel is the spread of the replicates, which holds for
quasi-random samplers too. On disk it is a film whose samples are the replicates:

    <references>/<scene hash>/<id>/film-0032.npz    sums, squares, even sums, counts after 32 replicates
                                   reference.json   spec, progress, checksum, provenance
                                   reference.exr    for eyes: mean, variance, both halves
    <references>/<scene hash>/<id>.lock             held by the process that makes it

They lie in a cache folder, named by what they are made of, and all runs share them. One process at a time makes a
reference; others wait for it. Files appear whole, and a finished reference is not written again. One that is interrupted
goes on where it was; one of more samples starts from the largest that is there with the same seeds, and is the same to
the bit as one made at once. Where the spec has `until`, replicates are added until there are enough for its target, or its time
has passed: a run that allows more time adds to that one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Protocol

import numpy as np

from engines.choices import Choice
from engines.errors import ConfigError
from engines.film import Film
from harness.config.sections import MOST_REPLICATES
from harness.measure import machine
from harness.measure.pool import WorkerFailed
from harness.measure.requests import ReferenceRequest
from harness.metrics import Reference as ReferenceImage
from harness.plan.references import PlannedReference
from harness.settings import CellSettings
from harness.statistics.reference_noise import TAILS, samples_needed
from harness.store import atomic, locks
from harness.store.records import Reference, ReferenceMeta, ReferenceSpec
from harness.store.reference_files import EXR, META, checksum, film_in, meta_of, refuse_stale, write_meta

SAVE_EVERY_SECONDS = 20.0
Report = Callable[[int, int], None]
"""Called with (replicates done, replicates expected)."""


class Images(Protocol):
    """Who renders replicates: `pool.Pool` here, `executors.dask.Cluster` on other machines."""

    def replicates(self, engine: str, request: ReferenceRequest, seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """The image under each seed, in order, with the seconds it took. Raises `WorkerFailed`."""
        ...


def ready(planned: PlannedReference, root: Path) -> bool:
    """Whether it is on disk, whole, fresh, and with all samples that its time allows; one that is damaged or stale is refused
    with what to do."""
    folder = planned.folder(root)
    if not (folder / META).exists():
        return False
    meta = meta_of(folder)
    refuse_stale(folder, meta, planned.reference_id, planned.scene_hash)
    return is_final(planned, meta)


def is_final(planned: PlannedReference, meta: ReferenceMeta) -> bool:
    """Whether nothing is to be added: it is complete, and was not cut short by less time than there is now."""
    return meta.complete and not (meta.cut_short and _affordable(planned, meta.done, meta.seconds) > meta.done)


def make(
    planned: PlannedReference, root: Path, pool: Images, report: Report, waits: Callable[[], None] = lambda: None
) -> ReferenceMeta:
    """Renders what is missing and returns its metadata. Raises `WorkerFailed` when the engine fails.

    While another process makes the same reference this one waits, after a call of `waits`.
    """
    with held(planned, root, waits):
        if ready(planned, root):
            return meta_of(planned.folder(root))
        return _made(planned, root, pool, report)


def held(planned: PlannedReference, root: Path, waits: Callable[[], None] = lambda: None) -> AbstractContextManager[None]:
    """The lock of a reference, without which nothing is written into its folder."""
    folder = planned.folder(root)
    return locks.exclusive(folder.with_name(f"{folder.name}.lock"), waits)


def _made(planned: PlannedReference, root: Path, pool: Images, report: Report) -> ReferenceMeta:
    folder = planned.folder(root)
    film, seconds = _start(planned, root)
    usable = (folder / META).exists() and meta_of(folder).complete  # and stays so while more is added
    first, saved = film.spp, monotonic()
    while film.spp < (count := _replicates_needed(planned, film, seconds)):
        if film.spp == first:
            report(first, count)
        seeds = range(planned.spec["seed"] + film.spp, planned.spec["seed"] + count)
        for replicate, more in replicates(planned, seeds, pool):
            seconds += more
            _add(film, replicate, planned)
            if monotonic() - saved > SAVE_EVERY_SECONDS:
                _save(folder, planned, film, seconds, complete=usable)
                saved = monotonic()
            if film.spp < count:
                report(film.spp, count)
    meta = _save(folder, planned, film, seconds, complete=True)
    report(film.spp, film.spp)
    return meta


def _replicates_needed(planned: PlannedReference, film: Film, seconds: float) -> int:
    """The number of replicates to go on to, even: that of the spec, or as many as its target asks for and the time allows.

    It at most doubles what there is, whose noise is known the better the more there is.
    """
    done, fewest = film.spp, int(planned.spec["replicates"])
    if planned.until is None or done < fewest:
        return fewest
    count = max(done, min(_for_the_target(planned, film), _affordable(planned, done, seconds), 2 * done))
    return count + count % 2


def _for_the_target(planned: PlannedReference, film: Film) -> int:
    """The replicates that the target of a spec with `until` asks for, by the noise of those that are there."""
    assert planned.until is not None
    needed = samples_needed(pilot_in(film, planned.spec["replicate_spp"]), planned.until["target"], planned.until["epsilon"])
    return min(-(-TAILS * needed // planned.spec["replicate_spp"]), MOST_REPLICATES)


def _affordable(planned: PlannedReference, done: int, seconds: float) -> int:
    """The replicates that the time allows, by those that are `done` and took `seconds`."""
    return int(min(planned.max_seconds * done / seconds, MOST_REPLICATES)) if seconds > 0 else MOST_REPLICATES


def pilot_in(film: Film, replicate_spp: int) -> ReferenceImage:
    """The film of a reference, finished or not, as images with their noise."""
    return ReferenceImage(film.mean(), film.half(0), film.half(1), film.variance_of_mean(), film.spp * replicate_spp)


def replicates(
    planned: PlannedReference,
    seeds: Iterable[int],
    pool: Images,
    engine: str | None = None,
    settings: CellSettings | None = None,
    spp: int = 0,
) -> Iterator[tuple[Film, float]]:
    """The reference's image under each seed, with the seconds it took; by another engine, with other settings and samples,
    where these are named."""
    spp = spp or planned.spec["replicate_spp"]
    request = ReferenceRequest(planned.scene, planned.scene_hash, settings or planned.settings, spp)
    yield from pool.replicates(engine or planned.spec["engine"], request, list(seeds))


def event(planned: PlannedReference, root: Path) -> Reference:
    """What `events.jsonl` says of a reference. Its id and its scene's hash say where it lies."""
    meta = meta_of(planned.folder(root))
    return Reference(
        scene=planned.scene.name,
        scene_hash=planned.scene_hash,
        reference_id=planned.reference_id,
        engine=planned.spec["engine"],
        spp=meta.done * meta.spec.replicate_spp,
        width=planned.spec["width"],
        height=planned.spec["height"],
        shader=Choice.of(planned.spec["shader"]),
        seconds=meta.seconds,
    )


# --- on disk --------------------------------------------------------------------------------------------------------


def _start(planned: PlannedReference, root: Path) -> tuple[Film, float]:
    """The film to go on with and the seconds it took: this reference's own, the largest relative's, or an empty one.

    A relative may be written by another process meanwhile, and then does not help.
    """
    own = planned.folder(root)
    found: list[tuple[int, Path, ReferenceMeta]] = []
    for path in sorted(own.parent.glob(f"*/{META}")):
        try:
            meta = meta_of(path.parent)
        except ConfigError:
            continue
        most = MOST_REPLICATES if planned.until else planned.spec["replicates"]
        if meta.family == planned.family and meta.done <= most:
            found.append((meta.done, path.parent, meta))
    for _, folder, meta in sorted(found, key=lambda each: each[0], reverse=True):
        try:
            return film_in(folder, meta), meta.seconds
        except ConfigError:
            if folder == own:
                raise
    return Film(planned.spec["width"], planned.spec["height"]), 0.0


def _add(film: Film, replicate: Film, planned: PlannedReference) -> None:
    image, seed = replicate.mean(), planned.spec["seed"] + film.spp
    pixels = int((~np.isfinite(image).all(axis=2)).sum())
    if pixels or replicate.bad_samples:
        bad = f"{pixels} pixels of the image" if pixels else f"{replicate.bad_samples} samples"
        raise WorkerFailed(
            f"reference of {planned.scene.name} by {planned.spec['engine']}, seed {seed}: {bad} are NaN or infinite: finite "
            "radiance is expected"
        )
    film.add(image)


def _save(folder: Path, planned: PlannedReference, film: Film, seconds: float, complete: bool = False) -> ReferenceMeta:
    """Writes arrays and image, then the metadata that names them, then removes the arrays that the metadata named before.

    A crash leaves one or the other. To be called with the reference `held`.
    """
    name = f"film-{film.spp:04d}.npz"
    with atomic.replacing(folder / name) as file:
        np.savez(file, sums=film.sums, squares=film.squares, even_sums=film.even_sums, counts=film.counts, bad_samples=0)
    meta = ReferenceMeta(
        reference_id=planned.reference_id,
        family=planned.family,
        scene=planned.scene.name,
        scene_hash=planned.scene_hash,
        spec=ReferenceSpec(**planned.spec),
        done=film.spp,
        complete=complete or (planned.until is None and film.spp == planned.spec["replicates"]),
        cut_short=complete and planned.until is not None and _for_the_target(planned, film) > film.spp,
        file=name,
        sha256=checksum(folder / name),
        seconds=seconds,
        time=datetime.now(UTC).isoformat(timespec="seconds"),
        machine=machine.provenance(),
    )
    if meta.complete:
        film.save(folder / EXR, provenance=_text(meta))
    before = meta_of(folder).file if (folder / META).exists() else name
    write_meta(folder, meta)
    if before != name:
        with suppress(OSError):
            (folder / before).unlink()
    return meta


def _text(meta: ReferenceMeta) -> dict[str, str]:
    """Metadata for an image's header."""
    shown = meta.model_dump(include={"reference_id", "scene", "scene_hash", "spec", "time"})
    return {key: json.dumps(value) for key, value in shown.items()}
