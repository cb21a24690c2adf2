"""Which cells other work on the machine has slowed down, where only a comparison of blocks can tell."""

from __future__ import annotations

from collections.abc import Mapping

from harness.measure.contention import CPU_TIME, LEAST_CPU_SECONDS, SHARE
from harness.store.records import Machine


def contended_by_cpu_time(machines: Mapping[str, Machine]) -> set[str]:
    """Ids of the cells of one contestant, of which `machines` says what the machine did, that used
    less than 95 % of the processor time, per second of wall time, of its best
    block, where other processes used at least half of what is lacking. Cells that the run queue has judged are left out."""
    known: dict[str, tuple[float, float, float]] = {}
    for cell_id, machine in machines.items():
        cpu, wall = machine.cpu_seconds, machine.timed_seconds
        if machine.contention_rule == CPU_TIME and wall and cpu is not None and cpu >= LEAST_CPU_SECONDS:
            known[cell_id] = (cpu / wall, wall, machine.other_cpu_seconds or 0.0)
    best = max((share for share, _, _ in known.values()), default=0.0)
    return {
        cell_id
        for cell_id, (share, wall, others) in known.items()
        if share < (1.0 - SHARE) * best and others >= 0.5 * (best - share) * wall
    }
