"""Which light to sample in each part of space: probabilities of all lights in the cells of a grid (docs/transport.md, "The
choice of a light").

A grid of such probabilities is the light sample strategy `spatial` of pbrt-v3's source code, and the idea that of Donikian
et al. (2006). Here a cell has probabilities of its own for each of six sides, where rays from the lights have met
surfaces. Any probabilities above 0 give the same mean.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from engines.scene.light_bounds import LightBounds, light_bounds
from engines.scene.light_hierarchy import lit_through
from engines.scene.scene import Scene

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
WALKS, BOUNCES = 2048, 4
MOST_CELLS = 32
"""Along the longest edge of the grid."""
MOST_BINS = 1 << 18
"""Cells are larger where there would be more bins than this: what lies in no near cache costs more than it saves."""
AROUND = 0.25
"""How far the grid reaches beyond the lights, as a share of the longest edge of their box."""
SIDES = 6
"""Parts of a cell, by the axis along which a surface's normal is longest, and its sign: 2 axis + (1 where positive)."""
DEFENSIVE = 0.05
"""Share of the probability that goes by power alone."""
STEPS = 1 << 24
"""All probabilities are multiples of 1 / STEPS, so that random numbers of 24 bits obey them exactly."""


class Hits(Protocol):
    """Closest hits of n rays: `engines.interface.Hits`."""

    @property
    def t(self) -> Array: ...

    @property
    def normal(self) -> Array: ...


Closest = Callable[[Array, Array], Hits]
"""`Renderer.trace`: hits by origins and directions (n, 3)."""


class LightCells(NamedTuple):
    """A point lies in the cell of its coordinates, (p - low) / size rounded down and held in the grid; the cell's part for the
    normal there has the row of `bins` by which lights are chosen.

    A row is an alias table (Walker 1974) of K bins, a power of two, which are equally likely; bin j belongs to light j.
    """

    low: Array
    """(3,) metres, as `size`."""
    size: float
    row: NDArray[np.int32]
    """(nx, ny, nz, 6)"""
    bins: NDArray[np.int32]
    """(rows, K, 4): the bin's own light has the first so many of its STEPS / K steps, the light of this index has the others;
    and the steps that its own light and the other one have in all bins. In the first row lights go by power."""


class _Lights(NamedTuple):
    """n lights with a box and power: number in the scene, center and radius of the box's sphere; and of `LightBounds`."""

    light: Indices
    center: Array
    radius: Array
    axis: Array
    spread: Array
    reach: Array
    power: Array


class _Grid(NamedTuple):
    low: Array
    size: float
    shape: Indices

    def parts(self, point: Array, normal: Array) -> Indices:
        """(n,) the parts of cells in which points (n, 3) with these normals lie, as indices of `LightCells.row`, flat."""
        x, y, z = np.clip(np.floor((point - self.low) / self.size), 0, self.shape - 1).astype(np.int64).T
        axis = np.abs(normal).argmax(axis=1)
        side = 2 * axis + (normal[np.arange(len(normal)), axis] > 0.0)
        return ((x * self.shape[1] + y) * self.shape[2] + z) * SIDES + side


def unlearned_cells(scene: Scene) -> LightCells:
    """One cell, in which lights go by power."""
    bounds = light_bounds(scene)
    bins = alias_tables(_steps(bounds, np.zeros((1, len(bounds)))))
    return LightCells(np.zeros(3), 1.0, np.zeros((1, 1, 1, SIDES), np.int32), bins)


def light_cells(scene: Scene, closest: Closest) -> LightCells:
    """The cells of a scene with two or more lights, around the places that `closest` finds on walks from the lights."""
    bounds = light_bounds(scene)
    lights, through = _bounded(bounds), lit_through(scene)
    point, normal = _walk(lights, closest, through) if lights.light.size else np.zeros((2, 0, 3))
    if not len(point):
        return unlearned_cells(scene)
    grid = _grid(lights, point, normal, _bins(len(bounds)))
    learned, group = np.unique(grid.parts(point, normal), return_inverse=True)
    count = np.bincount(group)[:, None]
    middle, mean = (np.stack([np.bincount(group, x) for x in numbers.T], axis=1) / count for numbers in (point, normal))
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    sent = np.zeros((1 + learned.size, len(bounds)))
    sent[1:, lights.light] = _unshadowed(lights, middle, mean, grid.size, through)
    row = np.zeros(np.prod(grid.shape) * SIDES, np.int32)
    row[learned] = 1 + np.arange(learned.size)
    return LightCells(grid.low, grid.size, _spread(row.reshape(*grid.shape, SIDES)), alias_tables(_steps(bounds, sent)))


