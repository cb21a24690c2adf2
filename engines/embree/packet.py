"""Embree's ray packets, kept in a block's scratch memory: their layout, how a block's rays get there, and the call.

Rays enter Embree in float32, scaled so that the scene is about as large as 1: coordinates of 1e-20 or 1e18 leave its
range. The scale is a power of two, so it rounds nothing.
"""

from __future__ import annotations

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from engines.kernels import block as at
from engines.kernels.jit import LANES, count, fetch, get, inline, keep, pointer, table
from engines.kernels.simd import prefetch
from engines.kernels.world import ACCELERATOR, PRIMITIVE_INTS, PRIMITIVES, TRIANGLE_RANK, TRIANGLES, VERTICES

INTERSECT, INTERSECT_ONE, OCCLUDE, SCENE, EXACT_SCENE, FILTER, SCALE, LARGE = (ACCELERATOR + k for k in range(8))
"""Slots of the world: addresses of the query for closest hits, of packets and of one ray, and of that for shadows; the
scenes; the address of the filter; (scale, 1/scale, pad); and 1 where closest hits of rays that do not go together are to be
asked for one by one."""

# RTCRayHitN: arrays of N 32-bit numbers, in this order (rtcore_ray.h), and behind them the mask of valid rays
ORG_X, ORG_Y, ORG_Z, T_NEAR, DIR_X, DIR_Y, DIR_Z, TIME, T_FAR, MASK, ID, FLAGS = range(12)
NG_X, NG_Y, NG_Z, HIT_U, HIT_V, PRIM_ID, GEOM_ID, INST_ID, INST_PRIM_ID = range(12, 21)
VALID, PACKET_FIELDS = 21, 24  # two more than there are: a single ray's record stays aligned to 16 bytes

# behind the packets: RTCIntersectArguments, then a RTCRayQueryContext that ends with the block's address and a record
ARGUMENTS = PACKET_FIELDS * LANES  # in 32-bit words: flags, features, context, filter, callback, minimal width
CONTEXT = ARGUMENTS + 16
BLOCK_OF_CONTEXT = 1  # in 64-bit words from the context's start: instance ids, block
RECORD = CONTEXT + 4  # sixteen ints: the face that the filter has let pass for each lane, -1 for none
LEFT_FACE = RECORD + LANES  # sixteen ints: the triangle that each lane's ray starts from, -1 for none
SINGLE = -(-(LEFT_FACE + LANES) // 16) * 16  # one RTCRayHit, for rays that go alone
SCRATCH_WORDS = SINGLE + PACKET_FIELDS
_INVOKE_FILTER, _COHERENT, _ALL_FEATURES = 1 << 1, 1 << 16, -1

SAME_WAY, SAME_PLACE = 0.98, 0.02
"""Rays go together within 11 degrees of the first, from within a hundredth of the scene's size."""


def width() -> int:
    """Rays a packet: sixteen need AVX-512; without it Embree would take a packet of sixteen apart into single rays."""
    return 16 if llvmlite.binding.get_host_cpu_features().get("avx512f") else 8


@intrinsic
def _call(typing, function, valid, scene, packet, arguments):
    """rtcIntersectN or rtcOccludedN at address `function`."""

    def generate(context, builder, signature, values):
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word] * 4)
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return context.get_dummy_value()

    return types.void(*[types.int64] * 5), generate


@intrinsic
def _call_single(typing, function, scene, ray, arguments):
    """rtcIntersect1 at address `function`."""

    def generate(context, builder, signature, values):
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word] * 3)
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return context.get_dummy_value()

    return types.void(*[types.int64] * 4), generate


@inline
def scratch(block, size):
    """The address of a block's scratch memory; `size` is that of its numbers in bytes."""
    return block + at.SCRATCH_FIRST * LANES * size


@inline
def place_of(lane, wide):
    """Where the first field of a lane lies, in words, with packets of `wide` rays; field f is `wide` f words further."""
    i = np.int64(lane)
    return i // wide * (PACKET_FIELDS * wide) + i % wide


@inline
def together(place, wide):
    """Whether the valid rays of all packets go much the same way from much the same place, as a camera's do. Most blocks
    fail at the second ray, so the test costs little where it does not help."""
    packet, words = pointer(place, np.float32), pointer(place, np.int32)
    first = np.int64(-1)
    for k in range(LANES):
        i = place_of(np.uint64(k), wide)
        if fetch(words, i + VALID * wide) == 0:
            continue
        if first < 0:
            first = i
        along, apart = np.float32(0), np.float32(0)
        for axis in range(3):
            along += fetch(packet, i + (DIR_X + axis) * wide) * fetch(packet, first + (DIR_X + axis) * wide)
            apart += abs(fetch(packet, i + (ORG_X + axis) * wide) - fetch(packet, first + (ORG_X + axis) * wide))
        if along < np.float32(SAME_WAY) or apart > np.float32(SAME_PLACE):
            return False
    return True


