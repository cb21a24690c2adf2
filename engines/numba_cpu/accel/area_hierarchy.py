"""Boxes on the screen for rays from the eye, the plain list for all others: what N. Dahlquist's ray tracer of 2012 does,
with boxes that are right.

A box bounds a primitive's projection from the eye onto the plane at distance 1. A block of sixteen camera rays is tested
against the primitives whose boxes meet the block's own; a block that holds any other ray goes through the whole list. For
few primitives: the boxes are a list, too.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels import block as at
from engines.kernels.jit import (
    LANES,
    call_stage,
    compile_stage,
    count,
    fetch,
    get,
    get_int,
    inline,
    pointer,
    put,
    put_int,
    select,
    table,
)
from engines.kernels.linear import closest_planes, nearer
from engines.kernels.shapes import sphere_distance
from engines.kernels.surface import row3, wide
from engines.kernels.vector import dot
from engines.kernels.world import (
    ACCELERATOR,
    CAMERA,
    N_TRIANGLES,
    SPHERE_RANK,
    SPHERE_REALS,
    SPHERES,
    TRIANGLE_RANK,
    TRIANGLES,
    Needs,
    World,
)
from engines.numba_cpu.accel import none
from engines.numba_cpu.accel.primitives import corner_distance, corners, ray_of

# the first slots are the list's
PLAIN, BOXES, FRAME, CORNERS, N_BOXES = (ACCELERATOR + k for k in range(8, 13))
STEEPEST = 1e3
"""Tangent of the angle from the axis beyond which projections are not bounded: such rays and primitives use the list."""
PAD_ULPS = 256.0


class Accelerator:
    """The list of `none`, and a box for each triangle and sphere as the eye sees it."""

    name = "area_hierarchy"
    precision = None
    scratch = none.SCRATCH

    def __init__(self, options: Any) -> None:
        self.build_seconds = 0.0
        self._list = none.Accelerator(options)
        self._bytes = 0

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        self._world = world
        self._list.build(world, threads)
        world.bind(CORNERS, corners(world))
        self.look(world, has_eye=False)
        self.build_seconds = time.perf_counter() - start

    def look(self, world: World, has_eye: bool) -> None:
        """Computes the boxes anew for the world's camera. Without an eye (parallel rays, plugins) all rays use the list."""
        n = len(world.arrays[TRIANGLES]) + len(world.arrays[SPHERES]) if has_eye else 0
        frame = np.zeros((4, 3), world.real)
        boxes = np.zeros((n, 4), world.real)
        if has_eye:
            camera = world.arrays[CAMERA]
            axes = [camera[3 * k : 3 * k + 3] for k in (2, 3, 1)]
            frame[0] = camera[:3]
            frame[1:] = [axis / np.linalg.norm(axis) for axis in axes]
            boxes = _boxes(world, frame.astype(np.float64)).astype(world.real)
        world.bind(FRAME, frame)
        world.bind(BOXES, boxes)
        world.bind(N_BOXES, n if has_eye else -1)
        self._bytes = boxes.nbytes + world.arrays[CORNERS].nbytes

    @property
    def bytes(self) -> int:
        return self._list.bytes + self._bytes

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        plain, occluded = self._list.stages(needs, real)
        self._world.bind(PLAIN, plain.address)
        return stage(needs.triangles, needs.spheres, needs.planes, real), occluded


def _boxes(world: World, frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4) lowest and highest x, lowest and highest y on the plane at distance 1: of triangles, then of spheres. They are
    wider than the projections by what rounding may do to a ray, and infinite where a primitive is not well ahead of the eye."""
    points = (world.arrays[CORNERS].reshape(-1, 3).astype(np.float64) - frame[0]) @ frame[1:].T
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = points[:, :2] / points[:, 2:]
        seen[~(np.abs(points[:, :2]).max(axis=1, initial=0) < STEEPEST * points[:, 2])] = np.nan
    triangles = seen.reshape(-1, 3, 2)
    low, high = [triangles.min(axis=1)], [triangles.max(axis=1)]
    spheres = world.arrays[SPHERES]
    centers, radii = (spheres[:, :3] - frame[0]) @ frame[1:].T, spheres[:, 3]
    sides = [_tangents(centers[:, axis], centers[:, 2], radii) for axis in (0, 1)]
    low.append(np.stack([side[0] for side in sides], axis=1))
    high.append(np.stack([side[1] for side in sides], axis=1))
    lowest, highest = np.concatenate(low), np.concatenate(high)
    unbounded = ~np.isfinite(lowest + highest).all(axis=1)
    lowest[unbounded], highest[unbounded] = -np.inf, np.inf
    slack = PAD_ULPS * np.finfo(world.real).eps
    lowest = lowest - slack * (1 + np.abs(lowest)) ** 2
    highest = highest + slack * (1 + np.abs(highest)) ** 2
    return np.stack([lowest[:, 0], highest[:, 0], lowest[:, 1], highest[:, 1]], axis=1)


def _tangents(
    across: NDArray[np.float64], ahead: NDArray[np.float64], radius: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(lowest, highest) tangent of the angles at which circles are seen; NaN where they are not wholly ahead."""
    distance = np.hypot(across, ahead)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle, half = np.arctan2(across, ahead), np.arcsin(radius / distance)
        limit = np.arctan(STEEPEST)
        good = (middle - half > -limit) & (middle + half < limit)
        return np.where(good, np.tan(middle - half), np.nan), np.where(good, np.tan(middle + half), np.nan)


