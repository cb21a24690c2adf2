"""A limited number of tabs render at the same time; the others wait in a queue."""

from __future__ import annotations

import asyncio

MAX_TABS = 16
"""Open pages at most: each has a process of some 200 MB."""
MAX_RENDERS = 4
"""Tabs that render at the same time, at most: they share the cores."""


class RenderSlots:
    """The slots. A tab acquires one before it renders, and releases it when it does not render any more."""

    def __init__(self, limit: int = MAX_RENDERS) -> None:
        self._limit = limit
        self._holders: set[object] = set()
        self._queue: list[tuple[object, asyncio.Future[bool]]] = []

    def is_free_for(self, tab: object) -> bool:
        """Whether `acquire` would not wait."""
        return tab in self._holders or (len(self._holders) < self._limit and not self._queue)

    @property
    def in_use(self) -> int:
        return len(self._holders)

    async def acquire(self, tab: object) -> bool:
        """Waits for a slot; False where the tab was taken off the queue meanwhile."""
        if self.is_free_for(tab):
            self._holders.add(tab)
            return True
        slot: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._queue.append((tab, slot))
        return await slot

    def cancel(self, tab: object) -> None:
        """Takes a tab off the queue; its `acquire` returns False."""
        for waiting in [waiting for waiting in self._queue if waiting[0] == tab]:
            self._queue.remove(waiting)
            if not waiting[1].done():
                waiting[1].set_result(False)

    def release(self, tab: object) -> None:
        """Frees the slot of a tab, or takes it off the queue; the next tabs in the queue get free slots."""
        self.cancel(tab)
        self._holders.discard(tab)
        while self._queue and len(self._holders) < self._limit:
            following, slot = self._queue.pop(0)
            if not slot.done():
                self._holders.add(following)
                slot.set_result(True)
