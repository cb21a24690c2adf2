"""Where requests wait: of those with one key (camera moves, drags) the last alone is kept, of others a limited number."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from typing import Any

MOST = 64


class Mailbox:
    """Requests in the order of arrival, for a thread that takes them."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Hashable, Any]] = []
        self._arrived = threading.Condition()

    def put(self, request: Any, key: Hashable = None) -> bool:
        """Adds a request in place of an older one of that key; False where too many wait and it is dropped."""
        with self._arrived:
            if key is not None:
                self._waiting = [other for other in self._waiting if other[0] != key]
            elif len(self._waiting) >= MOST:
                return False
            self._waiting.append((key, request))
            self._arrived.notify_all()
            return True

    def take(self, seconds: float | None = None) -> Any:
        """The oldest request; None where none came within `seconds` (None: waits for one)."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._waiting), seconds)
            return self._waiting.pop(0)[1] if self._waiting else None

    def clear(self) -> None:
        """Forgets what waits."""
        with self._arrived:
            self._waiting.clear()

    def __bool__(self) -> bool:
        return bool(self._waiting)