def _bounded(bounds: list[LightBounds]) -> _Lights:
    known = [j for j, light in enumerate(bounds) if light.box is not None and light.power > 0.0]
    box = np.array([bounds[j].box for j in known]).reshape(-1, 2, 3)
    radius = np.linalg.norm(box[:, 1] - box[:, 0], axis=1) / 2.0
    columns = (np.array([getattr(bounds[j], name) for j in known]) for name in ("axis", "spread", "reach", "power"))
    return _Lights(np.array(known, np.int64), box.mean(axis=1), radius, *columns)


def _walk(lights: _Lights, closest: Closest, through: bool) -> tuple[Array, Array]:
    """Points (n, 3) where light arrives and the normals there, towards where it came from: of walks that start at the lights
    and go on in random directions."""
    random = np.random.Generator(np.random.PCG64(0))
    start = np.arange(WALKS) * lights.light.size // WALKS
    direction = _sphere(WALKS, random)
    cosine = np.einsum("nk,nk->n", direction, lights.axis[start])
    direction[cosine < np.cos(np.minimum(lights.spread + lights.reach, np.pi))[start]] *= -1.0
    origin = lights.center[start] + direction * (1.001 * lights.radius[start])[:, None]
    points, normals = [], []
    for _ in range(BOUNCES):
        hits = closest(origin, direction)
        hit = np.flatnonzero(np.isfinite(hits.t))
        point, normal = origin[hit] + hits.t[hit, None] * direction[hit], hits.normal[hit]
        points.append(point)
        normals.append(normal)
        if through:  # half of them go on behind the surface
            normal = normal * np.where(random.random(hit.size) < 0.5, -1.0, 1.0)[:, None]
        direction = normal + 0.999 * _sphere(hit.size, random)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        origin = point + 1e-4 * np.maximum(np.abs(point).max(axis=1, keepdims=True), 1e-2) * normal
    return np.concatenate(points), np.concatenate(normals)


def _sphere(n: int, random: np.random.Generator) -> Array:
    """(n, 3) random unit vectors."""
    z, phi = 2.0 * random.random(n) - 1.0, 2.0 * np.pi * random.random(n)
    r = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def _grid(lights: _Lights, point: Array, normal: Array, bins: int) -> _Grid:
    """The cells around the lights, as far as there are points. Corners lie off round numbers, where surfaces are."""
    near = lights.center.min(axis=0), lights.center.max(axis=0)
    margin = AROUND * max(float((near[1] - near[0]).max()), 2.0 * float(lights.radius.max()), 1e-6)
    low, high = np.clip((point.min(axis=0), point.max(axis=0)), near[0] - margin, near[1] + margin)
    size = max(float((high - low).max()), 1e-6) / MOST_CELLS
    while True:
        grid = _Grid(low - 0.37 * size, size, np.floor((high - low) / size + 0.37).astype(np.int64) + 1)
        met = np.zeros(np.prod(grid.shape) * SIDES, np.bool_)
        met[grid.parts(point, normal)] = True
        if np.count_nonzero(met) * bins <= MOST_BINS or grid.shape.max() == 1:
            return grid
        size *= 1.19


def _unshadowed(lights: _Lights, point: Array, normal: Array, size: float, through: bool) -> Array:
    """(m, n) the importance of the light hierarchy, of each light, but that no light is nearer than half a cell."""
    way = lights.center - point[:, None]
    square = np.maximum(np.einsum("mnk,mnk->mn", way, way), np.maximum(lights.radius, size / 2.0) ** 2)
    inverse = 1.0 / np.sqrt(square)
    sine = lights.radius * inverse
    cosine = np.einsum("mnk,mk->mn", way, normal) * inverse
    importance = lights.power / square * _nearer(np.abs(cosine) if through else cosine, sine)
    narrow = np.flatnonzero(lights.spread < np.pi)
    if narrow.size:
        cosine = -np.einsum("mnk,nk->mn", way[:, narrow], lights.axis[narrow]) * inverse[:, narrow]
        angle = np.arccos(np.clip(cosine, -1.0, 1.0)) - lights.spread[narrow] - np.arcsin(sine[:, narrow])
        importance[:, narrow] *= np.where(angle < lights.reach[narrow], np.cos(np.maximum(angle, 0.0)), 0.0)
    return importance


