"""What disturbed a timing, and whether that was too much: waiting for a processor, stolen time, work of other processes.

A cell is contended where its threads waited in the run queue, or were stolen from by other guests of the host, for more than
`SHARE` of the wall time of its timed calls, and more than `SLICE`, times its threads. Where the kernel does not say what
threads wait, and where a cell has more threads than there are cores, so that they wait for each other, cells of one contestant
are compared: `contended_by_cpu_time`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from time import monotonic
from typing import Any, NamedTuple

import psutil

from harness.config.kinds import is_number
from harness.measure.machine import load_1m, usable_cores
from harness.measure.memory import descendants
from harness.measure.run_queue import readable, thread_waits

try:
    import resource
except ImportError:  # Windows
    resource = None

SHARE = 0.05
"""Of wall time times threads."""
SLICE = 0.002
"""Seconds a thread: two threads that an engine starts were seen to wait up to 1.8 ms until each had a core, on an idle Xeon."""
LEAST_CPU_SECONDS = 0.5
"""Of a cell, for its share of a processor to mean anything."""
RUN_QUEUE, CPU_TIME = "run queue", "cpu time"
"""The two rules."""


class Sample(NamedTuple):
    """Seconds since boot that the usable cores were busy or stolen; processor time of this process and of all that it has
    started; involuntary context switches of this process."""

    busy: float
    steal: float
    own: float
    involuntary_switches: int


class Disturbance:
    """Sums what happened on the machine between `start` and `stop`, over all the timed calls of a cell.

    `window` holds the moments (of `monotonic`) of the last call, `alive` the threads that there were after it. `off_clock` is
    the processor time between one call and the next of threads other than the one that calls, and of processes that were
    started: nothing was asked of them.
    """

    def __init__(self) -> None:
        self.wall = self.steal = self.others = self.cpu = self.off_clock = 0.0
        self.waited: float | None = 0.0
        self.switches = 0
        self.window = (0.0, 0.0)
        self.alive: list[int] = []
        self._before, self._waits_before = sample(), own_waits()
        self._other_threads: float | None = None

    def start(self) -> None:
        self.rest()
        self._before, self._waits_before = sample(), own_waits()  # in this order: waits are counted in nanoseconds
        self.window = (monotonic(), 0.0)

    def rest(self) -> None:
        """Adds what threads did since the last call; until the next one they may work."""
        if self._other_threads is not None:
            self.off_clock += max(0.0, other_threads() - self._other_threads)
            self._other_threads = None

    def stop(self, seconds: float) -> None:
        """Adds the interval since `start`, of which `seconds` were on the clock."""
        self.window = (self.window[0], monotonic())
        waits = own_waits()
        before, after = self._before, sample()
        self.wall += seconds
        self.steal += after.steal - before.steal
        self.cpu += after.own - before.own
        self.others += (after.busy - before.busy) - (after.own - before.own)
        self.switches += after.involuntary_switches - before.involuntary_switches
        self.alive = list(waits or ())
        if self.waited is None or self._waits_before is None or waits is None:
            self.waited = None
        else:
            self.waited += 1e-9 * sum(wait - self._waits_before.get(thread, 0) for thread, wait in waits.items())
        self._other_threads = other_threads()

    def report(self) -> dict[str, Any]:
        """The `machine` part of a cell's event, but for the verdict of `judged`."""
        return {
            "load_1m": round(load_1m(), 2),
            "timed_seconds": round(self.wall, 6),
            "cpu_seconds": round(self.cpu, 6),
            "off_clock_cpu_seconds": round(self.off_clock, 6),
            "run_queue_seconds": None if self.waited is None else round(self.waited, 6),
            "steal_seconds": round(max(0.0, self.steal), 3),
            "other_cpu_seconds": round(max(0.0, self.others), 3),
            "involuntary_switches": self.switches,
        }


def sample() -> Sample:
    """The machine's counters now."""
    cores = psutil.cpu_times(percpu=True)
    usable = [cores[index] for index in usable_cores() if index < len(cores)]
    busy = sum(sum(core) - core.idle - getattr(core, "iowait", 0.0) - _counted_twice(core) for core in usable)
    steal = sum(getattr(core, "steal", 0.0) for core in usable)
    switches = resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw if resource else 0
    return Sample(busy, steal, time.process_time() + below(), switches)


def other_threads() -> float:
    """Processor time of this process and of all that it has started, without that of the thread that calls."""
    return time.process_time() - time.thread_time() + below()


def below() -> float:
    """Processor time of the processes that this one has started: of those that run, and of those that have ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN) if resource else None
    running = sum(map(_processor_seconds, descendants(os.getpid())))
    return running + (ended.ru_utime + ended.ru_stime if ended else 0.0)


def _processor_seconds(pid: int) -> float:
    """Processor time of a process and of its threads that have ended; 0 where it has ended."""
    try:
        if sys.platform == "linux":
            return time.clock_gettime((~pid << 3) | 2)  # as clock_getcpuclockid(3) finds it: no ticks of 10 ms
        times = psutil.Process(pid).cpu_times()
        return times.user + times.system
    except (OSError, psutil.Error):
        return 0.0


def own_waits() -> dict[int, int] | None:
    """`thread_waits` of this process and of all that it has started."""
    pid = os.getpid()
    return thread_waits([pid, *descendants(pid)]) if readable() else None


def _counted_twice(core: Any) -> float:
    """Linux counts guests in `user` and `nice` too."""
    return getattr(core, "guest", 0.0) + getattr(core, "guest_nice", 0.0)


def judged(machine: Mapping[str, Any], threads: int, ended: float = 0.0) -> dict[str, Any]:
    """The `machine` part of a cell's event with `contended` and the rule that says so, on the machine that measured it.

    `ended` are seconds that threads waited which the process itself could not count, for they had ended.
    """
    waited, steal, wall = (_number(machine, key) for key in ("run_queue_seconds", "steal_seconds", "timed_seconds"))
    if waited is None or wall is None or threads > len(usable_cores()):
        return {**machine, "contended": False, "contention_rule": CPU_TIME}
    waited += ended
    contended = waited + (steal or 0.0) > max(SHARE * wall, SLICE) * threads
    return {**machine, "run_queue_seconds": round(waited, 6), "contended": contended, "contention_rule": RUN_QUEUE}


def _number(machine: Mapping[str, Any], key: str) -> float | None:
    """A number of a worker's message, which an engine may have written."""
    value: Any = machine.get(key)
    return float(value) if is_number(value) else None
