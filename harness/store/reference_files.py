"""References as files: where they lie, how they are read and checked, and how results carry them along.

Their metadata may come from elsewhere: it is checked, and what it names lies in its own folder.
"""

from __future__ import annotations

import hashlib
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZIP_LZMA, BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from engines.errors import ConfigError
from engines.film import BYTES_A_PIXEL, Film
from harness.hashing import digest
from harness.store import atomic, confined, validation
from harness.store.events import EVENTS, of_kind, read_events
from harness.store.json_files import read_json, write_json
from harness.store.records import Reference as ReferenceRecord
from harness.store.records import ReferenceMeta, ReferenceSpec

if TYPE_CHECKING:
    from harness.metrics import Reference

Array = NDArray[Any]
HEADERS = 1 << 16
"""Bytes of a film's file beside its pixels, at most."""
META, EXR = "reference.json", "reference.exr"
SMALL_BITS = {"sums": 11, "even_sums": 11, "deviations": 6}
"""Significant bits of a film in an archive. `deviations`, the sums of squared deviations from the mean, stand in the place of
squares: the small difference of rounded squares and squared means would be rounding alone."""
FOLDER = "references"
"""Of archives and merged results: the references they carry with them."""
VARIABLE = "RAYBENCH_REFERENCES"


def cache_folder() -> Path:
    """Where references are kept: $RAYBENCH_REFERENCES, else `raybench/references` in the user's cache folder."""
    if given := os.environ.get(VARIABLE):
        return Path(given).expanduser()
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(caches) / "raybench" / FOLDER


def search(results: Path, reference_id: str, scene_hash: str) -> Path | None:
    """The folder of a reference that results were compared with; None where it is nowhere.

    Looked for in the results themselves (archives, merged ones), in the cache folder, and in a folder `references`
    beside the results, where raybench kept them once. Raises `ConfigError` where a link leads out of these.
    """
    for place in (results / FOLDER, cache_folder(), results.absolute().parent / FOLDER):
        folder = confined.inside(place, _part(reference_id, scene_hash), f"{results}: reference")
        if (folder / META).is_file():
            return folder
    return None


def of_results(results: Path, reference_id: str, scene_hash: str) -> Path:
    """Like `search`, but raises `ConfigError` where it is nowhere."""
    found = search(results, reference_id, scene_hash)
    if found is None:
        raise ConfigError(
            f"{results}: the reference {_part(reference_id, scene_hash)} is neither there nor in {cache_folder()}: name "
            "its folder with --references, or run the experiment again"
        )
    return found


def _part(reference_id: str, scene_hash: str) -> Path:
    return Path(scene_hash[:16]) / reference_id


def read(folder: Path, reference_id: str, scene_hash: str) -> Reference:
    """The arrays of a complete reference; refused when its scene, its id or its checksum is another."""
    from harness.metrics import Reference

    meta, film = _whole(folder, reference_id, scene_hash)
    if film.bad_samples:
        raise ConfigError(
            f"{folder}: {film.bad_samples} of this reference's samples are NaN or infinite: finite radiance is expected"
        )
    spp = meta.done * meta.spec.replicate_spp
    return Reference(film.mean(), film.half(0), film.half(1), film.variance_of_mean(), spp)


def _whole(folder: Path, reference_id: str, scene_hash: str) -> tuple[ReferenceMeta, Film]:
    meta = meta_of(folder)
    refuse_stale(folder, meta, reference_id, scene_hash)
    if not meta.complete:
        raise ConfigError(f"{folder}: this reference was not finished: run the experiment again")
    try:
        return meta, film_in(folder, meta)
    except ConfigError:
        if meta_of(folder) == meta:
            raise
    return _whole(folder, reference_id, scene_hash)  # another process has extended it meanwhile


def carry(results: Path, record: ReferenceRecord, out: Path, small: bool) -> None:
    """Copies a reference into the results folder `out`, where there is such a one.

    `small`: its arrays rounded to `SMALL_BITS` and compressed, and nothing for eyes. Its metadata names what is there.
    """
    source = search(results, record.reference_id, record.scene_hash)
    if source is None:
        return
    target = confined.inside(out, FOLDER / _part(record.reference_id, record.scene_hash), f"{out}: reference")
    meta = meta_of(source)
    path = confined.inside(source, meta.file, f"{source / META}: file")
    try:
        data = _small(film_in(source, meta)) if small else path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}: remove {source} to make it anew") from error
    with atomic.replacing(target / meta.file) as file:
        file.write(data)
    write_meta(target, meta.replaced(sha256=hashlib.sha256(data).hexdigest()) if small else meta)
    exr = confined.inside(source, EXR, f"{source}: image")
    if not small and exr.is_file():
        content = exr.read_bytes()
        with atomic.replacing(target / EXR) as file:
            file.write(content)


def _to_bits(array: Array, bits: int) -> Array:
    """In float32, rounded to so many significant bits: those that are zero take no room once compressed."""
    fractions, exponents = np.frexp(array.astype(np.float32))
    return np.ldexp(np.round(fractions * 2.0**bits) / 2.0**bits, exponents).astype(np.float32)


