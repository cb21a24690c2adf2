"""Rays asked for from Python, `trace` and `occluded`: a block of sixteen at a time through the stages of the intersector."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.kernels import block as at
from engines.kernels.driver import BARE_SURFACE, CLOSEST, OCCLUDED, make_idle
from engines.kernels.jit import LANES, call_stage, get, get_int, inline, kernel, pointer, put, put_int
from engines.kernels.vector import Vec3

Reals = NDArray[np.float64]


def rays_of(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> tuple[Reals, Reals, Reals]:
    """Origins and directions (n, 3), t_max (n,). Raises ValueError where the shapes are others."""
    o = np.ascontiguousarray(np.atleast_2d(np.asarray(origins, np.float64)))
    d = np.ascontiguousarray(np.atleast_2d(np.asarray(directions, np.float64)))
    if o.ndim != 2 or o.shape[1] != 3 or o.shape != d.shape:
        raise ValueError(f"origins {o.shape} and directions {d.shape}: both must have the shape (n, 3)")
    return o, d, np.ascontiguousarray(np.broadcast_to(np.asarray(t_max, np.float64), (len(o),)))


@inline
def _ray(origins, directions, reach, center, i):
    """Ray i in tracing coordinates, its direction unit: (origin, direction, t_max in metres, length). t_max is -1 for a ray
    that cannot hit: not finite, zero, or with t_max not above 0."""
    x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
    big = max(abs(x), abs(y), abs(z))
    ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
    good = (
        math.isfinite(big) and big > 0.0 and math.isfinite(x + y + z) and math.isfinite(ox + oy + oz) and reach[i] > 0.0
    )
    if not good:
        return Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 1.0), -1.0, 1.0
    scale = 1.0 / big if big > 1e-300 else 1e300
    x, y, z = x * scale, y * scale, z * scale
    norm = math.sqrt(x * x + y * y + z * z)
    length = norm / scale
    origin = Vec3(ox - center[0], oy - center[1], oz - center[2])
    return origin, Vec3(x / norm, y / norm, z / norm), reach[i] * length, length


@inline
def _shape_of(rank, first_rank):
    """(shape, index within it) of the primitive `rank`, -1 and -1 of none; by bisection, which misses no cache."""
    if rank < 0:
        return np.int64(-1), np.int64(-1)
    low, high = 0, len(first_rank)
    while high - low > 1:
        middle = (low + high) // 2
        if first_rank[middle] <= rank:
            low = middle
        else:
            high = middle
    return np.int64(low), rank - first_rank[low]


@cache
def tracer(real: Any) -> Any:
    """The kernel that finds closest hits of rays first .. last - 1; returns how many of them can hit anything."""
    one = real(1)

    def trace(
        stages, block, world, origins, directions, reach, center, first, last,
        first_rank, t, shape, primitive, normal, u, v,
    ):  # fmt: skip
        lanes = pointer(block, real)
        lengths, traced = np.empty(LANES), 0
        for start in range(first, last, LANES):
            for lane in range(np.uint64(LANES)):
                i = start + np.int64(lane)
                make_idle(lanes, lane, one, 0)
                put_int(lanes, at.LEFT, lane, -1)
                if i < last:
                    o, d, far, lengths[lane] = _ray(origins, directions, reach, center, i)
                    at.put3(lanes, at.ORIGIN, lane, Vec3(real(o.x), real(o.y), real(o.z)))
                    at.put3(lanes, at.DIRECTION, lane, Vec3(real(d.x), real(d.y), real(d.z)))
                    put(lanes, at.T, lane, real(far))
                    traced += 1 if far > 0.0 else 0
            call_stage(stages[CLOSEST], block, world)
            call_stage(stages[BARE_SURFACE], block, world)
            for lane in range(np.uint64(LANES)):
                i = start + np.int64(lane)
                if i < last:
                    hit = get_int(lanes, at.MISS, lane) == 0
                    shape[i], primitive[i] = _shape_of(np.int64(get_int(lanes, at.RANK, lane)), first_rank)
                    t[i] = np.float64(get(lanes, at.T, lane)) / lengths[lane] if hit else math.inf
                    n = at.get3(lanes, at.GEOMETRIC, lane)
                    normal[i, 0], normal[i, 1], normal[i, 2] = (
                        (n.x, n.y, n.z) if hit else (one - one, one - one, one - one)
                    )
                    u[i] = get(lanes, at.U, lane) if hit else one - one
                    v[i] = get(lanes, at.V, lane) if hit else one - one
        return traced

    return kernel(trace)


@cache
def shadow_tracer(real: Any) -> Any:
    """The kernel that asks of rays first .. last - 1 whether anything is in the way; returns how many can meet anything."""
    one = real(1)

    def occluded(stages, block, world, origins, directions, reach, center, first, last, answer):
        lanes, traced = pointer(block, real), 0
        for start in range(first, last, LANES):
            for lane in range(np.uint64(LANES)):
                i = start + np.int64(lane)
                make_idle(lanes, lane, one, 0)
                put_int(lanes, at.LEFT, lane, -1)
                if i < last:
                    o, d, far, _ = _ray(origins, directions, reach, center, i)
                    at.put3(lanes, at.SHADOW_ORIGIN, lane, Vec3(real(o.x), real(o.y), real(o.z)))
                    at.put3(lanes, at.TO_LIGHT, lane, Vec3(real(d.x), real(d.y), real(d.z)))
                    put(lanes, at.SHADOW_T, lane, real(far))
                    traced += 1 if far > 0.0 else 0
            call_stage(stages[OCCLUDED], block, world)
            for lane in range(np.uint64(LANES)):
                i = start + np.int64(lane)
                if i < last:
                    answer[i] = get_int(lanes, at.OCCLUDED, lane) != 0
        return traced

    return kernel(occluded)
