"""The events of a results folder, `events.jsonl`: the only truth, from which and the images all else can be rebuilt.

An event is one JSON object a line, written whole, flushed and synced before the run goes on. A line that was cut short
by a crash is dropped and reported. Errors that are not finite are written as Python does: NaN, Infinity.

Archives, to which no run adds, hold the same lines in `events.jsonl.gz`.
"""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import warnings
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from engines.errors import ConfigError
from engines.input_files import open_regular, unreadable
from harness.check_results import CheckResult
from harness.store import atomic, confined, validation
from harness.store.json_files import read_json
from harness.store.records import AnyCell, AnyEvent, Cell, RayCell, Record, VerifyJob

EVENTS, COMPRESSED, MANIFEST = "events.jsonl", "events.jsonl.gz", "manifest.json"
LARGEST = 2**31
"""Bytes of compressed events once they are expanded; a larger file is refused."""
TORN = "its last line is cut short and was dropped: the run before this one was interrupted while it wrote"


class Events:
    """`events.jsonl` of a folder, open for appending. `torn` says that a line cut short was removed."""

    def __init__(self, folder: Path) -> None:
        self._path = confined.inside(folder, EVENTS, str(folder))
        if (folder / COMPRESSED).exists():
            raise ConfigError(
                f"{folder}: is an archive, to which nothing is added: name another folder, or the one it was made from"
            )
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

    def append(self, event: AnyEvent) -> None:
        """Adds an event; on return it is on disk."""
        self._write(line_of(event))

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


def events_file(folder: Path) -> Path | None:
    """The file of a folder's events, compressed or not; None where there is neither."""
    return next((folder / name for name in (EVENTS, COMPRESSED) if (folder / name).exists()), None)


def compress(folder: Path) -> None:
    """Puts `events.jsonl.gz` in the place of `events.jsonl`. The same events give the same bytes."""
    lines = (folder / EVENTS).read_bytes()
    with atomic.replacing(folder / COMPRESSED) as file:
        file.write(gzip.compress(lines, 9, mtime=0))
    (folder / EVENTS).unlink()


def line_of(event: AnyEvent) -> bytes:
    """The line of an event, with those of its fields that were given. What is no Unicode in it becomes `?`."""
    fields = {"event": event.event, **event.model_dump(exclude_unset=True)}
    return json.dumps(fields, ensure_ascii=False).encode(errors="replace") + b"\n"


def read_events(folder: str | Path) -> list[AnyEvent]:
    """All events of a folder in order, see `validation`; a torn last line is ignored with a warning.

    Raises `ConfigError` for a folder of another version of the format, where there is no such file, where a line in its
    middle is damaged, and for the first event that is not valid, with its line.
    """
    folder = Path(folder)
    _check_version(folder)
    path = confined.inside(folder, (events_file(folder) or Path(EVENTS)).name, str(folder))
    try:
        with open_regular(path) as file:
            lines = (_expanded(file, path) if path.name == COMPRESSED else file.read()).split(b"\n")
    except OSError as error:
        raise ConfigError(f"{path}: {unreadable(error)}: is this a results folder?") from error
    found: list[AnyEvent] = []
    for index, line in enumerate(lines):
        event = _parsed(line)
        if event is not None:
            found.append(validation.event(event, f"{path}:{index + 1}"))
        elif line and index == len(lines) - 1:
            warnings.warn(f"{path}: {TORN}", stacklevel=2)
        elif line:
            raise ConfigError(f"{path}:{index + 1}: not an event: the file is damaged; repair or remove that line")
    return found


def _expanded(file: BinaryIO, path: Path) -> bytes:
    try:
        data = gzip.GzipFile(fileobj=file).read(LARGEST + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise ConfigError(f"{path}: is damaged: {error}") from error
    if len(data) > LARGEST:
        raise ConfigError(f"{path}: holds more than {LARGEST >> 30} GiB of events")
    return data


def _check_version(folder: Path) -> None:
    """Events have no version of their own: the manifest beside them says it."""
    path = confined.inside(folder, MANIFEST, str(folder))
    if path.exists():
        with contextlib.suppress(OSError):  # who needs the manifest reads it
            validation.version(read_json(path), str(path))


def _parsed(line: bytes) -> dict[str, Any] | None:
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return event if isinstance(event, dict) and "event" in event else None


Kind = TypeVar("Kind", bound=Record)


def of_kind(events: Iterable[Record], kind: type[Kind]) -> list[Kind]:
    """The events of a kind, in order."""
    return [event for event in events if isinstance(event, kind)]


def last_event(events: Iterable[AnyEvent], kind: type[Kind]) -> Kind | None:
    """The last event of a kind."""
    return next(iter(of_kind(events, kind)[-1:]), None)


def latest_cells(events: Iterable[AnyEvent]) -> dict[str, AnyCell]:
    """The current state of each cell: its last event. A cell measured again is there once, at its first place."""
    return {event.cell_id: event for event in events if isinstance(event, (Cell, RayCell))}


def latest_verify_jobs(events: Iterable[AnyEvent]) -> dict[str, VerifyJob]:
    """The last event of every verify job."""
    return {event.verify_job_id: event for event in of_kind(events, VerifyJob)}


def check_results(events: Iterable[AnyEvent], ids: Iterable[str] | None = None) -> list[CheckResult]:
    """The check results of all verify jobs, or of those of `ids`."""
    known = latest_verify_jobs(events)
    chosen = known if ids is None else [key for key in ids if key in known]
    return [result for key in chosen for result in known[key].results]
