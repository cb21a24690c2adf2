"""Embree as an intersector of blocks: packets of rays from compiled code, planes tested apart.

Embree works in float32. With `refine` every hit it claims is solved anew in float64, from the block's ray and the world's
vertices. Where the face does not confirm it (or is the one that the ray has just left) the lane is asked once more, in a
second scene of the same shapes whose triangles are solved in float64 by callback: Embree then only walks the tree, so
what the false hit had hidden is found, and nothing slips between faces. That scene is asked rarely, and built coarsely.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.embree.callbacks import exact_distance, hit_filter, sphere_callbacks, triangle_callbacks
from engines.embree.library import SPHERE_GEOMETRY, TRIANGLE_GEOMETRY, Device, address
from engines.embree.packet import (
    EXACT_SCENE,
    FILTER,
    GEOM_ID,
    INTERSECT,
    INTERSECT_ONE,
    LARGE,
    LEFT_FACE,
    OCCLUDE,
    PRIM_ID,
    RECORD,
    SCALE,
    SCENE,
    SCRATCH_WORDS,
    T_FAR,
    VALID,
    ask,
    fill,
    place_of,
    scratch,
    together,
    width,
)
from engines.kernels import block as at
from engines.kernels.jit import (
    LANES,
    compile_stage,
    fetch,
    get,
    get_int,
    inline,
    keep,
    lowest_bit,
    pointer,
    put,
    put_int,
    select,
    table,
)
from engines.kernels.linear import closest_planes, occluded_planes
from engines.kernels.world import (
    PRIMITIVE_INTS,
    PRIMITIVES,
    SPHERE_RANK,
    SPHERES,
    TRIANGLE,
    TRIANGLE_RANK,
    TRIANGLES,
    VERTICES,
    Needs,
    World,
)

RAY, SHADOW_RAY = (at.ORIGIN, at.DIRECTION, at.T), (at.SHADOW_ORIGIN, at.TO_LIGHT, at.SHADOW_T)
UPWARDS = 1 + 2.0**-22
"""With `refine` Embree looks this much beyond t_max, so that float64 decides what lies before it."""
FEW, MANY = 4096, 65536
"""Up to FEW primitives a tree is built by one thread, as another takes long to wake; up to MANY all rays go in packets."""
BOX_PAD = 1e-6
"""Boxes of what is solved in float64 are padded by this share of the scene: so far a ray may be off in float32."""


class Accelerator:
    """Embree's own tree; `quality` and `robust` are its build quality and scene flag."""

    name = "embree"
    precision = np.float32
    scratch = SCRATCH_WORDS

    def __init__(self, options: Any, refine: bool) -> None:
        self._quality, self._robust, self._refine = options["quality"], options["robust"], refine
        self.build_seconds = 0.0
        self._bytes = 0

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        rays = width()
        world.bind(INTERSECT, address(f"rtcIntersect{rays}"))
        world.bind(INTERSECT_ONE, address("rtcIntersect1"))
        world.bind(OCCLUDE, address(f"rtcOccluded{rays}"))
        world.bind(SCALE, _scales(world))
        faces = len(world.arrays[TRIANGLES])
        primitives = faces + len(world.arrays[SPHERES])
        world.bind(LARGE, int(primitives > MANY))
        device = Device(threads if primitives > FEW else 1)
        world.owned.append(device)
        parts = _spheres(device, world)
        if faces:
            world.bind(FILTER, hit_filter(world.real).address)
            scaled = world.arrays[VERTICES] * world.real(world.arrays[SCALE][0])
            parts[TRIANGLE_GEOMETRY] = device.triangles(scaled, world.arrays[TRIANGLES])
        world.bind(SCENE, device.scene(parts, world.address, self._quality, self._robust))
        if faces and self._refine:
            parts, made = _spheres(device, world), triangle_callbacks(world.real)
            parts[TRIANGLE_GEOMETRY] = device.by_callback(faces, *(code.address for code in made))
            world.bind(EXACT_SCENE, device.scene(parts, world.address, "low", True))
        self._bytes = device.bytes
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return self._bytes

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        return stages(Kinds(needs.triangles, needs.spheres, needs.planes, self._refine, width()), real)


def _spheres(device: Device, world: World) -> dict[int, int]:
    count = len(world.arrays[SPHERES])
    if not count:
        return {}
    made = sphere_callbacks(world.real)
    return {SPHERE_GEOMETRY: device.by_callback(count, *(code.address for code in made))}


def _scales(world: World) -> Any:
    """(3,): the power of two that makes the scene about as large as 1, its inverse, and the pad of boxes in metres."""
    size = float(np.abs(world.bounds - world.center).max(initial=0.0, where=np.isfinite(world.bounds)))
    scale = 2.0 ** -np.clip(np.round(np.log2(size)), -100, 100) if size > 0 else 1.0
    return np.array([scale, 1.0 / scale, size * BOX_PAD])


