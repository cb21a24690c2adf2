"""Embree as an intersector of blocks: sixteen rays a call, from compiled code, planes tested apart."""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from engines.embree.library import SPHERE_GEOMETRY, TRIANGLE_GEOMETRY, EmbreeScene, address
from engines.kernels import block as at
from engines.kernels import jit
from engines.kernels.jit import (
    LANES,
    compile_stage,
    count,
    fetch,
    get,
    inline,
    keep,
    pointer,
    put,
    put_int,
    select,
    table,
)
from engines.kernels.linear import closest_planes, occluded_planes
from engines.kernels.shapes import sphere_distance
from engines.kernels.surface import row3
from engines.kernels.vector import Vec3
from engines.kernels.world import (
    ACCELERATOR,
    SPHERE_RANK,
    SPHERE_REALS,
    SPHERES,
    TRIANGLE_RANK,
    TRIANGLES,
    VERTICES,
    Needs,
    World,
)

INTERSECT, OCCLUDE, SCENE = (ACCELERATOR + k for k in range(3))

# RTCRayHit16: arrays of sixteen 32-bit numbers, in this order (rtcore_ray.h)
ORG_X, ORG_Y, ORG_Z, T_NEAR, DIR_X, DIR_Y, DIR_Z, TIME, T_FAR, MASK, ID, FLAGS = range(12)
NG_X, NG_Y, NG_Z, HIT_U, HIT_V, PRIM_ID, GEOM_ID, INST_ID, INST_PRIM_ID = range(12, 21)
VALID = 21
PACKET_WORDS = 22 * LANES


class Accelerator:
    """Embree's own tree; `quality` and `robust` are its build quality and scene flag."""

    name = "embree"
    precision = np.float32
    scratch = PACKET_WORDS

    def __init__(self, options: Any) -> None:
        self._quality, self._robust = options["quality"], options["robust"]
        self.build_seconds = 0.0
        self._scene: EmbreeScene | None = None

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        scene = EmbreeScene(threads, self._quality, self._robust)
        if len(world.arrays[TRIANGLES]):
            scene.add_triangles(world.arrays[VERTICES], world.arrays[TRIANGLES])
        if len(world.arrays[SPHERES]):
            scene.add_spheres(world.arrays[SPHERES], *(callback.address for callback in sphere_callbacks()))
        scene.commit()
        self._scene = scene
        world.bind(INTERSECT, address("rtcIntersect16"))
        world.bind(OCCLUDE, address("rtcOccluded16"))
        world.bind(SCENE, scene.handle)
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return self._scene.bytes if self._scene else 0

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        return stages(needs.triangles, needs.spheres, needs.planes, real)


@intrinsic
def _query(typing, function, valid, scene, packet):
    """rtcIntersect16 or rtcOccluded16 at address `function`, with default arguments."""

    def generate(context, builder, signature, arguments):
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word, word, word])
        builder.call(
            builder.inttoptr(arguments[0], kind.as_pointer()),
            [arguments[1], arguments[2], arguments[3], ir.Constant(word, 0)],
        )
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, types.int64), generate


@inline
def _fill(lanes, packet, words, origin, direction, reach):
    """Copies the lanes' rays into Embree's packet; a lane without a ray is not valid."""
    for lane in range(np.uint64(LANES)):
        i = np.int64(lane)
        o, d, t = at.get3(lanes, origin, lane), at.get3(lanes, direction, lane), get(lanes, reach, lane)
        keep(packet, ORG_X * LANES + i, np.float32(o.x))
        keep(packet, ORG_Y * LANES + i, np.float32(o.y))
        keep(packet, ORG_Z * LANES + i, np.float32(o.z))
        keep(packet, DIR_X * LANES + i, np.float32(d.x))
        keep(packet, DIR_Y * LANES + i, np.float32(d.y))
        keep(packet, DIR_Z * LANES + i, np.float32(d.z))
        keep(packet, T_NEAR * LANES + i, np.float32(0))
        keep(packet, TIME * LANES + i, np.float32(0))
        keep(packet, T_FAR * LANES + i, np.float32(t))
    for lane in range(np.uint64(LANES)):
        i = np.int64(lane)
        keep(words, MASK * LANES + i, np.int32(-1))
        keep(words, ID * LANES + i, np.int32(0))
        keep(words, FLAGS * LANES + i, np.int32(0))
        keep(words, GEOM_ID * LANES + i, np.int32(-1))
        keep(words, INST_ID * LANES + i, np.int32(-1))
        keep(words, INST_PRIM_ID * LANES + i, np.int32(-1))
        keep(words, VALID * LANES + i, np.int32(-1) if get(lanes, reach, lane) > 0 else np.int32(0))