def _nearer(cosine: Array, sine_half: Array) -> Array:
    """The cosine of an angle less the half angle; 1 where none is left, 0 beyond a right angle."""
    cosine_half = np.sqrt(np.maximum(0.0, 1.0 - sine_half * sine_half))
    turned = cosine * cosine_half + np.sqrt(np.maximum(0.0, 1.0 - cosine * cosine)) * sine_half
    return np.where(cosine >= cosine_half, 1.0, np.maximum(turned, 0.0))


def _spread(row: NDArray[np.int32]) -> NDArray[np.int32]:
    """Parts without a row take that of a neighbour on the same side, or of its neighbour, and so on."""
    row = row.copy()
    while True:
        before = row.copy()
        for axis in range(3):
            at = np.moveaxis(row, axis, 0)
            for to, source in ((at[1:], at[:-1].copy()), (at[:-1], at[1:].copy())):
                np.copyto(to, source, where=to == 0)
        if np.array_equal(row, before):
            return row


def _steps(bounds: list[LightBounds], sent: Array) -> Indices:
    """(rows, J) probabilities in `STEPS`: a share goes by power, the rest by what the lights send (rows, J). Lights without a
    box have one part each, all others together as much."""
    power = np.array([0.0 if light.box is None else light.power for light in bounds])
    everywhere = np.array([light.box is None for light in bounds])
    power, total = power / max(power.sum(), 1e-300), sent.sum(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = DEFENSIVE * power + (1.0 - DEFENSIVE) * np.where(total > 0.0, sent / total, power)
    share = np.where(everywhere, 1.0, share) / max(int(everywhere.sum()) + int(power.any()), 1)
    # one step for each light that can be chosen, the others by share, and what rounding leaves to the largest with a box
    steps = (share > 0.0) + np.floor(share * (STEPS - len(bounds))).astype(np.int64)
    largest = np.where(everywhere & ~everywhere.all(), 0.0, share).argmax(axis=1)
    steps[np.arange(len(steps)), largest] += STEPS - steps.sum(axis=1)
    return steps


def _bins(lights: int) -> int:
    return 1 << max(lights - 1, 1).bit_length()


def alias_tables(steps: Indices) -> NDArray[np.int32]:
    """`LightCells.bins` of probabilities (rows, J) in `STEPS`.

    Bins that are not full take what they lack from those that hold too much, in order (Hübschle-Schneider and Sanders 2019):
    lacks and surpluses lie along one line, and a bin is filled where its lack begins. A bin that had too much and then lacks
    some takes it from the next of its kind.
    """
    rows, lights = steps.shape
    count = _bins(lights)
    full = STEPS // count
    weight = np.pad(steps, ((0, 0), (0, count - lights)))
    line = np.arange(rows)[:, None] * 2 * STEPS  # rows apart
    own, other = np.minimum(weight, full), np.tile(np.arange(count), (rows, 1))
    poor, rich = weight < full, weight > full
    lack_ends = np.cumsum(np.maximum(full - weight, 0), axis=1) + line
    surplus_ends = (np.cumsum(np.maximum(weight - full, 0), axis=1) + line)[rich]
    giver = np.searchsorted(surplus_ends, (lack_ends - np.maximum(full - weight, 0))[poor], "right")
    index = np.nonzero(rich)[1]
    other[poor] = index[giver]
    lack_ends = lack_ends[poor]
    beyond = lack_ends[np.searchsorted(lack_ends, surplus_ends, "left")] - surplus_ends
    own[rich] = full - beyond
    other[rich] = np.where(beyond > 0, np.append(index[1:], 0), index)
    return np.stack([own, other, weight, np.take_along_axis(weight, other, axis=1)], axis=2).astype(np.int32)
