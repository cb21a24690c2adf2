"""The file in which a worker leaves arrays for its parent: the disk may be full, and engines may have changed it."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from engines.errors import RendererFailed
from engines.input_files import open_regular

HEADER_BYTES = 1 << 16
"""Of the arrays' headers, in all."""


class Unwritten(Exception):
    """The disk is full, say: no failure of the engine."""


def leave(path: str | Path, **arrays: Any) -> None:
    """Writes arrays into a file (.npz). Raises `Unwritten`."""
    try:
        np.savez(path, **arrays)
    except OSError as error:
        raise Unwritten(f"{path}: cannot be written: {error.strerror or error}") from error


def take(path: Path, names: Iterable[str], most_bytes: int, what: str) -> dict[str, Any]:
    """The arrays of these names. Raises `RendererFailed` where the file is no such one, or has more than `most_bytes` beside
    headers; `what` it holds stands in the message."""
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as members:
            if sum(member.file_size for member in members.infolist()) > most_bytes + HEADER_BYTES:
                raise ValueError(f"the file is larger than {most_bytes + HEADER_BYTES} bytes")
            file.seek(0)
            with np.load(file) as arrays:
                return {name: arrays[name] for name in names}
    except Exception as error:  # what zipfile, zlib and NumPy raise for damaged files is no closed list
        raise RendererFailed(f"the worker's {what} cannot be read: {type(error).__name__}: {error}") from error