@inline
def ask(world, query, scene, place, block, wide, filtered, coherent, mixed=True, vertex_bytes=0):
    """Traces the valid rays of all packets at address `place` in the scene of slot `scene`. `coherent` says that they go
    together: then Embree walks its tree once for all of a packet, 1.7 times as fast for camera rays in cornell_box, and
    half as fast for rays that go all ways. In a large tree those that ask for the closest hit are taken out of their
    packets and go one by one; with `vertex_bytes`, those of a vertex, the memory that the surface stage will want of what
    one has hit is asked for while the next go."""
    words, longs = pointer(place, np.int32), pointer(place, np.int64)
    keep(words, ARGUMENTS, np.int32((_INVOKE_FILTER if filtered else 0) | (_COHERENT if coherent else 0)))
    keep(words, ARGUMENTS + 1, np.int32(_ALL_FEATURES))
    keep(longs, ARGUMENTS // 2 + 1, place + CONTEXT * 4)
    keep(longs, ARGUMENTS // 2 + 2, count(world, FILTER) if filtered else np.int64(0))
    keep(longs, ARGUMENTS // 2 + 3, np.int64(0))
    keep(longs, ARGUMENTS // 2 + 4, np.int64(0))
    keep(longs, CONTEXT // 2, np.int64(-1))
    keep(longs, CONTEXT // 2 + BLOCK_OF_CONTEXT, block)
    if query == INTERSECT and not coherent and count(world, LARGE) != 0:
        before = np.int64(-1)
        for k in range(LANES):
            i = place_of(k, wide)
            if fetch(words, i + VALID * wide) != 0:
                _ask_one(world, scene, place, i, wide)
                if vertex_bytes > 0:
                    before = _ask_ahead(world, words, i, wide, before, mixed, vertex_bytes)
        return
    for first in range(0, LANES, wide):
        packet = place + first * (PACKET_FIELDS * 4)
        _call(count(world, query), packet + VALID * wide * 4, count(world, scene), packet, place + ARGUMENTS * 4)


@inline
def _ask_one(world, scene, place, i, wide):
    """Traces the ray whose first field lies at word i of the packets, and puts there what Embree says of it."""
    words = pointer(place, np.int32)
    for field in range(VALID):
        keep(words, SINGLE + field, fetch(words, i + field * wide))
    _call_single(count(world, INTERSECT_ONE), count(world, scene), place + SINGLE * 4, place + ARGUMENTS * 4)
    keep(words, i + T_FAR * wide, fetch(words, np.int64(SINGLE + T_FAR)))
    keep(words, i + PRIM_ID * wide, fetch(words, np.int64(SINGLE + PRIM_ID)))
    keep(words, i + GEOM_ID * wide, fetch(words, np.int64(SINGLE + GEOM_ID)))


@inline
def _ask_ahead(world, words, i, wide, before, mixed, vertex_bytes):
    """Asks for the row and the rank of the triangle hit (returned, -1 for none), and for what those of the one `before` lead
    to, which have arrived by now. Without other shapes, which `mixed` says, a rank is a face."""
    faces, ranks = count(world, TRIANGLES), count(world, TRIANGLE_RANK)
    face = np.int64(fetch(words, i + PRIM_ID * wide)) if fetch(words, i + GEOM_ID * wide) == 0 else np.int64(-1)
    if face >= 0:
        prefetch(faces + 12 * face)
        if mixed:
            prefetch(ranks + 4 * face)
    if before >= 0:
        rank = np.int64(fetch(pointer(ranks, np.int32), before)) if mixed else before
        prefetch(count(world, PRIMITIVES) + 4 * PRIMITIVE_INTS * rank)
        for corner in range(3):
            vertex = np.int64(fetch(pointer(faces, np.int32), 3 * before + corner))
            prefetch(count(world, VERTICES) + vertex_bytes * vertex)
    return face


@inline
def fill(lanes, world, place, fields, wide, upwards, real):
    """Copies the lanes' rays, of `fields` (origin, direction, t_max), into packets; a lane without a ray is not valid.
    `upwards` is at least 1 and widens t_max, where what lies beyond is sorted out afterwards."""
    packet, words = pointer(place, np.float32), pointer(place, np.int32)
    scale = real(fetch(table(world, SCALE, np.float64), 0))
    for first in range(0, LANES, wide):
        base = first * PACKET_FIELDS
        for lane in range(np.uint64(first), np.uint64(first + wide)):
            i = base + np.int64(lane) - first
            o, d, t = at.get3(lanes, fields[0], lane), at.get3(lanes, fields[1], lane), get(lanes, fields[2], lane)
            keep(packet, i + ORG_X * wide, np.float32(o.x * scale))
            keep(packet, i + ORG_Y * wide, np.float32(o.y * scale))
            keep(packet, i + ORG_Z * wide, np.float32(o.z * scale))
            keep(packet, i + DIR_X * wide, np.float32(d.x))
            keep(packet, i + DIR_Y * wide, np.float32(d.y))
            keep(packet, i + DIR_Z * wide, np.float32(d.z))
            keep(packet, i + T_NEAR * wide, np.float32(0))
            keep(packet, i + TIME * wide, np.float32(0))
            keep(packet, i + T_FAR * wide, np.float32(t * scale) * upwards)
        for lane in range(np.uint64(first), np.uint64(first + wide)):
            i = base + np.int64(lane) - first
            keep(words, i + MASK * wide, np.int32(-1))
            keep(words, i + ID * wide, np.int32(lane))
            keep(words, i + FLAGS * wide, np.int32(0))
            keep(words, i + GEOM_ID * wide, np.int32(-1))
            keep(words, i + INST_ID * wide, np.int32(-1))
            keep(words, i + INST_PRIM_ID * wide, np.int32(-1))
            keep(words, i + VALID * wide, np.int32(-1) if get(lanes, fields[2], lane) > 0 else np.int32(0))
            keep(words, RECORD + np.int64(lane), np.int32(-1))
