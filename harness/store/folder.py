"""A results folder on disk: its manifest, its images, its lock, and what is derived from its events."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from engines.errors import ConfigError
from engines.input_files import unreadable
from harness.config.experiment import EXPERIMENT, SCHEMA_VERSION, Experiment, recorded
from harness.store import confined, locks, validation
from harness.store.events import COMPRESSED, EVENTS, MANIFEST, events_file
from harness.store.json_files import read_json, write_json
from harness.store.records import Manifest

LOCK, IMAGES = ".lock", "images"
WINNERS, SENTENCES = "winners.txt", "sentences.txt"
DERIVED = ("points.csv", "ttq.csv", "phases.csv", WINNERS, SENTENCES, "tables", "plots", "report.html", "worker.log")


def read_manifest(folder: str | Path) -> Manifest:
    """The manifest of a results folder, see `validation`.

    Raises `ConfigError` where there is none, and for one of another version of the format.
    """
    path = confined.inside(Path(folder), MANIFEST, str(folder))
    try:
        found = read_json(path)
    except OSError as error:
        raise ConfigError(f"{path}: {unreadable(error)}: is this a results folder?") from error
    return validation.manifest(found, str(path))


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Replaces the manifest of a results folder, in one step, with those of its fields that were given."""
    write_json(folder / MANIFEST, manifest.model_dump(exclude_unset=True))


def config_of(manifest: Manifest) -> Experiment:
    """The experiment of a manifest; one without cells or name where the manifest has none."""
    return recorded(manifest.config or {EXPERIMENT: SCHEMA_VERSION, "include": []}, MANIFEST)


def image_path(cell_id: str, spp: int, attempt: int = 1) -> str:
    """Where a checkpoint's image lies, relative to the results folder."""
    return f"{_images(cell_id, attempt)}/spp{spp:04d}.exr"


def _images(cell_id: str, attempt: int) -> str:
    return f"{IMAGES}/{cell_id}" + (f"/attempt{attempt}" if attempt > 1 else "")


def image_file(folder: Path, image: str) -> Path:
    """The file of an image that an event names. Raises `ConfigError` where the path leads out of the folder."""
    return confined.inside(folder, image, f"{folder / EVENTS}: image")


def discard_images(folder: Path, cell_id: str, attempt: int = 1) -> None:
    """Removes what an interrupted attempt at a cell left; the first one is followed by none."""
    shutil.rmtree(folder / _images(cell_id, attempt), ignore_errors=True)


def clear(folder: Path) -> None:
    """Empties a results folder of what runs write. Other files stay, and so do references. Links go, not what they name."""
    if folder.exists() and events_file(folder) is None and any(folder.iterdir()):
        raise ConfigError(f"{folder}: holds no {EVENTS}, so it is no results folder: --fresh does not touch it")
    for name in (*DERIVED, IMAGES, MANIFEST, EVENTS, COMPRESSED):
        path = folder / name
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be removed: {error.strerror}") from error


def make_out(folder: Path) -> None:
    """Makes the folder of `--out` before the work, so that a wrong one is an error at once. Raises `ConfigError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {folder}: {error.strerror}: name a folder that can be written to") from error
    if not os.access(folder, os.W_OK):
        raise ConfigError(f"--out {folder}: cannot be written to")


def derived_is_fresh(folder: Path) -> bool:
    """Whether the report, which is written last, is younger than all that it is made from."""
    try:
        made = (folder / "report.html").stat().st_mtime_ns
        sources = (events_file(folder) or folder / EVENTS, folder / MANIFEST)
        return made > max(source.stat().st_mtime_ns for source in sources)
    except OSError:
        return False


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keeps a second run out of the folder; the kernel lets go of the lock when the process ends, however it ends."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = confined.inside(folder, LOCK, str(folder)).open("a+")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written: {error.strerror}") from error
    with file:
        try:
            if not locks.try_lock(file):
                file.seek(0)
                holder = file.read().strip() or "unknown"
                raise ConfigError(f"{folder}: another run (process {holder}) is writing here: wait for it, or choose --out")
            file.truncate(0)
            file.write(f"{os.getpid()}\n")
            file.flush()
        except OSError as error:
            raise ConfigError(f"{folder / LOCK}: cannot be locked: {error.strerror}") from error
        yield


def is_locked(folder: Path) -> bool:
    """Whether a run is writing there now."""
    try:
        with (folder / LOCK).open("r+") as file:
            return not locks.try_lock(file)
    except OSError:
        return False
