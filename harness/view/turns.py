"""Tabs that render share the cores; beyond a few they wait for one another."""

from __future__ import annotations

import asyncio

MOST_TABS = 16
"""Open pages: each has a process of some 200 MB."""
MOST_RENDERS = 4
"""Tabs that render at once. The system shares the cores among them; more would all be slow."""


class Turns:
    """Who renders. A tab `acquire`s its turn before it begins and gives it back when its image rests."""

    def __init__(self, most: int = MOST_RENDERS) -> None:
        self._most = most
        self._holders: set[object] = set()
        self._queue: list[tuple[object, asyncio.Future[bool]]] = []

    def free_for(self, tab: object) -> bool:
        """Whether `tab` would not have to wait."""
        return tab in self._holders or (len(self._holders) < self._most and not self._queue)

    @property
    def rendering(self) -> int:
        return len(self._holders)

    async def acquire(self, tab: object) -> bool:
        """Waits until it is the tab's turn; False where it gave up before."""
        if self.free_for(tab):
            self._holders.add(tab)
            return True
        turn: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._queue.append((tab, turn))
        return await turn

    def give_up(self, tab: object) -> None:
        """Takes a tab off the queue."""
        for waiting in [waiting for waiting in self._queue if waiting[0] == tab]:
            self._queue.remove(waiting)
            if not waiting[1].done():
                waiting[1].set_result(False)

    def release(self, tab: object) -> None:
        """Gives a turn back, or takes a tab that has gone off the queue; the next in line begins."""
        self.give_up(tab)
        self._holders.discard(tab)
        while self._queue and len(self._holders) < self._most:
            following, turn = self._queue.pop(0)
            if not turn.done():
                self._holders.add(following)
                turn.set_result(True)
