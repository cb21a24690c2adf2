"""Run-queue wait of threads, from Linux' schedstat: how long a thread could have run, but no processor was free for it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Iterable
from time import monotonic


def thread_waits(pids: Iterable[int]) -> dict[int, int] | None:
    """Nanoseconds that each thread of the processes has waited since it began, by thread id; None where the kernel does
    not say. Processes that have ended have no threads."""
    found: dict[int, int] = {}
    for pid in pids:
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            for task in os.listdir(f"/proc/{pid}/task"):
                with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                    found[int(task)] = _wait(f"/proc/{pid}/task/{task}/schedstat")
    return found if readable() else None


def _wait(path: str) -> int:
    with open(path, "rb") as file:
        return int(file.read().split()[1])


def readable() -> bool:
    """Whether the kernel counts what threads wait: some lack the file, or fill it with zeros."""
    try:
        with open("/proc/thread-self/schedstat", "rb") as file:
            return int(file.read().split()[0]) > 0
    except (OSError, ValueError, IndexError):
        return False


class EndedThreads:
    """What threads waited that end within a timed call. The process itself counts those that are alive after it; its parent
    looks now and then, and so knows of the others all but their last moments."""

    def __init__(self) -> None:
        self._seen: dict[int, list[tuple[float, int]]] = {}
        self._now: dict[int, int] = {}

    def look(self, pids: Iterable[int]) -> None:
        """Remembers what every thread has waited until now."""
        now, self._now = monotonic(), thread_waits(pids) or {}
        for thread, wait in self._now.items():
            known = self._seen.setdefault(thread, [])
            if not known or known[-1][1] != wait:
                known.append((now, wait))

    def waited(self, pids: Iterable[int], start: float, end: float, alive: Collection[int]) -> float:
        """Seconds between two moments of `monotonic`, of threads that have ended and are not among `alive`, the known ones."""
        self.look(pids)
        counted, total = {*alive, *self._now}, 0
        for thread, known in self._seen.items():
            if thread not in counted:
                before = max((wait for moment, wait in known if moment <= start), default=0)
                total += max((wait for moment, wait in known if moment <= end), default=before) - before
        self._seen = {thread: known[-1:] for thread, known in self._seen.items() if thread in self._now}
        return 1e-9 * total
