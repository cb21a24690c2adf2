"""The side that asks: starts a Python that holds one engine, sends it calls, and ends it."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from engines.errors import ConfigError, RaybenchError, RendererFailed, Unsupported
from engines.imports import users_folders
from engines.isolated.channel import Channel, Closed
from engines.isolated.films import Block

CHILD = Path(__file__).with_name("child.py")
_LAST_SECONDS = 2.0
"""What a process has left to end in, once its sockets are closed."""
_LINES = 20
"""Of a process's output that are remembered."""
_MOST_CHARACTERS = 300
_THEIRS = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "PYTHONUSERBASE")
"""Variables that lead a Python to packages of another environment."""


OnFilm = Callable[[str, Block | None, Any], bool]


def _go_on(kind: str, block: Block | None, bad_samples: Any) -> bool:
    return True


class Process:
    """A child process. Every call may come from any thread; one call and one query are under way at a time.

    Calls raise `RendererFailed` where the process has ended, RuntimeError in a fork of the process that started it.
    """

    def __init__(self, name: str, target: str, python: str) -> None:
        """`name` is the engine's in messages, `target` how the child makes it. Raises `ConfigError` where it does not begin."""
        self._name, self._owner = name, os.getpid()
        self._call_lock, self._query_lock, self._stop_lock = threading.Lock(), threading.Lock(), threading.Lock()
        self.scene: Any = None
        """The scene that the child holds."""
        ours, theirs = zip(*(socket.socketpair() for _ in range(3)), strict=True)
        reading, writing = os.pipe()
        try:
            self._process = _started(python, [each.fileno() for each in theirs], writing)
        except OSError as error:
            os.close(reading)
            raise ConfigError(f"{python}: cannot be started: {error.strerror or error}") from error
        finally:
            os.close(writing)
            for each in theirs:
                each.close()
        self._output = _Output(reading)
        self._calls, self._queries, self._stops = (Channel(each, self._alive) for each in ours)
        try:
            self.version: str = self.call("make", target, users_folders())
        except RaybenchError as error:
            self.end()
            raise ConfigError(f"{python}: cannot run the engine {name}: {error}") from error
        except BaseException:
            self.end()
            raise

    def call(self, verb: str, *arguments: Any, on_film: OnFilm = _go_on) -> Any:
        """The answer to a call. `on_film(kind, block, bad samples)` hears of films on the way to it, and says whether to go on;
        `block` is None where the memory is that of before."""
        with self._call_lock:
            return self._ask(self._calls, (verb, *arguments), on_film)

    def query(self, verb: str, *arguments: Any) -> Any:
        """The answer to a query, which is served beside a call."""
        with self._query_lock:
            return self._ask(self._queries, (verb, *arguments))

    def post(self, *request: Any) -> None:
        """Sends a request that has no answer."""
        with contextlib.suppress(Closed), self._call_lock:
            self._calls.send(request)

    def stop(self) -> None:
        """Asks for a running render to end, and returns once the engine has heard it: no later render is meant."""
        with contextlib.suppress(RendererFailed), self._stop_lock:
            self._ask(self._stops, ("stop",))

    def _ask(self, channel: Channel, request: tuple[Any, ...], on_film: OnFilm = _go_on) -> Any:
        self._require_owner()
        try:
            with self._unharmed():
                self._send(channel, request)
                while True:
                    answer = channel.receive()
                    if answer[0] == "done":
                        return answer[1]
                    if answer[0] == "failed":
                        break
                    kind, size, bad_samples = answer
                    block = None if size is None else Block(size[0], size[1], channel.receive_descriptor())
                    go_on = on_film(kind, block, bad_samples)
                    if kind == "pass":
                        channel.send(("go" if go_on else "end",))
        except Closed:
            raise RendererFailed(self._last_words()) from None
        _, error, text = answer
        error.add_note(f"In the process of the engine {self._name}:\n{text}")
        raise error

    @contextlib.contextmanager
    def _unharmed(self) -> Iterator[None]:
        """Ends the process where an answer was not waited for (Ctrl-C): the next one to come would be that."""
        try:
            yield
        except (Closed, Unsupported):
            raise
        except BaseException:
            self.end()
            raise

    def _send(self, channel: Channel, request: tuple[Any, ...]) -> None:
        try:
            channel.send(request)
        except Closed:
            raise
        except Exception as error:  # what pickle raises is no closed list
            reason = f"{self._name} runs in a process of its own, to which this cannot be sent: {error}"
            raise Unsupported(reason) from error

    def _require_owner(self) -> None:
        if os.getpid() != self._owner:
            raise RuntimeError(
                f"the process of this {self._name} is that of another one, of which this one is a fork: prepare another here"
            )

    def _alive(self) -> bool:
        return os.getpid() != self._owner or self._process.poll() is None

    @property
    def usable(self) -> bool:
        """Whether it runs, as a child of this process."""
        return os.getpid() == self._owner and self._process.poll() is None

    def _last_words(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_LAST_SECONDS)
        status = self._process.returncode
        if status is None:
            self._process.kill()
            how = "closed its sockets"
        else:
            how = f"was killed by {_signal(-status)}" if status < 0 else f"ended with status {status}"
        last = self._output.last_line()
        return f"{self._name}: its process {how}{': ' if last else ''}{last}"

    def end(self) -> None:
        """Ends the process, unless it is another's."""
        if os.getpid() != self._owner:
            return
        for each in (self._calls, self._queries, self._stops):
            each.close()
        try:
            self._process.wait(_LAST_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


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
        self._thread.join(_LAST_SECONDS)
        lines = [line.decode(errors="replace").strip() for line in self._lines]
        return next((line[:_MOST_CHARACTERS] for line in reversed(lines) if line), "")


def _started(python: str, descriptors: list[int], output: int) -> subprocess.Popen[bytes]:
    # Linux kills a child with the thread that started it, so that only the main thread's may ask for it.
    dies_with_it = threading.current_thread() is threading.main_thread()
    words = [python, str(CHILD), str(os.getpid()), str(int(dies_with_it)), *map(str, descriptors)]
    environment = {key: value for key, value in os.environ.items() if key not in _THEIRS}
    return subprocess.Popen(
        words, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output, pass_fds=descriptors
    )


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
