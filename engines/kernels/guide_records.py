"""What an SD-tree learns from: directions in which paths were scattered, kept until a pass ends, then added up.

Sums are of whole numbers, so neither threads nor the order of tiles can change them (`engines.sd_tree`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import fetch_add, lowest_bit
from engines.sd_tree import COUNT, HALF_WORD, HIGH, LOW, MOST, MOST_RECORDS, UNIT

RECORD_NUMBERS = 7
"""Of a record: the direction's density, the throughput and the radiance of the path behind the vertex."""


class Records(NamedTuple):
    """Directions of a thread's pass, and the sums of what all directions have found; empty where paths are not guided."""

    cells: NDArray[np.int32]
    numbers: NDArray[Any]
    totals: NDArray[np.int64]


def records_of(paths: int, totals: NDArray[np.int64], real: Any) -> Records:
    """No records, with room for those of `paths` paths, and the sums `totals` (n, 4, 3) that they go to."""
    places = paths * MOST_RECORDS
    return Records(np.zeros(places, np.int32), np.zeros(places * RECORD_NUMBERS, real), totals.reshape(-1))


@inline
def keep_records(rays, lanes, records):
    """Records the directions of the vertices that the lanes of the word have just left, each at its path's place."""
    cells, numbers = records.cells, records.numbers
    while lanes != 0:
        lane = np.uint64(lowest_bit(lanes))
        lanes &= lanes - 1
        place = np.int64(rays.slot[lane]) * MOST_RECORDS + np.int64(rays.record_vertex[lane])
        throughput, radiance = rays.record_throughput[lane], rays.radiance[lane]
        cells[place] = rays.record_cell[lane]
        row = place * RECORD_NUMBERS
        numbers[row] = rays.sample_pdf[lane]
        numbers[row + 1], numbers[row + 2], numbers[row + 3] = throughput.x, throughput.y, throughput.z
        numbers[row + 4], numbers[row + 5], numbers[row + 6] = radiance.x, radiance.y, radiance.z


@inline
def _incident(radiance, before, throughput):
    return (radiance - before) / throughput if throughput > 0.0 else 0.0


@inline
def learn(paths, records, radiance):
    """Adds up what the paths of a pass, whose radiance is given, have found along the directions recorded; and forgets
    these."""
    cells, numbers, address = records.cells, records.numbers, records.totals.ctypes.data
    for place in range(paths * MOST_RECORDS):
        row = place * RECORD_NUMBERS
        pdf = np.float64(numbers[row])
        if pdf > 0.0:
            numbers[row] = 0.0
            found, path = 0.0, 3 * (place // MOST_RECORDS)
            for k in range(3):
                before, throughput = np.float64(numbers[row + 4 + k]), np.float64(numbers[row + 1 + k])
                found += _incident(np.float64(radiance[path + k]), before, throughput)
            found /= 3.0
            cell = address + 24 * np.int64(cells[place])
            fetch_add(cell + 8 * COUNT, 1)
            if found > 0.0 and found < math.inf:
                units = np.int64(min(found, MOST) / UNIT + 0.5)
                fetch_add(cell + 8 * LOW, units & ((1 << HALF_WORD) - 1))
                if units >> HALF_WORD != 0:
                    fetch_add(cell + 8 * HIGH, units >> HALF_WORD)
