"""Cases that end as a reader should not: by their number they raise, hang, die, take memory or say too little."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from random import Random

from engines.errors import SceneError

MEBIBYTES = 64
WAYS = ("accept", "refuse", "raise", "silent", "memory", "hang", "die", "accept")


def write(random: Random, folder: Path) -> None:
    """A file that says which case it is; the worker names the folder after it."""
    (folder / "a.txt").write_text(WAYS[int(folder.name) % len(WAYS)])


def read(folder: Path) -> None:
    """Ends as the file says."""
    way = (folder / "a.txt").read_text()
    if way == "refuse":
        raise SceneError("a.txt: is wrong")
    if way == "silent":
        raise SceneError("something is wrong")
    if way == "raise":
        raise KeyError("spp")
    if way == "memory":
        bytearray(b"x" * (100 << 20))
    elif way == "hang":
        time.sleep(600)
    elif way == "die":
        os.kill(os.getpid(), signal.SIGSEGV)