class Kinds(NamedTuple):
    """What a stage is compiled for: the kinds of shapes, whether hits are confirmed in float64, and rays a packet."""

    triangles: bool
    spheres: bool
    planes: bool
    refine: bool
    wide: int


@inline
def _note_left(lanes, world, place, kinds):
    """Writes down the triangle that each lane's ray has left, for the filter; returns whether there is any."""
    words, primitives, some = pointer(place, np.int32), table(world, PRIMITIVES, np.int32), False
    for k in range(LANES):
        lane, face = np.uint64(k), np.int32(-1)
        left = np.int64(get_int(lanes, at.LEFT, lane))
        traced = left >= 0 and fetch(words, place_of(lane, kinds.wide) + VALID * kinds.wide) != 0
        if traced and fetch(primitives, PRIMITIVE_INTS * left) == TRIANGLE:
            face, some = fetch(primitives, PRIMITIVE_INTS * left + 1), True
        keep(words, LEFT_FACE + k, face)
    return some


@inline
def _ask_again(lanes, world, query, place, block, reach, doubtful, upwards, kinds, real):
    """Traces the lanes of the word `doubtful` once more, and no others: where triangles are solved in float64, or, without
    `refine`, past the face that the ray has left."""
    packet, words = pointer(place, np.float32), pointer(place, np.int32)
    scale = real(fetch(table(world, SCALE, np.float64), 0))
    for k in range(LANES):
        lane, again = np.uint64(k), (doubtful >> np.int64(k)) & 1 != 0
        i = place_of(lane, kinds.wide)
        keep(words, i + VALID * kinds.wide, np.int32(-1 if again else 0))
        if again:
            keep(words, i + GEOM_ID * kinds.wide, np.int32(-1))
            keep(packet, i + T_FAR * kinds.wide, np.float32(get(lanes, reach, lane) * scale) * upwards)
    if not kinds.refine:
        _note_left(lanes, world, place, kinds)
    ask(world, query, EXACT_SCENE if kinds.refine else SCENE, place, block, kinds.wide, not kinds.refine, False)


@inline
def _claimed(world, place, lane, kinds):
    """(face, rank) of what Embree claims for a lane; -1 where it is no triangle, or nothing."""
    words, i = pointer(place, np.int32), place_of(lane, kinds.wide)
    geometry, primitive = fetch(words, i + GEOM_ID * kinds.wide), np.int64(fetch(words, i + PRIM_ID * kinds.wide))
    face, rank = np.int64(-1), np.int32(-1)
    if kinds.triangles:
        hit = geometry == TRIANGLE_GEOMETRY
        face = select(hit, primitive, face)
        if kinds.spheres or kinds.planes:
            rank = select(hit, fetch(table(world, TRIANGLE_RANK, np.int32), primitive if hit else np.int64(0)), rank)
        else:  # where there are triangles alone, their numbers are their ranks: one cache miss less
            rank = select(hit, np.int32(primitive), rank)
    if kinds.spheres:
        hit = geometry == SPHERE_GEOMETRY
        rank = select(hit, fetch(table(world, SPHERE_RANK, np.int32), primitive if hit else np.int64(0)), rank)
    return face, rank


@inline
def _claimed_distance(world, place, lane, kinds):
    packet, unscale = pointer(place, np.float32), fetch(table(world, SCALE, np.float64), 1)
    return np.float64(fetch(packet, place_of(lane, kinds.wide) + T_FAR * kinds.wide)) * unscale


@inline
def _confirmed(lanes, world, lane, face, rank, fields, kinds, real):
    """(whether the lane did hit the face that is claimed for it, distance): `fields` are those of the ray."""
    confirmed, t = rank != get_int(lanes, at.LEFT, lane), 0.0
    if kinds.refine:
        o, d = at.get3(lanes, fields[0], lane), at.get3(lanes, fields[1], lane)
        t = exact_distance(o, d, world, face if face >= 0 else np.int64(0), real)
        confirmed = confirmed & (t > 0.0) & (t < np.float64(get(lanes, fields[2], lane)))
    return confirmed, t


@inline
def _put_hit(lanes, lane, rank, t, real):
    put_int(lanes, at.RANK, lane, rank)
    put(lanes, at.T, lane, select(rank >= 0, real(t), get(lanes, at.T, lane)))


