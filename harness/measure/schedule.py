"""Checkpoints of a cell: at how many samples per pixel its error is measured, and when it stops."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from harness.config import Checkpoints
    from harness.config.settings import Budget

OVERSHOOT = 2.0
"""A pass is shortened when it is predicted to end later than this many times the budget."""
ROOT_OF_TWO = 2.0**0.5


class Schedule(NamedTuple):
    """Checkpoints in samples per pixel, from `start` on by `ratio`, and when to stop."""

    ratio: float
    start: int
    max_spp: int
    max_time_seconds: float

    @classmethod
    def of(cls, checkpoints: Checkpoints, budget: Budget) -> Schedule:
        """That of a cell with the budget."""
        return cls(checkpoints.ratio, checkpoints.start, budget.max_spp, budget.max_time_seconds)


def checkpoints(schedule: Schedule) -> Iterator[int]:
    """Strictly rising samples per pixel, ending with `max_spp`: start, start ratio, start ratio^2, ..., rounded.

    The root of two is taken as 3/2 and 4/3 in turn: 1, 2, 3, 4, 6, 8, 12, ..., since the points of quasi-random samplers
    are good at multiples of powers of two.
    """
    last = 0
    for step in count():
        if last >= schedule.max_spp:
            return
        growth = schedule.ratio**step
        if schedule.ratio == ROOT_OF_TWO:
            growth = 2.0 ** (step // 2) * (1.5 if step % 2 else 1.0)
        checkpoint = min(round(schedule.start * growth), schedule.max_spp)
        if checkpoint > last:
            yield checkpoint
            last = checkpoint


def shortened(checkpoint: int, done: int, seconds: float, seconds_per_spp: float, max_time: float) -> int:
    """The checkpoint to render to instead of `checkpoint`, so that the budget is not overshot wildly; `done` means stop.

    A pass that is predicted to end within `OVERSHOOT` budgets is left alone: seeds then share their checkpoints. At
    least one sample per pixel is rendered.
    """
    if seconds + (checkpoint - done) * seconds_per_spp <= OVERSHOOT * max_time:
        return checkpoint
    fits = done + int(max(0.0, max_time - seconds) / seconds_per_spp)
    return min(checkpoint, max(fits, done, 1))
