"""Runs a program to its end: no shell, no input, its output kept in a file, its time measured."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from engines.errors import RendererFailed

OUTPUT_BYTES = 1 << 20
"""Of a longer output only the end is looked at."""
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


class Ran(NamedTuple):
    """How a process went: its standard output and error together, and wall seconds from start to end."""

    output: str
    seconds: float


class Process:
    """One process at a time; `stop` kills it from another thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: subprocess.Popen[bytes] | None = None
        self.stopped = False

    def run(self, name: str, words: Sequence[str], environment: Mapping[str, str], folder: Path) -> Ran | None:
        """None where it was stopped. Raises `RendererFailed`, naming the program, where it cannot start or fails."""
        log = folder / "output.txt"
        with log.open("wb") as output:
            start = perf_counter()
            with self._lock:
                if self.stopped:
                    return None
                try:
                    # In the process group of its parent: whoever kills that for its timeout kills this too.
                    self._running = subprocess.Popen(
                        words,
                        cwd=folder,
                        env={**os.environ, **environment},
                        stdin=subprocess.DEVNULL,
                        stdout=output,
                        stderr=subprocess.STDOUT,
                        preexec_fn=_die_with_parent if _LIBC else None,  # noqa: PLW1509
                    )
                except (OSError, ValueError) as error:
                    reason = getattr(error, "strerror", None) or error
                    raise RendererFailed(f"{name}: {words[0]} cannot be started: {reason}") from error
            status = self._running.wait()
            seconds = perf_counter() - start
        if self.stopped:
            return None
        text = _end_of(log)
        if status != 0:
            how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
            raise RendererFailed(f"{name}: the program {how}{_last_words(text)}")
        return Ran(text, seconds)

    def stop(self) -> None:
        """Kills what runs, and lets nothing start until `stopped` is reset."""
        with self._lock:
            self.stopped = True
            if self._running is not None and self._running.poll() is None:
                self._running.kill()


def _die_with_parent() -> None:
    """Between fork and exec: Linux kills the program when the thread that started it is gone."""
    assert _LIBC is not None
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _end_of(log: Path) -> str:
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - OUTPUT_BYTES))
        return file.read().decode(errors="replace")


def _last_words(text: str) -> str:
    """The last line that is not empty, for a message."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return f": {lines[-1][:200]}" if lines else ""
