"""A queue of requests in which a request replaces a waiting one with the same key (camera moves, drags)."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from typing import Any

MAX_WAITING = 64


class CoalescingQueue:
    """Requests in the order of arrival, at most `MAX_WAITING` of those without a key. Thread-safe."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Hashable, Any]] = []
        self._arrived = threading.Condition()

    def put(self, request: Any, key: Hashable = None) -> bool:
        """Adds a request, in place of a waiting one with this key. False where the queue is full and the request is dropped."""
        with self._arrived:
            if key is not None:
                self._waiting = [other for other in self._waiting if other[0] != key]
            elif len(self._waiting) >= MAX_WAITING:
                return False
            self._waiting.append((key, request))
            self._arrived.notify_all()
            return True

    def take(self, seconds: float | None = None) -> Any:
        """Removes and returns the oldest request; None where none arrives within `seconds` (None: waits for one)."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._waiting), seconds)
            return self._waiting.pop(0)[1] if self._waiting else None

    def __bool__(self) -> bool:
        return bool(self._waiting)
