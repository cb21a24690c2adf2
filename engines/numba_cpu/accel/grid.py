"""A uniform grid over triangles and spheres, walked cell by cell (Amanatides and Woo 1987).

A primitive is listed in every cell that its padded box touches. The walk ends when the nearest hit lies before the end of
the cell: a hit farther away may belong to another cell and is kept, but not yet believed.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels import block as at
from engines.kernels.jit import (
    LANES,
    compile_stage,
    const,
    count,
    fetch,
    get,
    get_int,
    inline,
    kernel,
    pointer,
    put,
    put_int,
    table,
)
from engines.kernels.linear import closest_planes, occluded_planes
from engines.kernels.world import ACCELERATOR, N_TRIANGLES, SPHERE_RANK, SPHERES, TRIANGLE_RANK, Needs, World
from engines.numba_cpu.accel.primitives import ball_distance, boxes, corner_distance, corners, padding, ray_of

BOX, CELLS, MEMBERS, CORNERS, RANKS, SIZE_X, SIZE_Y, SIZE_Z = (ACCELERATOR + k for k in range(8))
DENSITY = 4.0
"""Cells a primitive."""
MOST_CELLS = 32
"""Cells that a primitive may touch on average; where large ones overlap, the grid is made coarser until they do not."""
LARGEST = 512
"""Cells on an axis at the most."""


class Accelerator:
    """The grid's box, where each cell's list starts, and the lists."""

    name = "grid"
    precision = None
    scratch = 0

    def __init__(self, options: Any) -> None:
        self._density = float(options["density"])
        self.build_seconds = 0.0
        self._bytes = 0

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        box = boxes(world)
        bounds = np.zeros(7, world.real)
        if len(box):
            bounds[:3], bounds[3:6] = box[:, :3].min(axis=0), box[:, 3:].max(axis=0)
            bounds[6] = padding(world)
        size = _resolution(bounds[:6].astype(np.float64), len(box), self._density)
        while size.max() > 1 and _memberships(box, bounds, size) > MOST_CELLS * len(box):
            size = np.maximum(size // 2, 1)
        starts = np.zeros(int(size.prod()) + 1, np.int64)
        _count_members(box, bounds, size, starts)
        np.cumsum(starts, out=starts)
        members = np.empty(int(starts[-1]), np.int32)
        _list_members(box, bounds, size, starts, members)
        ranks = np.concatenate([world.arrays[TRIANGLE_RANK], world.arrays[SPHERE_RANK]])
        arrays = {BOX: bounds, CELLS: starts, MEMBERS: members, CORNERS: corners(world), RANKS: ranks}
        for slot, array in arrays.items():
            world.bind(slot, array)
        for slot, cells in zip((SIZE_X, SIZE_Y, SIZE_Z), size, strict=True):
            world.bind(slot, int(cells))
        self._bytes = sum(array.nbytes for array in arrays.values())
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return self._bytes

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        return stages(needs.triangles, needs.spheres, needs.planes, real)


def _resolution(bounds: Any, n: int, density: float) -> Any:
    """Cells on each axis: near cubes, `density` cells a primitive in all; flat axes get one."""
    width = np.maximum(bounds[3:] - bounds[:3], 0.0)
    if not n or not width.max() > 0.0:
        return np.ones(3, np.int64)
    width = width / width.max()  # products of denormal widths would be 0
    thick = width > 1e-6
    edge = (width[thick].prod() / (density * n)) ** (1 / thick.sum())
    cells = np.where(thick, np.ceil(width / edge), 1.0)
    return np.clip(cells, 1, LARGEST).astype(np.int64)


@inline
def _cell(x, low, high, cells):
    """The cell of a coordinate, clamped into the grid."""
    width = high - low
    if not width > const(0.0, width):
        return np.int64(0)
    k = np.int64((x - low) / width * cells)
    return max(min(k, cells - 1), np.int64(0))


@kernel
def _memberships(box, bounds, size):
    """Cells that all primitives touch together."""
    total = 0.0
    for i in range(len(box)):
        cells = 1.0
        for a in range(3):
            low, high = bounds[a], bounds[a + 3]
            cells *= _cell(box[i, a + 3], low, high, size[a]) - _cell(box[i, a], low, high, size[a]) + 1
        total += cells
    return total


@kernel
def _count_members(box, bounds, size, counts):
    """counts[cell + 1] = primitives in the cell."""
    for i in range(len(box)):
        x0, x1 = _cell(box[i, 0], bounds[0], bounds[3], size[0]), _cell(box[i, 3], bounds[0], bounds[3], size[0])
        y0, y1 = _cell(box[i, 1], bounds[1], bounds[4], size[1]), _cell(box[i, 4], bounds[1], bounds[4], size[1])
        z0, z1 = _cell(box[i, 2], bounds[2], bounds[5], size[2]), _cell(box[i, 5], bounds[2], bounds[5], size[2])
        for z in range(z0, z1 + 1):
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    counts[(z * size[1] + y) * size[0] + x + 1] += 1


@kernel
def _list_members(box, bounds, size, starts, members):
    """Fills the lists, lowest primitive first."""
    fill = starts.copy()
    for i in range(len(box)):
        x0, x1 = _cell(box[i, 0], bounds[0], bounds[3], size[0]), _cell(box[i, 3], bounds[0], bounds[3], size[0])
        y0, y1 = _cell(box[i, 1], bounds[1], bounds[4], size[1]), _cell(box[i, 4], bounds[1], bounds[4], size[1])
        z0, z1 = _cell(box[i, 2], bounds[2], bounds[5], size[2]), _cell(box[i, 5], bounds[2], bounds[5], size[2])
        for z in range(z0, z1 + 1):
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    cell = (z * size[1] + y) * size[0] + x
                    members[fill[cell]] = i
                    fill[cell] += 1


class Grid(NamedTuple):
    """Pointers to the accelerator's arrays."""

    box: Any
    cells: Any
    members: Any
    corners: Any
    ranks: Any
    spheres: Any
    triangles: int
    nx: int
    ny: int
    nz: int


