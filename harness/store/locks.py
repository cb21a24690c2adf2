"""Locks on files. The kernel lets go of a lock when the process that holds it ends, however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from engines.errors import ConfigError

try:
    import fcntl
except ImportError:  # Windows: no lock is better than no run
    fcntl = None


def try_lock(file: Any) -> bool:
    """Locks an open file for this process; False where another one holds it. Raises `OSError` where it cannot be locked."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


@contextmanager
def exclusive(path: Path, waits: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Holds the lock file `path`, which stays. Where another process has it `waits` is called once, and it is waited for.

    Raises `ConfigError` where the file cannot be made or locked.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error
    with file:
        try:
            free = try_lock(file)
            if not free and fcntl is not None:
                waits()
                fcntl.flock(file, fcntl.LOCK_EX)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be locked: {error.strerror}") from error
        yield
