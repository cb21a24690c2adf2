"""`targets: auto`: errors that are worth timing, chosen once from the first results."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import median

from harness.store.records import Cell

COUNT = 4
STEPS = (1.0, 3.0)
"""Targets are 1 or 3 times a power of ten: round numbers half a decade apart."""


def automatic_targets(cells: Iterable[Cell], metric: str) -> list[float]:
    """Up to four falling targets. The hardest is one that half of the cells of the noisiest scene reach.

    Empty where nothing was measured.
    """
    finals: dict[str, list[float]] = {}
    for cell in cells:
        error = cell.end.metrics.get(metric) if cell.state == "done" and cell.points else None
        if error is not None and 0 < error < math.inf:
            finals.setdefault(cell.scene_hash, []).append(error)
    if not finals:
        return []
    hardest = _rounded_up(max(median(errors) for errors in finals.values()))
    exponent = round(2 * math.log10(hardest))
    return [_level(exponent + step) for step in range(COUNT - 1, -1, -1)]


def _rounded_up(error: float) -> float:
    exponent = math.floor(2 * math.log10(error))
    while _level(exponent) < error:
        exponent += 1
    return _level(exponent)


def _level(half_decades: int) -> float:
    """..., 0.1, 0.3, 1, 3, ...: the round number nearest to 10^(half_decades/2)."""
    whole, odd = divmod(half_decades, 2)
    return float(f"{STEPS[odd]:g}e{whole}")