@inline
def _seen(lanes, lane, frame, real):
    """(whether it comes from the eye, whether there is one, x, y) of a lane's ray on the plane at distance 1."""
    origin, direction = at.get3(lanes, at.ORIGIN, lane), at.get3(lanes, at.DIRECTION, lane)
    eye, right, up, forward = row3(frame, 0), row3(frame, 3), row3(frame, 6), row3(frame, 9)
    ahead = dot(direction, forward)
    from_eye = (origin.x == eye.x) & (origin.y == eye.y) & (origin.z == eye.z) & (ahead > real(1 / STEEPEST))
    alive = get(lanes, at.T, lane) > real(0)
    inverse = real(1) / select(from_eye, ahead, real(1))
    return from_eye, alive, dot(direction, right) * inverse, dot(direction, up) * inverse


def _make(triangles: bool, spheres: bool, planes: bool, real: Any) -> Any:
    eps = float(np.finfo(real).eps)

    def closest(block, world):
        lanes, n = pointer(block, real), count(world, N_BOXES)
        frame = table(world, FRAME, real)
        strangers = np.int64(0)
        low_x, high_x, low_y, high_y = real(np.inf), real(-np.inf), real(np.inf), real(-np.inf)
        for lane in range(np.uint64(LANES)):
            from_eye, alive, x, y = _seen(lanes, lane, frame, real)
            put(lanes, at.FRAME, lane, x)
            put(lanes, at.FRAME + 1, lane, y)
            put(lanes, at.FRAME + 2, lane, select(alive, real(1), real(-1)))
            strangers += select(alive & (~from_eye), np.int64(1), np.int64(0))
        if n < 0 or strangers > 0:
            call_stage(count(world, PLAIN), block, world)
            return
        for lane in range(np.uint64(LANES)):
            put_int(lanes, at.RANK, lane, -1)
            if get(lanes, at.FRAME + 2, lane) > real(0):
                x, y = get(lanes, at.FRAME, lane), get(lanes, at.FRAME + 1, lane)
                low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        boxes = table(world, BOXES, real)
        for i in range(n):
            if not (fetch(boxes, 4 * i) <= high_x and fetch(boxes, 4 * i + 1) >= low_x):
                continue
            if not (fetch(boxes, 4 * i + 2) <= high_y and fetch(boxes, 4 * i + 3) >= low_y):
                continue
            if triangles and (not spheres or i < count(world, N_TRIANGLES)):
                rank, points = fetch(table(world, TRIANGLE_RANK, np.int32), i), table(world, CORNERS, real)
                for lane in range(np.uint64(LANES)):
                    t = corner_distance(ray_of(lanes, lane, at.ORIGIN, at.DIRECTION, eps, real), points, i)
                    nearer(lanes, lane, t, rank, (t > real(0)) & (rank != get_int(lanes, at.LEFT, lane)))
            if spheres and (not triangles or i >= count(world, N_TRIANGLES)):
                k = i - count(world, N_TRIANGLES)
                rows, rank = table(world, SPHERES, np.float64), fetch(table(world, SPHERE_RANK, np.int32), k)
                center, radius = row3(rows, k * SPHERE_REALS), fetch(rows, k * SPHERE_REALS + 3)
                for lane in range(np.uint64(LANES)):
                    o, d = wide(at.get3(lanes, at.ORIGIN, lane)), wide(at.get3(lanes, at.DIRECTION, lane))
                    t = real(sphere_distance(o, d, center, radius))
                    nearer(lanes, lane, t, rank, t < real(np.inf))
        if planes:
            closest_planes(lanes, world, real)

    return closest


@cache
def stage(triangles: bool, spheres: bool, planes: bool, real: Any) -> Any:
    """Closest hits in a scene with these kinds of shapes."""
    return compile_stage(_make(triangles, spheres, planes, real))
