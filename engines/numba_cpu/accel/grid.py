"""A uniform grid over triangles, spheres and analytic shapes, walked cell by cell (Amanatides and Woo 1987).

A primitive is listed in every cell that its padded box touches. The walk ends when the nearest hit lies before the end of
the cell: a hit farther away may belong to another cell and is kept, but not yet believed.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline, kernel
from engines.kernels.compile.records import REAL, Table, array, rows, scalar, table_view
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import FlatScene
from engines.kernels.lane.vector import to_float64
from engines.kernels.layout import ACCELERATOR, LANES, ray_batch, scene_table
from engines.kernels.stages.linear import analytic_distance, closest_planes, occluded_planes
from engines.numba_cpu.accel.primitives import (
    CornersRow,
    boxes,
    corners,
    distance_to_sphere,
    distance_to_triangle,
    make_ray,
    padding,
    primitive_ids,
)


class GridTable(Table, first=ACCELERATOR):
    box = array(REAL)  # lower and upper corner, and by how much boxes are padded
    cells = array(np.int64)  # where each cell's list starts, and the last one ends
    members = array(np.int32)  # numbers of primitives
    corners = rows(CornersRow)
    primitives = array(np.int32)  # ids
    size_x = scalar()
    size_y = scalar()
    size_z = scalar()


grid_table = table_view(GridTable)

DENSITY = 4.0
"""Cells a primitive."""
MOST_CELLS = 32
"""Cells that a primitive may touch on average; where large ones overlap, the grid is made coarser until they do not."""
LARGEST = 512
"""Largest number of cells on an axis."""


class Accelerator:
    """The grid's box, where each cell's list starts, and the lists."""

    name = "grid"
    precision = None
    scratch = 0

    def __init__(self, options: Any) -> None:
        self._density = float(options["density"])
        self.build_seconds = 0.0
        self.bytes = 0

    def build(self, flat: FlatScene, threads: int) -> None:
        start = time.perf_counter()
        box = boxes(flat)
        bounds = np.zeros(7, flat.real)
        if len(box):
            bounds[:3], bounds[3:6] = box[:, :3].min(axis=0), box[:, 3:].max(axis=0)
            bounds[6] = padding(flat)
        size = _resolution(bounds[:6].astype(np.float64), len(box), self._density)
        while size.max() > 1 and _memberships(box, bounds, size) > MOST_CELLS * len(box):
            size = np.maximum(size // 2, 1)
        starts = np.zeros(int(size.prod()) + 1, np.int64)
        _count_members(box, bounds, size, starts)
        np.cumsum(starts, out=starts)
        members = np.empty(int(starts[-1]), np.int32)
        _list_members(box, bounds, size, starts, members)
        table = GridTable
        arrays = {
            table.box: bounds,
            table.cells: starts,
            table.members: members,
            table.corners: corners(flat),
            table.primitives: primitive_ids(flat),
        }
        for field, values in arrays.items():
            flat.bind(field, values)
        for field, cells in zip((table.size_x, table.size_y, table.size_z), size, strict=True):
            flat.bind(field, int(cells))
        self.bytes = sum(values.nbytes for values in arrays.values())
        self.build_seconds = time.perf_counter() - start

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]:
        return stages(features.triangles, features.spheres, features.planes, features.analytic, real)


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
    if not width > 0.0:
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
    """The accelerator's arrays; the numbers of the first sphere and of the first analytic shape; the cells on each axis."""

    box: Any
    cells: Any
    members: Any
    corners: Any
    primitives: Any
    spheres: Any
    first_sphere: int
    first_analytic: int
    nx: int
    ny: int
    nz: int


@inline
def _wall(low, high, cells, cell, forward, o, inverse):
    """Distance at which the ray leaves a cell on one axis, computed from the wall itself so that errors do not add up."""
    k = cell + 1 if forward else cell
    return (low + (high - low) * (k / 1.0) / (cells / 1.0) - o) * inverse


@inline
def _test(ray, t, left, scene, grid, i, this, triangles, spheres, analytic, distance_to_analytic, real):
    """(distance, whether it counts) of primitive number i, whose id is `this`, for a ray that leaves the primitive `left`."""
    distance, valid = t, False
    if triangles and (not (spheres or analytic) or i < grid.first_sphere):
        distance = distance_to_triangle(ray, grid.corners, i)
        valid = distance > real(0) and this != left
    if spheres and (not triangles or i >= grid.first_sphere) and (not analytic or i < grid.first_analytic):
        distance = distance_to_sphere(ray, grid.spheres, i - grid.first_sphere, real)
        valid = True
    if analytic and (not (triangles or spheres) or i >= grid.first_analytic):
        k = i - grid.first_analytic
        distance = real(distance_to_analytic(scene, k, to_float64(ray.o), to_float64(ray.d)))
        valid = distance < real(np.inf) and this != left
    return distance, valid


