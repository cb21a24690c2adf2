"""The queries `trace` and `occluded` of Python: sixteen rays at a time through the stages of the intersector."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.values import call_stage
from engines.kernels.compile.vec3 import Vec3
from engines.kernels.driver import make_idle
from engines.kernels.layout import LANES, SURFACE, ray_batch, scene_table

Reals = NDArray[np.float64]


def rays_of(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> tuple[Reals, Reals, Reals]:
    """Origins and directions (n, 3), t_max (n,). Raises ValueError where the shapes are others."""
    o = np.ascontiguousarray(np.atleast_2d(np.asarray(origins, np.float64)))
    d = np.ascontiguousarray(np.atleast_2d(np.asarray(directions, np.float64)))
    if o.ndim != 2 or o.shape[1] != 3 or o.shape != d.shape:
        raise ValueError(f"origins {o.shape} and directions {d.shape}: both must have the shape (n, 3)")
    return o, d, np.ascontiguousarray(np.broadcast_to(np.asarray(t_max, np.float64), (len(o),)))


@inline
def _ray(origins, directions, t_max, center, i):
    """Ray i in tracing coordinates, its direction unit: (origin, direction, t_max in metres, length). t_max is -1 for a
    ray that cannot hit: not finite, zero, or with t_max not above 0."""
    x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
    big = max(abs(x), abs(y), abs(z))
    ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
    good = math.isfinite(big) and big > 0.0 and math.isfinite(x + y + z) and math.isfinite(ox + oy + oz) and t_max[i] > 0.0
    if not good:
        return Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 1.0), -1.0, 1.0
    scale = 1.0 / big if big > 1e-300 else 1e300
    x, y, z = x * scale, y * scale, z * scale
    norm = math.sqrt(x * x + y * y + z * z)
    length = norm / scale
    origin = Vec3(ox - center[0], oy - center[1], oz - center[2])
    return origin, Vec3(x / norm, y / norm, z / norm), t_max[i] * length, length


@inline
def _shape_of(primitive, first_id):
    """(shape, index within it) of a primitive, -1 and -1 of none; by bisection, which misses no cache."""
    if primitive < 0:
        return np.int64(-1), np.int64(-1)
    low, high = 0, len(first_id)
    while high - low > 1:
        middle = (low + high) // 2
        if first_id[middle] <= primitive:
            low = middle
        else:
            high = middle
    return np.int64(low), primitive - first_id[low]


@inline
def _load_rays(rays, origin, direction, far, lengths, origins, directions, t_max, center, start, last):
    """Puts rays start .. start + 15, as far as `last`, into the batch's fields `origin`, `direction` and `far`; returns
    how many of them can hit anything."""
    traced = 0
    for lane in range(np.uint64(LANES)):
        i = start + np.int64(lane)
        make_idle(rays, lane, 0)
        rays.origin_primitive[lane] = -1
        if i < last:
            o, d, end, lengths[lane] = _ray(origins, directions, t_max, center, i)
            origin[lane] = o
            direction[lane] = d
            far[lane] = end
            traced += 1 if end > 0.0 else 0
    return traced


@inline
def _in_instance(instance, primitive):
    """(shape, index within it) of a primitive of a group."""
    return np.int64(instance.shape), primitive - np.int64(instance.first)


@cache
def tracer(instances: bool, real: Any) -> Any:
    """The kernel that finds closest hits of rays first .. last - 1; returns how many of them can hit anything. With `instances`
    for scenes that have some."""

    def trace(
        stages,
        batch,
        scene,
        origins,
        directions,
        t_max,
        center,
        first,
        last,
        first_id,
        places,
        t,
        shape,
        primitive,
        normal,
        u,
        v,
    ):
        rays, table = ray_batch(batch, real), scene_table(scene, real)
        lengths, traced = np.empty(LANES), 0
        for start in range(first, last, LANES):
            traced += _load_rays(
                rays, rays.origin, rays.direction, rays.t, lengths, origins, directions, t_max, center, start, last
            )
            call_stage(stages.closest, batch, scene)
            call_stage(stages.surface, batch, scene)
            for lane in range(np.uint64(LANES)):
                i = start + np.int64(lane)
                if i < last:
                    hit = rays.hit.kind[lane] == SURFACE
                    shape[i], primitive[i] = _shape_of(np.int64(rays.primitive[lane]), first_id)
                    if instances and hit:
                        if rays.instance[lane] >= 0:
                            met = table.instances[np.int64(rays.instance[lane])]
                            shape[i], primitive[i] = _in_instance(met, np.int64(rays.primitive[lane]))
                        else:
                            shape[i] = places[shape[i]]
                    t[i] = np.float64(rays.t[lane]) / lengths[lane] if hit else math.inf
                    n = rays.hit.geometric_normal[lane]
                    normal[i, 0] = n.x if hit else 0.0
                    normal[i, 1] = n.y if hit else 0.0
                    normal[i, 2] = n.z if hit else 0.0
                    u[i] = rays.hit.u[lane] if hit else 0.0
                    v[i] = rays.hit.v[lane] if hit else 0.0
        return traced

    return kernel(trace)


@cache
def shadow_tracer(real: Any) -> Any:
    """The kernel that tests rays first .. last - 1 for anything in the way; returns how many can meet anything."""

    def occluded(stages, batch, scene, origins, directions, t_max, center, first, last, answer):
        rays = ray_batch(batch, real)
        lengths, traced = np.empty(LANES), 0
        for start in range(first, last, LANES):
            traced += _load_rays(
                rays,
                rays.shadow.origin,
                rays.shadow.direction,
                rays.shadow.t_max,
                lengths,
                origins,
                directions,
                t_max,
                center,
                start,
                last,
            )
            call_stage(stages.occluded, batch, scene)
            for lane in range(np.uint64(LANES)):
                i = start + np.int64(lane)
                if i < last:
                    answer[i] = rays.shadow.occluded[lane] != 0
        return traced

    return kernel(occluded)
