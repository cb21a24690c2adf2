"""The side that holds the engine. Calls are served in the main thread, queries in a second one, `stop` in a third.

Where the other process has gone, this one ends.
"""

from __future__ import annotations

import builtins
import gc
import hashlib
import os
import platform
import sys
import threading
import time
import traceback
from collections.abc import Iterable, Sequence
from importlib import metadata
from typing import Any

import numpy as np

from engines import errors
from engines.film import allocated_by
from engines.peers.isolated import films
from engines.peers.isolated.messages import Done, Failed, FilmReady, Request
from engines.processes import Channel, Closed, pickled
from engines.registry import make

_LAST_SECONDS = 0.5
"""What an idle process has left to end in, once its parent has gone or has closed the sockets."""
_POLL_SECONDS = 0.5


class CallbackFailed(Exception):
    """Ends a render whose `on_pass` raised in the other process, which knows the error."""


class Server:
    """One engine, and at most one renderer of it."""

    def __init__(self, calls: Channel, queries: Channel, stops: Channel, parent: int) -> None:
        self._calls, self._queries, self._stops, self._parent = calls, queries, stops, parent
        self._engine: Any = None
        self._scene: Any = None
        self._renderer: Any = None
        self._block: films.Block | None = None

    def serve(self) -> None:
        """Answers until the other end is closed."""
        threading.Thread(target=self._serve, args=(self._queries, self._query), daemon=True).start()
        threading.Thread(target=self._hear_stops, daemon=True).start()
        self._serve(self._calls, self._call)
        self._renderer = self._engine = None

    def _pause(self) -> float:
        """Gives up where the parent has ended: a fork of it may hold the other end of the sockets open."""
        if os.getppid() != self._parent:
            raise Closed
        return _POLL_SECONDS

    def _serve(self, channel: Channel, answer: Any) -> None:
        while True:
            try:
                request: Request = pickled.receive(channel, self._pause)
                if request.verb == "drop":
                    self._renderer = self._block = None
                else:
                    _send(channel, answer(request.verb, *request.arguments))
            except Closed:
                return
            except pickled.Unreadable as error:
                _send_failure(channel, errors.Unsupported(f"it cannot be had in the engine's own process: {error}"))
            except BaseException as error:
                _send_failure(channel, error)

    def _hear_stops(self) -> None:
        self._serve(self._stops, self._query)
        time.sleep(_LAST_SECONDS)
        os._exit(0)

    # --- the main thread ---------------------------------------------------------------------------------------------

    def _call(self, verb: str, *arguments: Any) -> Any:
        return getattr(self, f"_call_{verb}")(*arguments)

    def _call_folders(self, folders: Sequence[str]) -> None:
        sys.path.extend(folder for folder in folders if folder not in sys.path)

    def _call_make(self, target: str, folders: Sequence[str]) -> str:
        self._call_folders(folders)
        self._engine = make(target)
        return str(self._engine.version)

    def _call_environment(self) -> dict[str, str]:
        return environment(getattr(self._engine, "packages", None))

    def _call_scene(self, scene: Any) -> None:
        self._scene = scene

    def _call_why_not(self, settings: Any) -> Any:
        return self._engine.why_not(self._scene, settings)

    def _call_prepare(self, settings: Any) -> None:
        self._renderer = self._engine.prepare(self._scene, settings)
        self._tell_film(self._renderer.film)

    def _call_why_not_tracer(self, settings: Any) -> Any:
        return self._engine.why_not_tracer(self._scene, settings)

    def _call_tracer(self, settings: Any) -> None:
        self._renderer = self._engine.tracer(self._scene, settings)

    def _call_warm_up(self) -> None:
        self._renderer.warm_up()

    def _call_update(self, camera: Any, shapes: Any) -> None:
        self._renderer.update(camera, shapes)
        self._tell_film(self._renderer.film)

    def _call_render(self, spp: int, passes: bool, collects: bool) -> None:
        """`collects`: whether the garbage collector works in the process that asks; a clock may have put it to rest."""
        if not collects:
            gc.disable()
        try:
            self._tell_film(self._renderer.render(spp, self._on_pass) if passes else self._renderer.render(spp))
        finally:
            gc.enable()

    def _on_pass(self, film: Any) -> None:
        self._tell_film(film, callback=True)
        if not pickled.receive(self._calls, self._pause).yes:
            raise CallbackFailed

    def _tell_film(self, film: Any, callback: bool = False) -> None:
        """Sees that the other process has the film, and tells it what does not lie in the memory that both share."""
        block = films.block_of(film, self._block)
        new = (block.width, block.height) if block is not self._block else None
        pickled.send(self._calls, FilmReady(callback, new, film.bad_samples), None if new is None else block.descriptor)
        self._block = block

    # --- the other threads -------------------------------------------------------------------------------------------

    def _query(self, verb: str, *arguments: Any) -> Any:
        answer = getattr(self._renderer, verb)(*arguments)
        return dict(answer) if verb == "counters" and hasattr(answer, "keys") else answer


def _send(channel: Channel, result: Any) -> None:
    try:
        pickled.send(channel, Done(result))
    except Closed:
        raise
    except Exception as error:
        raise errors.RendererFailed(f"the engine's answer cannot be sent from its own process: {error}") from error


def _send_failure(channel: Channel, error: BaseException) -> None:
    """Sends an error: raybench's and Python's own as they are, others, which the other process may lack, as RendererFailed."""
    kind = type(error)
    home = {"engines.errors": errors, "builtins": builtins}.get(kind.__module__)
    text = "".join(traceback.format_exception(error))
    if home is None or getattr(home, kind.__name__, None) is not kind:
        error = errors.RendererFailed(f"{kind.__name__}: {error}")
    try:
        pickled.send(channel, Failed(error, text))
    except Closed:
        return
    except Exception:
        pickled.send(channel, Failed(errors.RendererFailed(f"{kind.__name__}: (it cannot be sent)"), text))


def environment(packages: Iterable[str] | None) -> dict[str, str]:
    """What this environment holds that may change an engine's images or speed.

    Versions of Python, NumPy and `packages` by name, and under "files" a hash of what was installed of `packages`, or of all
    packages: two builds of a package may have one version.
    """
    if packages is None:
        installed = sorted(metadata.distributions(), key=_name)
    else:
        installed = [package for name in sorted(packages) for package in metadata.distributions(name=name)]
    total = hashlib.sha256()
    for package in installed:
        total.update(f"{_name(package)}=={package.version}\n{_record(package)}".encode())
    named = {} if packages is None else {_name(package): package.version for package in installed}
    return {"python": platform.python_version(), "numpy": np.__version__, **named, "files": total.hexdigest()[:16]}


def _name(distribution: metadata.Distribution) -> str:
    return distribution.metadata["Name"] or ""


def _record(distribution: metadata.Distribution) -> str:
    """The hashes that the installer wrote, but for scripts, which name the environment's folder, and compiled Python."""
    lines = (distribution.read_text("RECORD") or "").splitlines()
    kept = (line for line in lines if not line.startswith("..") and ".pyc," not in line and ".dist-info/" not in line)
    return "\n".join(sorted(kept))


def serve(descriptors: Sequence[int], arguments: Sequence[str]) -> None:
    """Serves over three sockets until they are closed, or the process ends as whose child this one was started."""
    calls, queries, stops = map(Channel.at, descriptors)
    with allocated_by(films.allocate):
        Server(calls, queries, stops, int(arguments[0])).serve()
