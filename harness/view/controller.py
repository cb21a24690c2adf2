"""What the pages have in common in their worker: requests wait in a queue, and one thread handles them in turn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from typing import Any

from engines.errors import ConfigError
from harness.view.coalescing_queue import CoalescingQueue
from harness.view.messages import coalescing_key, failure_message, packed


class Controller(ABC):
    """Runs a page. `receive` is called on the reading thread and returns at once; `run` handles requests on the main thread,
    each by the method `_on_<type>`, and never returns. A request without such a method is answered with an error."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._work = CoalescingQueue()
        self._seq = 0

    def receive(self, request: Any) -> None:
        self._work.put(request, self._key(request))

    def _key(self, request: Any) -> Hashable:
        return coalescing_key(request.type, getattr(request, "finger", None))

    @abstractmethod
    def start(self) -> None:
        """Sends the menu, and starts threads."""

    def run(self) -> None:
        while True:
            try:
                self._step()
            except Exception as error:
                self._send(failure_message(error))
                self._rest()

    def _step(self) -> None:
        """Waits for a request and handles it, or renders."""
        self._handle(self._work.take())

    @abstractmethod
    def _rest(self) -> None:
        """Tells the page that nothing is rendered any more, after an error."""

    def _handle(self, request: Any) -> None:
        self._seq = max(self._seq, request.seq)
        getattr(self, f"_on_{request.type}", self._refuse)(request)

    def _refuse(self, request: Any) -> None:
        raise ConfigError(f"this page has no request {request.type!r}")

    def _message(self, type: str, payload: bytes = b"", **fields: Any) -> None:
        self._send(packed({"type": type, **fields}, payload))