def _make_closest(triangles: bool, spheres: bool, planes: bool, real: Any) -> Any:
    size = np.dtype(real).itemsize

    def closest(block, world):
        lanes = pointer(block, real)
        if triangles or spheres:
            place = block + at.SCRATCH_FIRST * LANES * size
            packet, words = pointer(place, np.float32), pointer(place, np.int32)
            _fill(lanes, packet, words, at.ORIGIN, at.DIRECTION, at.T)
            _query(count(world, INTERSECT), place + VALID * LANES * 4, count(world, SCENE), place)
            of_triangle, of_sphere = table(world, TRIANGLE_RANK, np.int32), table(world, SPHERE_RANK, np.int32)
            for lane in range(np.uint64(LANES)):
                i = np.int64(lane)
                geometry, primitive = fetch(words, GEOM_ID * LANES + i), np.int64(fetch(words, PRIM_ID * LANES + i))
                rank = np.int32(-1)
                if triangles:
                    hit = geometry == TRIANGLE_GEOMETRY
                    rank = select(hit, fetch(of_triangle, primitive if hit else np.int64(0)), rank)
                if spheres:
                    hit = geometry == SPHERE_GEOMETRY
                    rank = select(hit, fetch(of_sphere, primitive if hit else np.int64(0)), rank)
                put_int(lanes, at.RANK, lane, rank)
                t = get(lanes, at.T, lane)
                put(lanes, at.T, lane, select(rank >= 0, real(fetch(packet, T_FAR * LANES + i)), t))
        else:
            for lane in range(np.uint64(LANES)):
                put_int(lanes, at.RANK, lane, -1)
        if planes:
            closest_planes(lanes, world, real)

    return closest


def _make_occluded(triangles: bool, spheres: bool, planes: bool, real: Any) -> Any:
    size = np.dtype(real).itemsize

    def occluded(block, world):
        lanes = pointer(block, real)
        if triangles or spheres:
            place = block + at.SCRATCH_FIRST * LANES * size
            packet, words = pointer(place, np.float32), pointer(place, np.int32)
            _fill(lanes, packet, words, at.SHADOW_ORIGIN, at.TO_LIGHT, at.SHADOW_T)
            _query(count(world, OCCLUDE), place + VALID * LANES * 4, count(world, SCENE), place)
            for lane in range(np.uint64(LANES)):
                # Embree marks an occluded ray by tfar = -inf; a lane without a ray kept its own, not above 0
                hidden = fetch(packet, T_FAR * LANES + np.int64(lane)) == np.float32(-np.inf)
                put_int(lanes, at.OCCLUDED, lane, 1 if hidden else 0)
        else:
            for lane in range(np.uint64(LANES)):
                put_int(lanes, at.OCCLUDED, lane, 0)
        if planes:
            occluded_planes(lanes, world, real)

    return occluded


@cache
def stages(triangles: bool, spheres: bool, planes: bool, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes, real)
    return compile_stage(_make_closest(*shapes)), compile_stage(_make_occluded(*shapes))


# ---- spheres by callback: solved in float64, as in every engine of the project --------------------------------------


def _sphere_bounds(arguments):
    """RTCBoundsFunctionArguments: user data, primID, timeStep, bounds (lower 3, pad, upper 3, pad; float32)."""
    words = pointer(arguments, np.int64)
    spheres = pointer(fetch(words, 0), np.float64)
    primitive = np.int64(fetch(pointer(arguments + 8, np.uint32), 0))
    box = pointer(fetch(words, 2), np.float32)
    radius = fetch(spheres, primitive * SPHERE_REALS + 3)
    for axis in range(3):
        center = fetch(spheres, primitive * SPHERE_REALS + axis)
        pad = (abs(center) + radius) * 4e-7
        keep(box, axis, np.float32(center - radius - pad))
        keep(box, 4 + axis, np.float32(center + radius + pad))


def _make_sphere_query(any_hit: bool) -> Any:
    def query(arguments):
        """RTCIntersectFunctionNArguments: valid, user data, primID, context, ray(hit), N, geomID."""
        words = pointer(arguments, np.int64)
        valid, spheres = pointer(fetch(words, 0), np.int32), pointer(fetch(words, 1), np.float64)
        primitive = np.int64(fetch(pointer(arguments + 16, np.uint32), 0))
        packet, ids = pointer(fetch(words, 4), np.float32), pointer(fetch(words, 4), np.int32)
        n = np.int64(fetch(pointer(arguments + 40, np.uint32), 0))
        geometry = fetch(pointer(arguments + 44, np.int32), 0)
        center, radius = row3(spheres, primitive * SPHERE_REALS), fetch(spheres, primitive * SPHERE_REALS + 3)
        for i in range(n):
            if fetch(valid, i) == 0:
                continue
            o = Vec3(
                np.float64(fetch(packet, ORG_X * n + i)),
                np.float64(fetch(packet, ORG_Y * n + i)),
                np.float64(fetch(packet, ORG_Z * n + i)),
            )
            d = Vec3(
                np.float64(fetch(packet, DIR_X * n + i)),
                np.float64(fetch(packet, DIR_Y * n + i)),
                np.float64(fetch(packet, DIR_Z * n + i)),
            )
            t = np.float32(sphere_distance(o, d, center, radius))
            if t < fetch(packet, T_FAR * n + i):
                if any_hit:
                    keep(packet, T_FAR * n + i, np.float32(-np.inf))
                else:
                    keep(packet, T_FAR * n + i, t)
                    keep(ids, PRIM_ID * n + i, np.int32(primitive))
                    keep(ids, GEOM_ID * n + i, geometry)

    return query


_CALLBACK = types.void(types.int64)


@cache
def sphere_callbacks() -> tuple[Any, Any, Any]:
    """(bounds, intersect, occluded), compiled."""
    return tuple(  # type: ignore[return-value]
        jit.compile_function(f, _CALLBACK)
        for f in (_sphere_bounds, _make_sphere_query(False), _make_sphere_query(True))
    )
