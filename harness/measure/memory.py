"""Memory of a worker and of all that it has started, and how much of it a cell may hold."""

from __future__ import annotations

import contextlib
from pathlib import Path
from time import monotonic

import psutil

from engines.memory import machine_bytes
from harness.config.kinds import UNITS

DEFAULT_SHARE = 0.75
"""Of the machine's memory, for a cell that no config limits."""
POLL_SECONDS = 0.05
"""Between two looks at a worker's memory: some 0.1 ms each, while the parent has nothing else to do."""
TREE_SECONDS = 0.2
"""Between two looks at which processes there are: that costs more."""


def words(size: float) -> str:
    """Bytes in the binary unit that suits: 9.1 GiB."""
    unit = next((unit for unit in ("TiB", "GiB", "MiB", "KiB") if size >= UNITS[unit]), "B")
    return f"{size / UNITS[unit]:.3g} {unit}" if size < 1000 * UNITS[unit] else f"{size / UNITS[unit]:.0f} {unit}"


def default_limit(share: float = 1.0) -> int:
    """Bytes that a cell may hold where the config sets no limit; `share` is its part of the machine."""
    return int(DEFAULT_SHARE * share * machine_bytes())


class Watch:
    """A process and all that it has started. `resident` may be called many times per second."""

    def __init__(self, pid: int) -> None:
        self._top = psutil.Process(pid)
        self._below: list[psutil.Process] = []
        self._looked = 0.0

    @property
    def pids(self) -> list[int]:
        """The process and those below it, as of the last look."""
        return [self._top.pid, *(process.pid for process in self._below)]

    def resident(self, forks: bool) -> int:
        """Bytes that are resident. A worker that `forks` shares its pages with its children: only theirs are counted
        while there are some."""
        if monotonic() - self._looked > TREE_SECONDS:
            self.look()
        below = sum(map(_resident, self._below))
        own = _resident(self._top)
        return max(own, below) if forks else own + below

    def look(self) -> None:
        """Finds the processes that there are now."""
        self._looked = monotonic()
        known = {process.pid: process for process in self._below}
        pids = descendants(self._top.pid)
        self._below = []
        for pid in pids:
            with contextlib.suppress(psutil.Error):
                self._below.append(known.get(pid) or psutil.Process(pid))

    def kill(self) -> None:
        """Ends all processes below the top one, those that left its group, too."""
        self.look()
        for process in self._below:
            with contextlib.suppress(psutil.Error):
                process.kill()


def _resident(process: psutil.Process) -> int:
    try:
        return process.memory_info().rss
    except psutil.Error:
        return 0


def descendants(pid: int) -> list[int]:
    """Ids of all processes below `pid`."""
    found, waiting = [], [pid]
    try:
        while waiting:
            children = _children(waiting.pop())
            found += children
            waiting += children
    except FileNotFoundError:  # no /proc, or one without this file: slower, since all processes of the machine are read
        with contextlib.suppress(psutil.Error):
            return [child.pid for child in psutil.Process(pid).children(recursive=True)]
    return found


def _children(pid: int) -> list[int]:
    """Children of a process; none where it has ended. Raises `FileNotFoundError` where Linux does not list them."""
    tasks = Path("/proc", str(pid), "task")
    found: list[int] = []
    for task in _listing(tasks):
        try:
            found += map(int, (task / "children").read_text().split())
        except FileNotFoundError:
            if task.exists():
                raise
        except OSError:  # it ended meanwhile
            continue
    return found


def _listing(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        if not Path("/proc/self/task").exists():
            raise FileNotFoundError(folder) from None
        return []