@inline
def _wall(low, high, cells, cell, forward, o, inverse):
    """Distance at which the ray leaves a cell on one axis, computed from the wall itself so that errors do not add up."""
    k = cell + 1 if forward else cell
    return (low + (high - low) * (k / const(1.0, low)) / (cells / const(1.0, low)) - o) * inverse


@inline
def _walk(ray, t, left, grid, triangles, spheres, any_hit, widen, real):
    """(distance, rank) of the closest hit nearer than t, or with `any_hit` of any such; rank -1 for none."""
    rank = np.int64(-1)
    lx, ly, lz = fetch(grid.box, 0), fetch(grid.box, 1), fetch(grid.box, 2)
    hx, hy, hz = fetch(grid.box, 3), fetch(grid.box, 4), fetch(grid.box, 5)
    px, py, pz = ray.inverse.x > real(0), ray.inverse.y > real(0), ray.inverse.z > real(0)
    enter = max(real(0), ((lx if px else hx) - ray.o.x) * ray.inverse.x)
    enter = max(enter, ((ly if py else hy) - ray.o.y) * ray.inverse.y)
    enter = max(enter, ((lz if pz else hz) - ray.o.z) * ray.inverse.z)
    leave = min(t, ((hx if px else lx) - ray.o.x) * ray.inverse.x)
    leave = min(leave, ((hy if py else ly) - ray.o.y) * ray.inverse.y)
    leave = min(leave, ((hz if pz else lz) - ray.o.z) * ray.inverse.z)
    if not enter <= leave * widen + ray.slack:
        return t, rank
    x = _cell(ray.o.x + ray.d.x * enter, lx, hx, grid.nx)
    y = _cell(ray.o.y + ray.d.y * enter, ly, hy, grid.ny)
    z = _cell(ray.o.z + ray.d.z * enter, lz, hz, grid.nz)
    for _ in range(grid.nx + grid.ny + grid.nz + 3):
        cell = (z * grid.ny + y) * grid.nx + x
        for k in range(fetch(grid.cells, cell), fetch(grid.cells, cell + 1)):
            i = np.int64(fetch(grid.members, k))
            this = np.int64(fetch(grid.ranks, i))
            distance, valid = t, False
            if triangles and (not spheres or i < grid.triangles):
                distance = corner_distance(ray, grid.corners, i)
                valid = distance > real(0) and this != left
            if spheres and (not triangles or i >= grid.triangles):
                distance = ball_distance(ray, grid.spheres, i - grid.triangles, real)
                valid = True
            if valid and (distance < t or (distance == t and this < rank)):
                t, rank = distance, this
                if any_hit:
                    return t, rank
        tx = _wall(lx, hx, grid.nx, x, px, ray.o.x, ray.inverse.x)
        ty = _wall(ly, hy, grid.ny, y, py, ray.o.y, ray.inverse.y)
        tz = _wall(lz, hz, grid.nz, z, pz, ray.o.z, ray.inverse.z)
        exit_ = min(tx, ty, tz)
        if t * widen + ray.slack + fetch(grid.box, 6) < exit_:
            return t, rank
        if tx <= ty and tx <= tz:
            x += 1 if px else -1
            if x < 0 or x >= grid.nx:
                return t, rank
        elif ty <= tz:
            y += 1 if py else -1
            if y < 0 or y >= grid.ny:
                return t, rank
        else:
            z += 1 if pz else -1
            if z < 0 or z >= grid.nz:
                return t, rank
    return t, rank


def _make(triangles: bool, spheres: bool, planes: bool, shadow: bool, real: Any) -> Any:
    eps = float(np.finfo(real).eps)
    widen = real(1 + 16 * eps)
    origin, direction, reach = (
        (at.SHADOW_ORIGIN, at.TO_LIGHT, at.SHADOW_T) if shadow else (at.ORIGIN, at.DIRECTION, at.T)
    )

    def stage(block, world):
        lanes = pointer(block, real)
        grid = Grid(
            table(world, BOX, real), table(world, CELLS, np.int64), table(world, MEMBERS, np.int32),
            table(world, CORNERS, real), table(world, RANKS, np.int32), table(world, SPHERES, np.float64),
            count(world, N_TRIANGLES), count(world, SIZE_X), count(world, SIZE_Y), count(world, SIZE_Z),
        )  # fmt: skip
        for lane in range(np.uint64(LANES)):
            t = get(lanes, reach, lane)
            rank = np.int64(-1)
            if (triangles or spheres) and t > real(0):
                ray = ray_of(lanes, lane, origin, direction, eps, real)
                left = np.int64(get_int(lanes, at.LEFT, lane))
                t, rank = _walk(ray, t, left, grid, triangles, spheres, shadow, widen, real)
            if shadow:
                put_int(lanes, at.OCCLUDED, lane, 1 if rank >= 0 else 0)
            else:
                put(lanes, at.T, lane, t)
                put_int(lanes, at.RANK, lane, rank)
        if planes:
            if shadow:
                occluded_planes(lanes, world, real)
            else:
                closest_planes(lanes, world, real)

    return stage


@cache
def stages(triangles: bool, spheres: bool, planes: bool, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))
