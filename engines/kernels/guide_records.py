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

RECORD_NUMBERS = 6
"""Of a record: the path's throughput before the vertex, and its radiance behind it."""


class Records(NamedTuple):
    """Directions of a thread's pass, and the sums of what all directions have found; empty where paths are not guided."""

    cells: NDArray[np.int32]
    """Of `MOST_RECORDS` vertices of each path: where in the tree the direction lies, -1 for none."""
    numbers: NDArray[Any]
    totals: NDArray[np.int64]


def records_of(paths: int, totals: NDArray[np.int64], real: Any) -> Records:
    """No records, with room for those of `paths` paths, and the sums `totals` (n, 4, 3) that they go to."""
    places = paths * MOST_RECORDS
    return Records(np.full(places, -1, np.int32), np.empty(places * RECORD_NUMBERS, real), totals.reshape(-1))


@inline
def keep_records(rays, lanes, records):
    """Records the directions of the vertices that the lanes of the word have just left, each at its path's place."""
    cells, numbers = records.cells, records.numbers
    while lanes != 0:
        lane = np.uint64(lowest_bit(lanes))
        lanes &= lanes - 1
        place = np.int64(rays.slot[lane]) * MOST_RECORDS + np.int64(rays.recorded.vertex[lane])
        throughput, radiance, row = rays.recorded.throughput[lane], rays.radiance[lane], place * RECORD_NUMBERS
        cells[place] = rays.recorded.cell[lane]
        numbers[row], numbers[row + 1], numbers[row + 2] = throughput.x, throughput.y, throughput.z
        numbers[row + 3], numbers[row + 4], numbers[row + 5] = radiance.x, radiance.y, radiance.z


@inline
def _sent_on(radiance, before, throughput):
    return (radiance - before) / throughput if throughput > 0.0 else 0.0


@inline
def learn(paths, records, radiance):
    """Adds up what the vertices of a pass's paths, whose radiance is given, have sent on from the directions recorded; and
    forgets these."""
    cells, numbers, address = records.cells, records.numbers, records.totals.ctypes.data
    for place in range(paths * MOST_RECORDS):
        cell = np.int64(cells[place])
        if cell < 0:
            continue
        cells[place] = -1
        row, path, found = place * RECORD_NUMBERS, 3 * (place // MOST_RECORDS), 0.0
        for k in range(3):
            throughput, before = np.float64(numbers[row + k]), np.float64(numbers[row + 3 + k])
            found += _sent_on(np.float64(radiance[path + k]), before, throughput)
        found /= 3.0
        sums = address + 24 * cell
        fetch_add(sums + 8 * COUNT, 1)
        if found > 0.0 and found < math.inf:
            units = np.int64(min(found, MOST) / UNIT + 0.5)
            fetch_add(sums + 8 * LOW, units & ((1 << HALF_WORD) - 1))
            if units >> HALF_WORD != 0:
                fetch_add(sums + 8 * HIGH, units >> HALF_WORD)
