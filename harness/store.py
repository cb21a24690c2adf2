"""A results folder on disk. `events.jsonl` is the only truth; everything else can be rebuilt from it and the images.

An event is one JSON object a line, written whole, flushed and synced before the run goes on. A line that was cut short
by a crash is dropped and reported. Errors that are not finite are written as Python does: NaN, Infinity.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engines.errors import ConfigError
from engines.input_files import open_regular, unreadable
from harness import atomic, confined, locks, records

if TYPE_CHECKING:
    from harness.metrics import Reference

EVENTS, MANIFEST, LOCK, IMAGES = "events.jsonl", "manifest.json", ".lock", "images"
DERIVED = ("points.csv", "ttq.csv", "phases.csv", "tables", "plots", "report.html", "worker.log")
TORN = "its last line is cut short and was dropped: the run before this one was interrupted while it wrote"


class Events:
    """`events.jsonl` of a folder, open for appending. `torn` says that a line cut short was removed."""

    def __init__(self, folder: Path) -> None:
        self._path = confined.inside(folder, EVENTS, str(folder))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("a+b", buffering=0)
            self.torn = self._drop_torn_line()
        except OSError as error:
            raise ConfigError(f"{self._path}: cannot be written: {error.strerror}") from error

    def _drop_torn_line(self) -> bool:
        """Cuts the file after its last whole line; a whole object that lacks only its newline gets one."""
        self._file.seek(0)
        data = self._file.read()
        whole, _, rest = data.rpartition(b"\n")
        if not rest:
            return False
        if _parsed(rest) is not None:
            self._write(b"\n")
            return False
        self._file.truncate(len(whole) + 1 if whole else 0)
        return True

    def append(self, event: Mapping[str, Any]) -> None:
        """Adds an event; on return it is on disk. What is no Unicode in it, as parts of file names may be, becomes `?`."""
        self._write(json.dumps(event, ensure_ascii=False).encode(errors="replace") + b"\n")

    def _write(self, data: bytes) -> None:
        """Writes all of it, or nothing: what a full disk cut short is taken back."""
        end = self._file.seek(0, os.SEEK_END)
        try:
            while data:
                data = data[self._file.write(data) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(end)
            raise ConfigError(f"{self._path}: cannot be written: {error.strerror}") from error

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Events:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_events(folder: str | Path) -> list[dict[str, Any]]:
    """All events of a folder in order, checked against `records`; a torn last line is ignored with a warning.

    Raises `ConfigError` where there is no such file, where a line in its middle is damaged, and for the first event that
    does not say what events say, with its line.
    """
    path = confined.inside(Path(folder), EVENTS, str(folder))
    try:
        with open_regular(path) as file:
            lines = file.read().split(b"\n")
    except OSError as error:
        raise ConfigError(f"{path}: {unreadable(error)}: is this a results folder?") from error
    found: list[dict[str, Any]] = []
    for index, line in enumerate(lines):
        event = _parsed(line)
        if event is not None:
            records.event(event, f"{path}:{index + 1}")
            found.append(event)
        elif line and index == len(lines) - 1:
            warnings.warn(f"{path}: {TORN}", stacklevel=2)
        elif line:
            raise ConfigError(f"{path}:{index + 1}: not an event: the file is damaged; repair or remove that line")
    return found


def _parsed(line: bytes) -> dict[str, Any] | None:
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return event if isinstance(event, dict) and "event" in event else None


def latest_cells(events: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """The current state of each cell: its last event. A cell measured again is there once, at its first place."""
    found: dict[str, dict[str, Any]] = {}
    for event in events:
        if event["event"] == "cell":
            found[event["cell_id"]] = dict(event)
    return found


def last_event(events: Iterable[Mapping[str, Any]], kind: str) -> dict[str, Any] | None:
    """The last event of a kind."""
    found = None
    for event in events:
        if event["event"] == kind:
            found = dict(event)
    return found


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """The manifest of a results folder, checked against `records`.

    Raises `ConfigError` where there is none, and for one of another version of the format.
    """
    path = confined.inside(Path(folder), MANIFEST, str(folder))
    try:
        found = read_json(path)
    except OSError as error:
        raise ConfigError(f"{path}: {unreadable(error)}: is this a results folder?") from error
    records.manifest(found, str(path))
    return found


def read_json(path: Path) -> Any:
    """What a JSON file says. Raises `OSError`, and `ConfigError` for what is no JSON."""
    try:
        with open_regular(path) as file:
            return json.loads(file.read())
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not JSON: {error}") from error


def write_json(path: Path, data: Any) -> None:
    """Replaces a file by JSON in one step: readers see the old or the new one, whole. Raises `ConfigError`."""
    atomic.write_text(path, json.dumps(data, indent=2, ensure_ascii=False) + "\n", durable=True)


def image_path(cell_id: str, spp: int) -> str:
    """Where a checkpoint's image lies, relative to the results folder."""
    return f"{IMAGES}/{cell_id}/spp{spp:04d}.exr"


def image_file(folder: Path, image: str) -> Path:
    """The file of an image that an event names. Raises `ConfigError` where the path leads out of the folder."""
    return confined.inside(folder, image, f"{folder / EVENTS}: image")


def discard_images(folder: Path, cell_id: str) -> None:
    """Removes what an interrupted attempt at a cell left."""
    shutil.rmtree(folder / IMAGES / cell_id, ignore_errors=True)


def clear(folder: Path) -> None:
    """Empties a results folder of what runs write. Other files stay, and so do references. Links go, not what they name."""
    if folder.exists() and not (folder / EVENTS).exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder}: holds no {EVENTS}, so it is no results folder: --fresh does not touch it")
    for name in (*DERIVED, IMAGES, MANIFEST, EVENTS):
        path = folder / name
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be removed: {error.strerror}") from error


def derived_is_fresh(folder: Path) -> bool:
    """Whether the report, which is written last, is younger than all that it is made from."""
    try:
        made = (folder / "report.html").stat().st_mtime_ns
        return made > max((folder / name).stat().st_mtime_ns for name in (EVENTS, MANIFEST))
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
                raise ConfigError(
                    f"{folder}: another run (process {holder}) is writing here: wait for it, or choose --out"
                )
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


def reference_arrays(folder: str | Path, reference_id: str) -> Reference:
    """The reference that cells of a results folder were compared with, checked against its checksum."""
    from harness import reference_files

    for event in read_events(folder):
        if event["event"] == "reference" and event["reference_id"] == reference_id:
            found = reference_files.of_results(Path(folder), reference_id, event["scene_hash"])
            return reference_files.read(found, reference_id, event["scene_hash"])
    raise ConfigError(f"{folder}: no reference {reference_id!r} is named in {EVENTS}")