def _small(film: Film) -> bytes:
    """An `.npz` whose parts LZMA compresses, to two thirds of what NumPy's own Deflate would leave."""
    buffer = io.BytesIO()
    sums = _to_bits(film.sums, SMALL_BITS["sums"])
    deviations = np.maximum(film.squares - film.sums**2 / np.maximum(film.counts, 1)[:, :, None], 0.0)
    arrays: dict[str, Array] = {"sums": sums, "even_sums": _to_bits(film.even_sums, SMALL_BITS["even_sums"])}
    arrays |= {"deviations": _to_bits(deviations, SMALL_BITS["deviations"])}
    arrays |= {"counts": film.counts, "bad_samples": np.array(film.bad_samples)}
    with ZipFile(buffer, "w", ZIP_LZMA) as parts:
        for name, array in arrays.items():
            with parts.open(f"{name}.npy", "w") as part:
                np.lib.format.write_array(part, array)
    return buffer.getvalue()


# --- checks ---------------------------------------------------------------------------------------------------------


def film_in(folder: Path, meta: ReferenceMeta) -> Film:
    """The film that the metadata names. Raises `ConfigError` where it is not the one that was written."""
    path = confined.inside(folder, meta.file, f"{folder / META}: file")
    try:
        whole = checksum(path) == meta.sha256
    except OSError:
        whole = False
    if not whole:
        raise ConfigError(f"{path}: missing, or its checksum is not the recorded one: remove {folder} to make it anew")
    _refuse_bomb(path, meta.spec)
    try:
        with np.load(path) as arrays:
            height, width = arrays["counts"].shape
            if (height, width) != (meta.spec.height, meta.spec.width):
                raise ValueError(f"{width}x{height} pixels, and its metadata says another size")
            film = Film(width, height)
            film.sums, film.even_sums = arrays["sums"], arrays["even_sums"]
            film.counts, film.bad_samples = arrays["counts"], int(arrays["bad_samples"])
            if "deviations" in arrays:
                squared_means = film.sums.astype(np.float64) ** 2 / np.maximum(film.counts, 1)[:, :, None]
                film.squares = arrays["deviations"] + squared_means
            else:
                film.squares = arrays["squares"]
        for array in (film.sums, film.squares, film.even_sums):
            if array.shape != (height, width, 3) or array.dtype.kind != "f" or film.counts.dtype.kind not in "iu":
                raise ValueError(f"{array.shape} {array.dtype} beside counts {film.counts.shape} {film.counts.dtype}")
    except Exception as error:  # what zipfile, zlib and NumPy raise for damaged files is no closed list
        raise ConfigError(f"{path}: the film cannot be read: {error}") from error
    return film


def _refuse_bomb(path: Path, spec: ReferenceSpec) -> None:
    """A few bytes can be unpacked to more than there is memory: a film takes what its size says."""
    most = BYTES_A_PIXEL * spec.width * spec.height + HEADERS
    try:
        with ZipFile(path) as parts:
            unpacked = sum(part.file_size for part in parts.infolist())
    except (OSError, RuntimeError, NotImplementedError, BadZipFile) as error:
        raise ConfigError(f"{path}: the film cannot be read: {error}") from error
    if unpacked > most:
        raise ConfigError(f"{path}: takes {unpacked} bytes unpacked, and a film of its size at most {most}")


def meta_of(folder: Path) -> ReferenceMeta:
    """The metadata of a reference. Raises `ConfigError`."""
    path = confined.inside(folder, META, f"{folder}: metadata")
    try:
        return validation.reference_meta(read_json(path), str(path))
    except (OSError, ConfigError) as error:
        raise ConfigError(f"{error}: remove {folder} to make it anew") from error


def write_meta(folder: Path, meta: ReferenceMeta) -> None:
    """Replaces the metadata of a reference in one step."""
    write_json(folder / META, meta.model_dump())


def refuse_stale(folder: Path, meta: ReferenceMeta, reference_id: str, scene_hash: str) -> None:
    """Raises `ConfigError` where a folder holds another reference, or one of another scene, than its place says."""
    if meta.scene_hash != scene_hash:
        raise ConfigError(f"{folder}: stale: the scene has changed since this reference was made: remove the folder")
    if meta.reference_id != reference_id or digest(meta.spec.preimage) != reference_id:
        raise ConfigError(f"{folder}: stale: it holds another reference than {reference_id}: remove the folder")


def checksum(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def reference_arrays(folder: str | Path, reference_id: str) -> Reference:
    """The reference that cells of a results folder were compared with, checked against its checksum."""
    for record in of_kind(read_events(folder), ReferenceRecord):
        if record.reference_id == reference_id:
            found = of_results(Path(folder), reference_id, record.scene_hash)
            return read(found, reference_id, record.scene_hash)
    raise ConfigError(f"{folder}: no reference {reference_id!r} is named in {EVENTS}")
