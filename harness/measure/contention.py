"""What disturbed a timing: CPU time of other processes and of other guests of the host, and context switches."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import psutil

from harness.measure.machine import load_1m, usable_cores

try:
    import resource
except ImportError:  # Windows
    resource = None

OTHER_SHARE = 0.25
"""Cores' worth of other processes' work during a timing above which it counts as contended."""
STEAL_SHARE = 0.02


class Sample(NamedTuple):
    """Seconds since boot that the usable cores were busy or stolen; this process's own, with its children's; counts."""

    busy: float
    steal: float
    own: float
    involuntary_switches: int


class Disturbance:
    """Sums what happened on the machine between `start` and `stop`, over all the timed calls of a cell."""

    def __init__(self) -> None:
        self.wall = self.steal = self.others = 0.0
        self.switches = 0
        self._before = sample()

    def start(self) -> None:
        self._before = sample()

    def stop(self, seconds: float) -> None:
        """Adds the interval since `start`, of which `seconds` were on the clock."""
        before, after = self._before, sample()
        self.wall += seconds
        self.steal += after.steal - before.steal
        self.others += (after.busy - before.busy) - (after.own - before.own)
        self.switches += after.involuntary_switches - before.involuntary_switches

    def report(self) -> dict[str, Any]:
        """The `machine` part of a cell's event. The kernel counts in ticks of 10 ms: short cells get a margin."""
        margin = 0.1 + 0.02 * len(usable_cores())
        beside = self.others > OTHER_SHARE * self.wall + margin
        stolen = self.steal > STEAL_SHARE * self.wall + margin
        return {
            "load_1m": round(load_1m(), 2),
            "steal_seconds": round(max(0.0, self.steal), 3),
            "other_cpu_seconds": round(max(0.0, self.others), 3),
            "involuntary_switches": self.switches,
            "contended": bool(beside or stolen),
        }


def sample() -> Sample:
    """The machine's counters now."""
    cores = psutil.cpu_times(percpu=True)
    usable = [cores[index] for index in usable_cores() if index < len(cores)]
    busy = sum(sum(core) - core.idle - getattr(core, "iowait", 0.0) - _counted_twice(core) for core in usable)
    steal = sum(getattr(core, "steal", 0.0) for core in usable)
    times = os.times()
    switches = resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw if resource else 0
    own = times.user + times.system + times.children_user + times.children_system  # children: renderers by process
    return Sample(busy, steal, own, switches)


def _counted_twice(core: Any) -> float:
    """Linux counts guests in `user` and `nice` too."""
    return getattr(core, "guest", 0.0) + getattr(core, "guest_nice", 0.0)
