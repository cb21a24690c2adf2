"""What Embree calls back: bounds and hits of primitives that are solved in float64, and a filter of its own hits.

Callbacks read a lane's ray from the block, not from Embree's packet, where it has been rounded to float32 and scaled.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types

from engines.embree.packet import BLOCK_OF_CONTEXT, GEOM_ID, ID, LEFT_FACE, NG_X, PRIM_ID, RECORD, SCALE, T_FAR, scratch
from engines.kernels import block as at
from engines.kernels import jit
from engines.kernels.jit import fetch, get, get_int, inline, keep, pointer, table
from engines.kernels.shapes import ray_frame, shear, sphere_distance, triangle_distance
from engines.kernels.surface import row3, wide
from engines.kernels.vector import Vec3
from engines.kernels.world import SPHERE_REALS, SPHERES, TRIANGLE_RANK, TRIANGLES, VERTICES

_PRIM_ID_OF_HIT = PRIM_ID - NG_X
"""Where a hit alone holds it: RTCHitN is the end of RTCRayHitN."""


@inline
def exact_distance(o, d, world, face, real):
    """Distance in float64 to a face of the world, inf where it is missed; edges count, as in every engine."""
    vertices, faces = table(world, VERTICES, real), table(world, TRIANGLES, np.int32)
    o, frame = wide(o), ray_frame(wide(d))
    a = shear(frame, wide(row3(vertices, 3 * np.int64(fetch(faces, 3 * face)))) - o)
    b = shear(frame, wide(row3(vertices, 3 * np.int64(fetch(faces, 3 * face + 1)))) - o)
    c = shear(frame, wide(row3(vertices, 3 * np.int64(fetch(faces, 3 * face + 2)))) - o)
    return triangle_distance(a, b, c)


@inline
def _keep_bounds(arguments, world, low, high):
    """Into RTCBoundsFunctionArguments: user data, primID, timeStep, bounds (lower 3, pad, upper 3, pad; float32)."""
    box, scales = pointer(fetch(pointer(arguments, np.int64), 2), np.float32), table(world, SCALE, np.float64)
    scale, pad = fetch(scales, 0), fetch(scales, 2)
    keep(box, 0, np.float32((low.x - pad) * scale))
    keep(box, 1, np.float32((low.y - pad) * scale))
    keep(box, 2, np.float32((low.z - pad) * scale))
    keep(box, 4, np.float32((high.x + pad) * scale))
    keep(box, 5, np.float32((high.y + pad) * scale))
    keep(box, 6, np.float32((high.z + pad) * scale))


@inline
def _primitive(arguments, offset):
    return np.int64(fetch(pointer(arguments + offset, np.uint32), 0))


def _sphere_bounds(arguments):
    world, row = fetch(pointer(arguments, np.int64), 0), _primitive(arguments, 8) * SPHERE_REALS
    spheres = table(world, SPHERES, np.float64)
    center, radius = row3(spheres, row), fetch(spheres, row + 3)
    reach = Vec3(radius, radius, radius)
    _keep_bounds(arguments, world, center - reach, center + reach)


def _make_triangle_bounds(real: Any) -> Any:
    def bounds(arguments):
        world, face = fetch(pointer(arguments, np.int64), 0), _primitive(arguments, 8)
        vertices, faces = table(world, VERTICES, real), table(world, TRIANGLES, np.int32)
        low = high = wide(row3(vertices, 3 * np.int64(fetch(faces, 3 * face))))
        for k in range(1, 3):
            p = wide(row3(vertices, 3 * np.int64(fetch(faces, 3 * face + k))))
            low = Vec3(min(low.x, p.x), min(low.y, p.y), min(low.z, p.z))
            high = Vec3(max(high.x, p.x), max(high.y, p.y), max(high.z, p.z))
        _keep_bounds(arguments, world, low, high)

    return bounds


@inline
def _ties(packet, ids, n, i, near, geometry, primitive):
    """Whether a hit is as near as the one held, of the same kind and of lower index: Embree calls back in any order."""
    held = fetch(ids, GEOM_ID * n + i) == geometry and primitive < np.int64(fetch(ids, PRIM_ID * n + i))
    return held and near == fetch(packet, T_FAR * n + i)


def _make_query(spheres: bool, any_hit: bool, real: Any) -> Any:
    origin, direction, reach = (
        (at.SHADOW_ORIGIN, at.TO_LIGHT, at.SHADOW_T) if any_hit else (at.ORIGIN, at.DIRECTION, at.T)
    )

    def query(arguments):
        """RTCIntersectFunctionNArguments: valid, user data, primID, context, ray(hit), N, geomID."""
        longs, primitive = pointer(arguments, np.int64), _primitive(arguments, 16)
        valid, world = pointer(fetch(longs, 0), np.int32), fetch(longs, 1)
        lanes = pointer(fetch(pointer(fetch(longs, 3), np.int64), BLOCK_OF_CONTEXT), real)
        packet, ids = pointer(fetch(longs, 4), np.float32), pointer(fetch(longs, 4), np.int32)
        n, geometry = (
            np.int64(fetch(pointer(arguments + 40, np.uint32), 0)),
            fetch(pointer(arguments + 44, np.int32), 0),
        )
        scale = fetch(table(world, SCALE, np.float64), 0)
        for i in range(n):
            if fetch(valid, i) == 0:
                continue
            lane = np.uint64(fetch(ids, ID * n + i))
            o, d = at.get3(lanes, origin, lane), at.get3(lanes, direction, lane)
            if spheres:
                row = primitive * SPHERE_REALS
                data = table(world, SPHERES, np.float64)
                t = sphere_distance(wide(o), wide(d), row3(data, row), fetch(data, row + 3))
            else:
                t = exact_distance(o, d, world, primitive, real)
                if np.int64(fetch(table(world, TRIANGLE_RANK, np.int32), primitive)) == get_int(lanes, at.LEFT, lane):
                    t = np.inf
            if t > 0.0 and t < np.float64(get(lanes, reach, lane)):
                near = np.float32(t * scale)
                if any_hit:
                    keep(packet, T_FAR * n + i, np.float32(-np.inf))
                elif near < fetch(packet, T_FAR * n + i) or _ties(packet, ids, n, i, near, geometry, primitive):
                    keep(packet, T_FAR * n + i, near)
                    keep(ids, PRIM_ID * n + i, np.int32(primitive))
                    keep(ids, GEOM_ID * n + i, geometry)

    return query


def _make_filter(real: Any) -> Any:
    size = np.dtype(real).itemsize

    def filter_hits(arguments):
        """RTCFilterFunctionNArguments: valid, user data, context, ray, hit, N. Drops the face that a ray has just left,
        and writes down which face is claimed for each lane."""
        longs = pointer(arguments, np.int64)
        valid, block = pointer(fetch(longs, 0), np.int32), fetch(pointer(fetch(longs, 2), np.int64), BLOCK_OF_CONTEXT)
        record = pointer(scratch(block, size), np.int32)
        ids, hits = pointer(fetch(longs, 3), np.int32), pointer(fetch(longs, 4), np.int32)
        n = np.int64(fetch(pointer(arguments + 40, np.uint32), 0))
        for i in range(n):
            if fetch(valid, i) == 0:
                continue
            lane, primitive = np.int64(fetch(ids, ID * n + i)), fetch(hits, _PRIM_ID_OF_HIT * n + i)
            if primitive == fetch(record, LEFT_FACE + lane):
                keep(valid, i, np.int32(0))
            else:
                keep(record, RECORD + lane, primitive)

    return filter_hits


_CALLBACK = types.void(types.int64)


class Callbacks(NamedTuple):
    """Machine code; its `.address` is what Embree wants, for as long as the object lives."""

    bounds: Any
    intersect: Any
    occluded: Any


@cache
def sphere_callbacks(real: Any) -> Callbacks:
    """For spheres in a block of `real` numbers; user data is the world's address."""
    parts = _sphere_bounds, _make_query(True, False, real), _make_query(True, True, real)
    return Callbacks(*(jit.compile_function(part, _CALLBACK) for part in parts))


@cache
def triangle_callbacks(real: Any) -> Callbacks:
    """For triangles solved in float64; user data is the world's address."""
    parts = _make_triangle_bounds(real), _make_query(False, False, real), _make_query(False, True, real)
    return Callbacks(*(jit.compile_function(part, _CALLBACK) for part in parts))


@cache
def hit_filter(real: Any) -> Any:
    """The filter of Embree's own triangles."""
    return jit.compile_function(_make_filter(real), _CALLBACK)
