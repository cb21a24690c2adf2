"""Files that appear whole: written beside their place under a name of their own, synced, then renamed."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from engines.errors import ConfigError


@contextmanager
def replacing(path: Path, durable: bool = True) -> Iterator[BinaryIO]:
    """A file to write; at the end of the block it takes the place of `path`. Readers see the old one or the new one.

    `durable`: it is on disk before that, and outlives a failure of power. What can be made again need not be.
    Any number of processes may do so at once; the last one counts. Raises `ConfigError` where it cannot be written, and
    leaves `path` as it was.
    """
    beside = path.with_name(f".{path.name[:100]}.{uuid.uuid4().hex}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("xb") as file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def write_text(path: Path, text: str, durable: bool = False) -> None:
    """Replaces a file by text in UTF-8. Raises `ConfigError`."""
    with replacing(path, durable) as file:
        file.write(text.encode(errors="replace"))
