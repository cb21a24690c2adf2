"""The side that starts a process: its sockets, its output, its end."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

from engines.processes.channel import Channel

CHILD = Path(__file__).with_name("child.py")
REMEMBERED = "remembered"
"""Output that goes to this process's standard error, and whose last line is known."""
LAST_SECONDS = 5.0
"""What a process has left to end in, once it has closed its sockets."""
_OUTPUT_SECONDS = 2.0
"""What the thread that reads output has left, once the process has ended."""
_LINES = 20
"""Of a process's output that are remembered."""
_MOST_CHARACTERS = 300


class Process:
    """A Python that calls one function of ours, `module:function`, with the sockets at the other end of `channels`.

    It ends with this one, however that ends. What it prints is never taken for a message.
    """

    def __init__(
        self,
        target: str,
        *arguments: str,
        python: str = sys.executable,
        environment: Mapping[str, str] | None = None,
        output: BinaryIO | str | None = None,
        channels: int = 1,
        own_session: bool = True,
        dies_with_thread: bool | None = None,
        most_bytes: int | None = None,
    ) -> None:
        """Starts it. Raises `OSError` where that fails.

        `output` is a file for what it prints, `REMEMBERED`, or None: this process's standard error. With `own_session` Ctrl-C
        does not reach it, and `kill` ends what it has started, too. Linux kills a child with the thread that started it:
        `dies_with_thread` asks for that; None: in the main thread alone. `most_bytes` may be received as one message.
        """
        if dies_with_thread is None:
            dies_with_thread = threading.current_thread() is threading.main_thread()
        ours, theirs = zip(*(socket.socketpair() for _ in range(channels)), strict=True)
        descriptors = [each.fileno() for each in theirs]
        reading, writing = os.pipe() if output == REMEMBERED else (-1, -1)
        printed = writing if output == REMEMBERED else 2 if output is None else output
        words = [str(os.getpid()), str(int(dies_with_thread)), ",".join(map(str, descriptors)), *arguments]
        try:
            self._process = subprocess.Popen(
                [python, str(CHILD), target, *words],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=printed,  # type: ignore[arg-type]
                stderr=printed,  # type: ignore[arg-type]
                pass_fds=descriptors,
                start_new_session=own_session,
            )
        except OSError:
            for each in ours:
                each.close()
            if reading >= 0:
                os.close(reading)
            raise
        finally:
            if writing >= 0:
                os.close(writing)
            for each in theirs:
                each.close()
        self._own_session = own_session
        self._output = _Output(reading) if reading >= 0 else None
        self.pid = self._process.pid
        self.channels = tuple(Channel(each, most_bytes) for each in ours)

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def reaped(self) -> bool:
        """Whether its end has been taken note of: before that no other process has its number."""
        return self._process.returncode is not None

    def ended(self, patience: float = LAST_SECONDS) -> str:
        """How the process ended that has closed its channels, in words, with its last line where that is remembered. One that
        runs on after `patience` seconds is the caller's to `kill`, as the words say."""
        ended = self._ends_within(patience)
        words = status_in_words(self._process.returncode) if ended else "closed its socket and went on: it was killed"
        last = "" if self._output is None else self._output.last_line()
        return f"{words}: {last}" if last else words

    def _ends_within(self, seconds: float | None) -> bool:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self._process.returncode is not None

    def kill(self, wait: bool = True) -> None:
        """Ends the process at once, and with `own_session` what it has started; with `wait` nothing of it is left here."""
        # Until it has been waited for, the process keeps its number, and the group is surely ours.
        if not self.reaped:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                if self._own_session:
                    os.killpg(self.pid, signal.SIGKILL)
                else:
                    self._process.kill()
        if wait:
            self._process.wait()
            self.close()

    def end(self, patience: float) -> None:
        """Closes the channels, upon which it ends, and kills it where it has not after some seconds."""
        self.close()
        if not self._ends_within(patience):
            self.kill()

    def close(self) -> None:
        """Closes the channels."""
        for each in self.channels:
            each.close()


class _Output:
    """Passes what a process prints on to this one's standard error, and remembers the end of it."""

    def __init__(self, descriptor: int) -> None:
        self._lines: deque[bytes] = deque(maxlen=_LINES)
        self._thread = threading.Thread(target=self._read, args=(descriptor,), daemon=True)
        self._thread.start()

    def _read(self, descriptor: int) -> None:
        with os.fdopen(descriptor, "rb") as output:
            for line in output:
                self._lines.append(line)
                with contextlib.suppress(OSError):
                    os.write(2, line)

    def last_line(self) -> str:
        """The last line that is not empty."""
        self._thread.join(_OUTPUT_SECONDS)
        lines = [line.decode(errors="replace").strip() for line in self._lines]
        return next((line[:_MOST_CHARACTERS] for line in reversed(lines) if line), "")


def status_in_words(status: int) -> str:
    """An exit status, negative for a signal: "was killed by SIGSEGV", "ended with status 3"."""
    if status >= 0:
        return f"ended with status {status}"
    try:
        return f"was killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"was killed by signal {-status}"
