"""Temporary folders that a later process can tell to be abandoned: their owner holds a lock on a file inside.

A process that is killed leaves its temporary folders behind; `remove_abandoned` removes those of the same user whose lock
nobody holds. A lock, unlike a process id, is right in containers that share a folder, and the system releases it however
its owner ends. Folders without the lock's file are never touched.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows: folders are removed by their owners alone
    fcntl = None

PREFIX = "raybench-"
OWNER = ".owner"
"""The file inside a folder that its owner keeps locked."""


class TemporaryFolder(tempfile.TemporaryDirectory[str]):
    """A `tempfile.TemporaryDirectory` named `raybench-*`. It is removed by `cleanup`, at the end of a `with`, or at exit;
    where its owner is killed, by the next `remove_abandoned` of any process."""

    def __init__(self) -> None:
        super().__init__(prefix=PREFIX, ignore_cleanup_errors=True)
        self._owner = _locked_file(Path(self.name))

    def cleanup(self) -> None:
        """Removes the folder and what lies in it."""
        super().cleanup()
        if self._owner is not None:
            self._owner.close()


def _locked_file(folder: Path) -> Any:
    """The owner's file, open and locked. It gets its name only then: nobody finds it unlocked before."""
    if fcntl is None:
        return None
    file = (folder / f"{OWNER}.new").open("w")
    fcntl.flock(file, fcntl.LOCK_EX)
    os.rename(file.name, folder / OWNER)
    return file


def remove_abandoned() -> None:
    """Removes this user's folders whose owners have ended without doing so."""
    if fcntl is None:
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            found = folder.lstat()
            if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid():
                _remove_unowned(folder)


def _remove_unowned(folder: Path) -> None:
    """Removes a folder that has an owner's file with no lock on it. Raises `OSError` where there is none, or a lock."""
    assert fcntl is not None
    with os.fdopen(os.open(folder / OWNER, os.O_RDWR | os.O_NOFOLLOW)) as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
