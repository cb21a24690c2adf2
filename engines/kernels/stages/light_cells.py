"""The choice of a light by the cell of a grid that a point lies in (docs/transport.md)."""

from __future__ import annotations

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.flatten.light_samplers import SIDES, STEPS
from engines.kernels.layout import LANES, LIGHT

NUMBERS, OWN = 4, 2
"""Of a bin; the place of the steps of its own light."""


@inline
def _place(x, low, inverse, count):
    """The place along an axis, as a whole real number; 0 of NaN."""
    place, last = np.floor((x - low) * inverse), count - 1.0
    place = select(place > 0.0, place, 0.0)
    return select(place < last, place, last)


@inline
def _part(scene, p, normal):
    """The part of a cell for the point and the geometric normal there."""
    grid = scene.light_grid
    x = _place(p.x, grid[0], grid[3], grid[4])
    y = _place(p.y, grid[1], grid[3], grid[5])
    z = _place(p.z, grid[2], grid[3], grid[6])
    cell = np.int32((x * grid[5] + y) * grid[6] + z)
    ax, ay, az = abs(normal.x), abs(normal.y), abs(normal.z)
    first, second = (ax >= ay) & (ax >= az), ay >= az
    along = select(first, normal.x, select(second, normal.y, normal.z))
    axis = select(first, np.int32(0), select(second, np.int32(2), np.int32(4)))
    return np.int32(cell * np.int32(SIDES) + axis + select(along > 0.0, np.int32(1), np.int32(0)))


@inline
def choose(rays, scene):
    """Chooses each lane's light: its index, 1 / the probability, and what is left of the draw."""
    for lane in range(np.uint64(LANES)):
        rays.light_cell[lane] = _part(scene, rays.hit.point[lane], rays.hit.geometric_normal[lane])
    bins, count = scene.light_bins, scene.n_light_bins
    for lane in range(np.uint64(LANES)):
        scaled = np.float64(rays.draw[LIGHT, lane]) * count
        bin = max(min(np.int64(scaled), count - 1), 0)  # a draw that is NaN must not leave the table
        first = NUMBERS * (np.int64(scene.light_rows[rays.light_cell[lane]]) * count + bin)
        place, end = scaled - bin, bins[first] * (count / STEPS)
        own = place < end
        rays.chosen_light[lane] = select(own, bin, np.int64(bins[first + 1]))
        rays.light_inverse_pmf[lane] = STEPS / select(own, bins[first + 2], bins[first + 3])
        rays.draw[LIGHT, lane] = select(own, place, place - end) / select(own, end, 1.0 - end)


@inline
def inverse_pmf(scene, light, p, normal):
    """1 / the probability with which the light is chosen at the point p; inf where never."""
    row = np.int64(scene.light_rows[_part(scene, p, normal)])
    steps = scene.light_bins[NUMBERS * (row * scene.n_light_bins + np.int64(light)) + OWN]
    return STEPS / steps if steps > 0 else np.inf