@inline
def _walk(ray, t, left, scene, grid, triangles, spheres, analytic, distance_to_analytic, any_hit, widen, real):
    """(distance, id) of the closest hit nearer than t, or with `any_hit` of any such; id -1 for none."""
    primitive = np.int64(-1)
    lx, ly, lz = grid.box[0], grid.box[1], grid.box[2]
    hx, hy, hz = grid.box[3], grid.box[4], grid.box[5]
    px, py, pz = ray.inverse.x > real(0), ray.inverse.y > real(0), ray.inverse.z > real(0)
    enter = max(real(0), ((lx if px else hx) - ray.o.x) * ray.inverse.x)
    enter = max(enter, ((ly if py else hy) - ray.o.y) * ray.inverse.y)
    enter = max(enter, ((lz if pz else hz) - ray.o.z) * ray.inverse.z)
    leave = min(t, ((hx if px else lx) - ray.o.x) * ray.inverse.x)
    leave = min(leave, ((hy if py else ly) - ray.o.y) * ray.inverse.y)
    leave = min(leave, ((hz if pz else lz) - ray.o.z) * ray.inverse.z)
    if not enter <= leave * widen + ray.error_bound:
        return t, primitive
    x = _cell(ray.o.x + ray.d.x * enter, lx, hx, grid.nx)
    y = _cell(ray.o.y + ray.d.y * enter, ly, hy, grid.ny)
    z = _cell(ray.o.z + ray.d.z * enter, lz, hz, grid.nz)
    for _ in range(grid.nx + grid.ny + grid.nz + 3):
        cell = (z * grid.ny + y) * grid.nx + x
        for k in range(grid.cells[cell], grid.cells[cell + 1]):
            i = np.int64(grid.members[k])
            this = np.int64(grid.primitives[i])
            distance, valid = _test(
                ray, t, left, scene, grid, i, this, triangles, spheres, analytic, distance_to_analytic, real
            )
            if valid and (distance < t or (distance == t and this < primitive)):
                t, primitive = distance, this
                if any_hit:
                    return t, primitive
        tx = _wall(lx, hx, grid.nx, x, px, ray.o.x, ray.inverse.x)
        ty = _wall(ly, hy, grid.ny, y, py, ray.o.y, ray.inverse.y)
        tz = _wall(lz, hz, grid.nz, z, pz, ray.o.z, ray.inverse.z)
        exit_ = min(tx, ty, tz)
        if t * widen + ray.error_bound + grid.box[6] < exit_:
            return t, primitive
        if tx <= ty and tx <= tz:
            x += 1 if px else -1
            if x < 0 or x >= grid.nx:
                return t, primitive
        elif ty <= tz:
            y += 1 if py else -1
            if y < 0 or y >= grid.ny:
                return t, primitive
        else:
            z += 1 if pz else -1
            if z < 0 or z >= grid.nz:
                return t, primitive
    return t, primitive


@inline
def _no_distance(scene, i, o, d):
    """Where there are no analytic shapes."""
    return np.float64(np.inf)


def _make(triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], shadow: bool, real: Any) -> Any:
    eps = float(np.finfo(real).eps)
    widen = real(1 + 16 * eps)
    has_analytic, bounded = bool(analytic), bool(triangles or spheres or analytic)
    distance_to_analytic = analytic_distance(analytic) if analytic else _no_distance

    def stage(batch, scene_address):
        rays, scene, own = ray_batch(batch, real), scene_table(scene_address, real), grid_table(scene_address, real)
        if shadow:
            origin, direction, t_max = rays.shadow.origin, rays.shadow.direction, rays.shadow.t_max
        else:
            origin, direction, t_max = rays.origin, rays.direction, rays.t
        grid = Grid(
            own.box,
            own.cells,
            own.members,
            own.corners,
            own.primitives,
            scene.spheres,
            scene.n_triangles,
            scene.n_triangles + scene.n_spheres,
            own.size_x,
            own.size_y,
            own.size_z,
        )
        for lane in range(np.uint64(LANES)):
            t = t_max[lane]
            primitive = np.int64(-1)
            if bounded and t > real(0):
                ray = make_ray(origin[lane], direction[lane], eps, real)
                left = np.int64(rays.origin_primitive[lane])
                t, primitive = _walk(
                    ray, t, left, scene, grid, triangles, spheres, has_analytic, distance_to_analytic, shadow, widen, real
                )
            if shadow:
                rays.shadow.occluded[lane] = primitive >= 0
            else:
                rays.t[lane] = t
                rays.primitive[lane] = primitive
        if planes:
            if shadow:
                occluded_planes(rays, scene, real)
            else:
                closest_planes(rays, scene, real, False)

    return stage


@cache
def stages(triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes, analytic)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))
