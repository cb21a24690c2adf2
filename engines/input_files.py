"""Files that somebody else wrote or named: only regular ones are opened.

Opening a FIFO waits for its writer, opening a device may make it act, and reading either need not end.
"""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from os import PathLike
from pathlib import Path
from typing import BinaryIO

FilePath = str | PathLike[str]

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


_OPENED: ContextVar[list[Path] | None] = ContextVar("opened", default=None)


@contextmanager
def files_opened() -> Iterator[list[Path]]:
    """The files that `open_regular` opens inside the block, in order, links followed."""
    token = _OPENED.set(found := [])
    try:
        yield found
    finally:
        _OPENED.reset(token)


class NotRegularFile(OSError):
    """A path that leads to something else than a regular file; links are followed."""


def open_regular(path: FilePath) -> BinaryIO:
    """A regular file, open for reading its bytes. Never waits.

    Raises `NotRegularFile` for folders, FIFOs, sockets and devices, and what `open` raises: `OSError`, or `ValueError`
    for names that no file can have.
    """
    _require_regular(path, os.stat(path))
    nonblocking = getattr(os, "O_NONBLOCK", 0)  # a FIFO may have come to this name since
    raw = io.FileIO(path, opener=lambda name, flags: os.open(name, flags | nonblocking))
    try:
        _require_regular(path, os.fstat(raw.fileno()))
    except OSError:
        raw.close()
        raise
    if (opened := _OPENED.get()) is not None:
        opened.append(Path(os.fsdecode(path)).resolve())
    return _RegularFile(raw)


class _RegularFile(io.BufferedReader):
    """Reserves no more than the file holds, where a decoder asks for as much as a damaged header says."""

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(0, os.fstat(self.fileno()).st_size - self.tell())
        return super().read(left if size is None or size < 0 else min(size, left))


def unreadable(problem: OSError | ValueError) -> str:
    """What a message says after the file's name: `is not a regular file but a FIFO`, `cannot be read: Permission denied`."""
    reason = getattr(problem, "strerror", None) or str(problem)
    return reason if isinstance(problem, NotRegularFile) else f"cannot be read: {reason}"


def _require_regular(path: FilePath, found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "something else")
        raise NotRegularFile(errno.EINVAL, f"is not a regular file but {kind}", os.fspath(path))
