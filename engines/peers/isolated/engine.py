"""The engine and the renderer that pass calls on to a process of the engine's own."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines import interface
from engines.concurrency import CallGuard
from engines.film import Film
from engines.imports import users_folders
from engines.interface import Hits, OnPass, Settings
from engines.peers.isolated.films import Block, film_in
from engines.peers.isolated.process import Process
from engines.scene import Camera, Scene, Shape

MOST_IDLE = 2


class Engine:
    """An engine that renders in a process of its own; every living renderer has one.

    What an engine says about itself is asked of `local`, the engine's class made in this process; but for its version, and
    whether it can render a scene.
    """

    own_process = True

    def __init__(self, local: interface.Engine, target: str, python: str, named: bool) -> None:
        """`target` is how the process makes the engine, `python` the interpreter that runs it; `named` says that the user
        chose it, so that its environment is part of what is compared."""
        self.local, self.name = local, local.name
        self.python, self._named = python, named
        self._processes = _Processes(local.name, target, python)
        weakref.finalize(self, self._processes.end)

    def __getattr__(self, name: str) -> Any:
        if name == "local":  # before it is set
            raise AttributeError(name)
        attribute = getattr(self.local, name)
        return {"why_not_tracer": self._why_not_tracer, "tracer": self._tracer}.get(name, attribute)

    @cached_property
    def version(self) -> str:
        """As the engine says it in its own environment."""
        with self._processes.lent() as process:
            return process.version

    @cached_property
    def environment(self) -> Mapping[str, str] | None:
        """Versions of Python, NumPy and the engine's packages where the user has chosen the environment; None where it is this
        process's own."""
        if not self._named:
            return None
        with self._processes.lent() as process:
            return process.call("environment")

    def accelerators(self) -> Mapping[str, Mapping[str, Any]]:
        return self.local.accelerators()

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        with self._processes.lent() as process:
            _send_scene(process, scene)
            return process.call("why_not", settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        return Renderer(self._processes, scene, settings)

    def _why_not_tracer(self, scene: Scene, settings: Settings) -> str | None:
        with self._processes.lent() as process:
            _send_scene(process, scene)
            return process.call("why_not_tracer", settings)

    def _tracer(self, scene: Scene, settings: Settings) -> interface.RayTracer:
        return Renderer(self._processes, scene, settings, "tracer")


class Renderer:
    """A renderer whose work is done in another process; its film lies in memory that both share.

    `stop` and the queries are heard there by threads of their own: an engine that holds Python's global lock hears them late.
    """

    def __init__(self, processes: _Processes, scene: Scene, settings: Settings, verb: str = "prepare") -> None:
        """`verb`: `prepare`, or `tracer` for one that traces rays alone."""
        self._guard = CallGuard()  # in a forked process calls are refused
        self._on_pass: OnPass | None = None
        self._callback_error: BaseException | None = None
        process = processes.take()
        try:
            _send_scene(process, scene)
            process.call(verb, settings, on_film=self._take_film)
        except BaseException:
            processes.give_back(process)
            raise
        self._process = process
        weakref.finalize(self, processes.drop, process)

    film: Film

    def warm_up(self) -> None:
        with self._guard.rendering("warm_up"):
            self._process.call("warm_up")

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        with self._guard.rendering():
            self._on_pass, self._callback_error = on_pass, None
            try:
                self._process.call("render", spp, on_pass is not None, gc.isenabled(), on_film=self._take_film)
            except Exception:
                if self._callback_error is None:
                    raise
            finally:
                self._on_pass, error = None, self._callback_error
                self._callback_error = None
            if error is not None:
                raise error
            return self.film

    def _take_film(self, callback: bool, block: Block | None, bad_samples: Any) -> bool:
        if block is not None:
            self.film = film_in(block)
        self.film.bad_samples = bad_samples
        if callback and self._on_pass is not None:
            try:
                self._on_pass(self.film)
            except BaseException as error:
                self._callback_error = error
                return False
        return True

    def stop(self) -> None:
        self._process.stop()

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        with self._guard.updating():
            self._process.call("update", camera, None if shapes is None else tuple(shapes), on_film=self._take_film)

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        with self._guard.tracing():
            return self._process.query("trace", origins, directions, t_max)

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        with self._guard.tracing():
            return self._process.query("occluded", origins, directions, t_max)

    def counters(self) -> Mapping[str, float]:
        return self._process.query("counters")


def _send_scene(process: Process, scene: Scene) -> None:
    """Sends a scene unless it is the last one that was sent: planning asks of one scene many times."""
    if process.scene is not scene:
        process.scene = None
        process.call("folders", users_folders())  # loading the scene may have found plugins beside it
        process.call("scene", scene)
        process.scene = scene


class _Processes:
    """The processes of an engine that no renderer holds. Some are kept, and with them what they have imported and compiled."""

    def __init__(self, name: str, target: str, python: str) -> None:
        self._name, self._target, self._python = name, target, python
        self._lock = threading.RLock()  # a renderer may be collected anywhere, here, too
        self._idle: list[Process] = []
        self._most = MOST_IDLE

    def take(self) -> Process:
        """A process for the caller alone, started where none is idle."""
        with self._lock:
            while self._idle:
                process = self._idle.pop()
                if process.usable:
                    return process
        return Process(self._name, self._target, self._python)

    def give_back(self, process: Process) -> None:
        with self._lock:
            kept = process.usable and len(self._idle) < self._most
            if kept:
                self._idle.append(process)
        if not kept:
            process.end()

    @contextmanager
    def lent(self) -> Iterator[Process]:
        """A process for the time of a `with`."""
        process = self.take()
        try:
            yield process
        finally:
            self.give_back(process)

    def drop(self, process: Process) -> None:
        """Takes a process back whose renderer is gone."""
        if process.usable:
            process.drop()
        self.give_back(process)

    def end(self) -> None:
        """Ends those that are idle, and every other one as soon as it is given back."""
        with self._lock:
            idle, self._idle, self._most = self._idle, [], 0
        for process in idle:
            process.end()


__all__ = ["Engine", "Renderer"]