@inline
def _put_claims(lanes, world, place, kinds, real):
    """The hits of all lanes, as far as they are confirmed; returns a word of the lanes where they are not."""
    words = pointer(place, np.int32)
    for lane in range(np.uint64(LANES)):
        face, rank = _claimed(world, place, lane, kinds)
        t, wrong = _claimed_distance(world, place, lane, kinds), False
        if kinds.triangles:
            confirmed, exact = _confirmed(lanes, world, lane, face, rank, RAY, kinds, real)
            wrong = (face >= 0) & (not confirmed)
            if kinds.refine:
                t = select(face >= 0, exact, t)
        _put_hit(lanes, lane, select(wrong, np.int32(-1), rank), t, real)
        keep(words, RECORD + np.int64(lane), np.int32(1 if wrong else 0))
    return _word(words)


@inline
def _word(words):
    """The lanes whose record is not 0, as bits."""
    bits = np.int64(0)
    for lane in range(LANES):
        bits |= np.int64(1 if fetch(words, RECORD + lane) != 0 else 0) << np.int64(lane)
    return bits


def _make_closest(kinds: Kinds, real: Any) -> Any:
    size, upwards = np.dtype(real).itemsize, np.float32(UPWARDS if kinds.refine else 1)

    def closest(block, world):
        lanes = pointer(block, real)
        if kinds.triangles or kinds.spheres:
            place = scratch(block, size)
            fill(lanes, world, place, RAY, kinds.wide, upwards, real)
            coherent = together(place, kinds.wide)
            mixed = kinds.spheres or kinds.planes
            ask(world, INTERSECT, SCENE, place, block, kinds.wide, False, coherent, mixed, 3 * size)
            doubtful = _put_claims(lanes, world, place, kinds, real)
            if doubtful != 0:
                _ask_again(lanes, world, INTERSECT, place, block, at.T, doubtful, upwards, kinds, real)
                while doubtful != 0:
                    lane = np.uint64(lowest_bit(doubtful))
                    doubtful &= doubtful - 1
                    _, rank = _claimed(world, place, lane, kinds)
                    _put_hit(lanes, lane, rank, _claimed_distance(world, place, lane, kinds), real)
        else:
            for lane in range(np.uint64(LANES)):
                put_int(lanes, at.RANK, lane, -1)
        if kinds.planes:
            closest_planes(lanes, world, real)

    return closest


@inline
def _put_shadows(lanes, world, place, kinds, real):
    """Whether each lane's light is hidden; returns a word of the lanes where the face that hides it is not confirmed."""
    packet, words = pointer(place, np.float32), pointer(place, np.int32)
    for lane in range(np.uint64(LANES)):
        # Embree marks an occluded ray by tfar = -inf; a lane without a ray kept its own, not above 0
        hidden = fetch(packet, place_of(lane, kinds.wide) + T_FAR * kinds.wide) == np.float32(-np.inf)
        wrong = False
        if kinds.refine and kinds.triangles:
            face = np.int64(fetch(words, RECORD + np.int64(lane)))
            confirmed, _ = _confirmed(lanes, world, lane, face, np.int32(-2), SHADOW_RAY, kinds, real)
            wrong = hidden & (face >= 0) & (not confirmed)
        put_int(lanes, at.OCCLUDED, lane, 1 if hidden else 0)
        keep(words, RECORD + np.int64(lane), np.int32(1 if wrong else 0))
    return _word(words)


def _make_occluded(kinds: Kinds, real: Any) -> Any:
    size, upwards = np.dtype(real).itemsize, np.float32(UPWARDS if kinds.refine else 1)

    def occluded(block, world):
        lanes = pointer(block, real)
        if kinds.triangles or kinds.spheres:
            place = scratch(block, size)
            fill(lanes, world, place, SHADOW_RAY, kinds.wide, upwards, real)
            # the filter is called once an occluded ray, so only where there is something to leave out, or to write down
            filtered = kinds.triangles and (_note_left(lanes, world, place, kinds) or kinds.refine)
            ask(world, OCCLUDE, SCENE, place, block, kinds.wide, filtered, False)
            doubtful = _put_shadows(lanes, world, place, kinds, real)
            if kinds.refine and doubtful != 0:
                _ask_again(lanes, world, OCCLUDE, place, block, at.SHADOW_T, doubtful, upwards, kinds, real)
                packet = pointer(place, np.float32)
                while doubtful != 0:
                    lane = np.uint64(lowest_bit(doubtful))
                    doubtful &= doubtful - 1
                    far = fetch(packet, place_of(lane, kinds.wide) + T_FAR * kinds.wide)
                    put_int(lanes, at.OCCLUDED, lane, 1 if far == np.float32(-np.inf) else 0)
        else:
            for lane in range(np.uint64(LANES)):
                put_int(lanes, at.OCCLUDED, lane, 0)
        if kinds.planes:
            occluded_planes(lanes, world, real)

    return occluded


@cache
def stages(kinds: Kinds, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for these kinds of shapes."""
    return compile_stage(_make_closest(kinds, real)), compile_stage(_make_occluded(kinds, real))
