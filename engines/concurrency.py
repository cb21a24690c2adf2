"""Which calls of a renderer may run at the same time, and in which process.

The rule is that of `engines.interface.Renderer`: one render, warm-up or update at a time; rays may be traced beside a
render and beside each other, but not while an update changes the scene.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_first_in_process = threading.Lock()


def _renew_lock() -> None:
    global _first_in_process
    _first_in_process = threading.Lock()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_renew_lock)


class CallGuard:
    """Held by a renderer; each of its public calls runs within one of the three contexts.

    A process that is forked inherits locks whose owners do not run in it, and no threads. There the guard calls
    `after_fork` once, a method of the renderer that replaces its threads; without one, calls are refused there.
    """

    def __init__(self, after_fork: Callable[[], None] | None = None) -> None:
        # weak: renderer and guard would be a cycle, and memory outside of Python would wait for the cyclic collector
        self._after_fork = weakref.WeakMethod(after_fork) if after_fork is not None else None
        self._renew()

    def _renew(self) -> None:
        self._call = ""
        self._exclusive = threading.Lock()
        self._changed = threading.Condition()
        self._queries, self._updating = 0, False
        self._process = os.getpid()  # last: then the locks are this process's

    @contextmanager
    def rendering(self, call: str = "render") -> Iterator[None]:
        """For `render` and `warm_up`. Raises RuntimeError while another one, or an update, is under way."""
        self._enter_process()
        if not self._exclusive.acquire(blocking=False):
            raise RuntimeError(
                f"{call}: this renderer is busy with {self._call or 'another call'}; call stop() and wait for it, "
                "or prepare a second renderer"
            )
        self._call = call
        try:
            yield
        finally:
            self._call = ""
            self._exclusive.release()

    @contextmanager
    def updating(self) -> Iterator[None]:
        """For `update`. Waits for rays that are being traced; raises RuntimeError while a render is under way."""
        with self.rendering("update"):
            try:
                with self._changed:
                    self._updating = True
                    self._changed.wait_for(lambda: self._queries == 0)
                yield
            finally:
                with self._changed:
                    self._updating = False
                    self._changed.notify_all()

    @contextmanager
    def tracing(self) -> Iterator[None]:
        """For `trace` and `occluded`. Waits for an update."""
        self._enter_process()
        with self._changed:
            self._changed.wait_for(lambda: not self._updating)
            self._queries += 1
        try:
            yield
        finally:
            with self._changed:
                self._queries -= 1
                self._changed.notify_all()

    def _enter_process(self) -> None:
        if self._process == os.getpid():
            return
        with _first_in_process:
            if self._process == os.getpid():  # another thread was first
                return
            after_fork = self._after_fork() if self._after_fork is not None else None
            if after_fork is None or self._exclusive.locked():
                raise RuntimeError(
                    "this renderer was prepared in a process of which this one is a fork, and "
                    + ("cannot be used here" if after_fork is None else "was busy at the time")
                    + ": prepare another one here"
                )
            after_fork()
            self._renew()


__all__ = ["CallGuard"]
