"""The side that asks: starts a Python that holds one engine, sends it calls, and ends it."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from typing import Any

from engines import processes
from engines.errors import ConfigError, RaybenchError, RendererFailed, Unsupported
from engines.imports import users_folders
from engines.peers.isolated.films import Block
from engines.peers.isolated.messages import Done, Failed, FilmReady, GoOn, Request
from engines.processes import Channel, Closed, pickled
from engines.processes.process import REMEMBERED

_LAST_SECONDS = 2.0
"""What a process has left to end in, once its sockets are closed."""
_POLL_SECONDS = 0.5
_THEIRS = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "PYTHONUSERBASE")
"""Variables that lead a Python to packages of another environment."""


OnFilm = Callable[[bool, Block | None, Any], bool]


def _go_on(callback: bool, block: Block | None, bad_samples: Any) -> bool:
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
        environment = {key: value for key, value in os.environ.items() if key not in _THEIRS}
        try:
            self._process = processes.Process(
                "engines.peers.isolated.server:serve",
                str(os.getpid()),
                python=python,
                environment=environment,
                output=REMEMBERED,
                channels=3,
                own_session=False,  # who kills this process's group ends it as well
            )
        except OSError as error:
            raise ConfigError(f"{python}: cannot be started: {error.strerror or error}") from error
        self._calls, self._queries, self._stops = self._process.channels
        try:
            self.version: str = self.call("make", target, users_folders())
        except RaybenchError as error:
            self.end()
            raise ConfigError(f"{python}: cannot run the engine {name}: {error}") from error
        except BaseException:
            self.end()
            raise

    def call(self, verb: str, *arguments: Any, on_film: OnFilm = _go_on) -> Any:
        """The answer to a call. `on_film(callback, block, bad samples)` hears of films on the way to it, and says whether to go
        on; `block` is None where the memory is that of before."""
        with self._call_lock:
            return self._ask(self._calls, Request(verb, arguments), on_film)

    def query(self, verb: str, *arguments: Any) -> Any:
        """The answer to a query, which is served beside a call."""
        with self._query_lock:
            return self._ask(self._queries, Request(verb, arguments))

    def drop(self) -> None:
        """Tells the process that its renderer is gone."""
        with contextlib.suppress(Closed), self._call_lock:
            pickled.send(self._calls, Request("drop"))

    def stop(self) -> None:
        """Asks for a running render to end, and returns once the engine has heard it: no later render is meant."""
        with contextlib.suppress(RendererFailed), self._stop_lock:
            self._ask(self._stops, Request("stop"))

    def _ask(self, channel: Channel, request: Request, on_film: OnFilm = _go_on) -> Any:
        self._require_owner()
        try:
            with self._unharmed():
                self._send(channel, request)
                while isinstance(answer := pickled.receive(channel, self._pause), FilmReady):
                    block = None if answer.size is None else Block(*answer.size, channel.receive_descriptor(self._pause))
                    go_on = on_film(answer.callback, block, answer.bad_samples)
                    if answer.callback:
                        pickled.send(channel, GoOn(go_on))
        except Closed:
            ending = self._process.ended(_LAST_SECONDS)
            self._process.kill()
            raise RendererFailed(f"{self._name}: its process {ending}") from None
        except (processes.BadMessage, pickled.Unreadable) as error:
            raise RendererFailed(f"{self._name}: its process was ended: {error}") from None
        if isinstance(answer, Done):
            return answer.result
        assert isinstance(answer, Failed)
        answer.error.add_note(f"In the process of the engine {self._name}:\n{answer.traceback}")
        raise answer.error

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

    def _send(self, channel: Channel, request: Request) -> None:
        try:
            pickled.send(channel, request)
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

    def _pause(self) -> float:
        """Gives up where the process has ended: a fork of it, or of this one, may hold the other end of the socket open."""
        if os.getpid() == self._owner and not self._process.runs:
            raise Closed
        return _POLL_SECONDS

    @property
    def usable(self) -> bool:
        """Whether it runs, as a child of this process."""
        return os.getpid() == self._owner and self._process.runs

    def end(self) -> None:
        """Ends the process, unless it is another's."""
        if os.getpid() == self._owner:
            self._process.end(_LAST_SECONDS)
