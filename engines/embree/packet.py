"""Embree's ray packets, kept in a batch's scratch memory: their layout, how a batch's rays get there, and the queries.

Rays enter Embree in float32, scaled so that the scene is about as large as 1: coordinates of 1e-20 or 1e18 leave its
range. The scale is a power of two, so it rounds nothing. `memory` is the address of the scratch memory, `width` the
rays of a packet.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.memory import address_of, array_at, prefetch
from engines.kernels.compile.processor import has_feature
from engines.kernels.compile.records import LANES, Row, Table, array, real, rows, scalar, table_view
from engines.kernels.compile.values import call_function
from engines.kernels.layout import ACCELERATOR


class ScaleRow(Row):
    dtype = np.float64
    scale = real()  # the power of two that makes the scene, or the group, about as large as 1
    inverse = real()
    padding = real()  # of bounding boxes, in the scene's unit
    of_rays = real()  # `scale` of the scene


class EmbreeTable(Table, first=ACCELERATOR):
    """The accelerator's part of the scene's table."""

    intersect = scalar()  # addresses of rtcIntersect8 or rtcIntersect16, and so on
    intersect_one = scalar()
    occluded = scalar()
    tree = scalar()  # an RTCScene, as is the next
    exact_tree = scalar()  # whose triangles are solved in float64
    filter = scalar()  # address of `callbacks.hit_filter`
    scaling = rows(ScaleRow)  # one
    one_by_one = scalar()  # 1 where closest hits of incoherent rays are found ray by ray
    whole = scalar()  # address of the scene's table, in that of a group too
    begins = array(np.int32)  # of each group: its first triangle, sphere and analytic shape among the scene's


embree_table = table_view(EmbreeTable)

# RTCRayHitN: arrays of N 32-bit numbers, in this order (rtcore_ray.h), and behind them the mask of valid rays
ORG_X, ORG_Y, ORG_Z, T_NEAR, DIR_X, DIR_Y, DIR_Z, TIME, T_FAR, MASK, ID, FLAGS = range(12)
NG_X, NG_Y, NG_Z, HIT_U, HIT_V, PRIM_ID, GEOM_ID, INST_ID, INST_PRIM_ID = range(12, 21)
VALID, PACKET_FIELDS = 21, 24  # two more than there are: a single ray's record stays aligned to 16 bytes

# behind the packets, in 32-bit words: RTCIntersectArguments (flags, features, context, filter, callback, minimal width),
# then a RTCRayQueryContext that ends with the batch's address, and what the filter reads and writes
ARGUMENTS = PACKET_FIELDS * LANES
CONTEXT = ARGUMENTS + 16
BATCH_OF_CONTEXT = 1  # in 64-bit words from the context's start: instance ids, batch
CANDIDATE = (
    CONTEXT + 4
)  # sixteen ints: the face that the filter has let pass for each lane, -1 for none; then a mark of each lane
ORIGIN_FACE = CANDIDATE + LANES  # sixteen ints: the triangle that each lane's ray starts from, -1 for none
CANDIDATE_INSTANCE, ORIGIN_INSTANCE = ORIGIN_FACE + LANES, ORIGIN_FACE + 2 * LANES  # their geometries, -1 outside of groups
SINGLE = -(-(ORIGIN_INSTANCE + LANES) // 16) * 16  # one RTCRayHit, for rays that are traced alone
SCRATCH_WORDS = SINGLE + PACKET_FIELDS
_INVOKE_FILTER, _COHERENT, _ALL_FEATURES = 1 << 1, 1 << 16, -1

MIN_COSINE, MAX_DISTANCE = 0.98, 0.02
"""Rays are coherent within 11 degrees of the first, from within a hundredth of the scene's size."""


class Rays(NamedTuple):
    """Fields of a batch that make its rays, each indexed by lane."""

    origin: Any
    direction: Any
    t_max: Any


@inline
def path_rays(batch):
    return Rays(batch.origin, batch.direction, batch.t)


@inline
def shadow_rays(batch):
    return Rays(batch.shadow.origin, batch.shadow.direction, batch.shadow.t_max)


def packet_width() -> int:
    """Rays a packet: sixteen need AVX-512; without it Embree would take a packet of sixteen apart into single rays."""
    return 16 if has_feature("avx512f") else 8


@inline
def first_word(lane, width):
    """Where the first field of a lane lies, in words; field f is `width` f words further."""
    i = np.int64(lane)
    return i // width * (PACKET_FIELDS * width) + i % width


@inline
def are_coherent(memory, width):
    """Whether the valid rays of all packets go much the same way from much the same place, as a camera's do. Most
    batches fail at the second ray, so the test costs little where it does not help."""
    numbers, words = array_at(memory, np.float32), array_at(memory, np.int32)
    first = np.int64(-1)
    for k in range(LANES):
        i = first_word(np.uint64(k), width)
        if words[i + VALID * width] == 0:
            continue
        if first < 0:
            first = i
        cosine, distance = np.float32(0), np.float32(0)
        for axis in range(3):
            cosine += numbers[i + (DIR_X + axis) * width] * numbers[first + (DIR_X + axis) * width]
            distance += abs(numbers[i + (ORG_X + axis) * width] - numbers[first + (ORG_X + axis) * width])
        if cosine < np.float32(MIN_COSINE) or distance > np.float32(MAX_DISTANCE):
            return False
    return True


@inline
def _write_arguments(embree, memory, batch, filtered, coherent):
    words, longs = array_at(memory, np.int32), array_at(memory, np.int64)
    words[ARGUMENTS] = np.int32((_INVOKE_FILTER if filtered else 0) | (_COHERENT if coherent else 0))
    words[ARGUMENTS + 1] = np.int32(_ALL_FEATURES)
    longs[ARGUMENTS // 2 + 1] = memory + CONTEXT * 4
    longs[ARGUMENTS // 2 + 2] = embree.filter if filtered else np.int64(0)
    longs[ARGUMENTS // 2 + 3] = np.int64(0)
    longs[ARGUMENTS // 2 + 4] = np.int64(0)
    longs[CONTEXT // 2] = np.int64(-1)
    longs[CONTEXT // 2 + BATCH_OF_CONTEXT] = batch


@inline
def _query_packets(function, tree, memory, width):
    for first in range(0, LANES, width):
        packet = memory + first * (PACKET_FIELDS * 4)
        call_function(function, (packet + VALID * width * 4, tree, packet, memory + ARGUMENTS * 4))


@inline
def query_occluded(embree, tree, memory, batch, width, filtered):
    """Tests the valid rays of all packets against an RTCScene: T_FAR becomes -inf where something is hit."""
    _write_arguments(embree, memory, batch, filtered, False)
    _query_packets(embree.occluded, tree, memory, width)


@inline
def query_closest(scene, embree, tree, memory, batch, width, filtered, coherent, prefetching):
    """Finds the closest hits of the valid rays of all packets in an RTCScene. `coherent` rays let Embree walk its tree
    once for all of a packet, 1.7 times as fast for camera rays in cornell_box, and half as fast for rays that go all
    ways. In a large tree the others are taken out of their packets and traced one by one; with `prefetching` the memory
    that the surface stage reads of a hit is prefetched while the next ray is traced."""
    _write_arguments(embree, memory, batch, filtered, coherent)
    if not coherent and embree.one_by_one != 0:
        words, before = array_at(memory, np.int32), np.int64(-1)
        for k in range(LANES):
            i = first_word(k, width)
            if words[i + VALID * width] != 0:
                _query_one(embree, tree, memory, i, width)
                if prefetching.vertex_bytes > 0:
                    before = _prefetch(scene, words, i, width, before, prefetching)
        return
    _query_packets(embree.intersect, tree, memory, width)


@inline
def _query_one(embree, tree, memory, i, width):
    """Traces the ray whose first field lies at word i of the packets, and puts there what Embree finds."""
    words = array_at(memory, np.int32)
    for field in range(VALID):
        words[SINGLE + field] = words[i + field * width]
    call_function(embree.intersect_one, (tree, memory + SINGLE * 4, memory + ARGUMENTS * 4))
    words[i + T_FAR * width] = words[SINGLE + T_FAR]
    words[i + PRIM_ID * width] = words[SINGLE + PRIM_ID]
    words[i + GEOM_ID * width] = words[SINGLE + GEOM_ID]
    words[i + INST_ID * width] = words[SINGLE + INST_ID]


class Prefetching(NamedTuple):
    """Bytes of a vertex, 0 for no prefetching; and whether the scene holds other shapes than triangles: without them, a
    face's number is its id."""

    vertex_bytes: int
    mixed: bool


@inline
def _prefetch(scene, words, i, width, before, prefetching):
    """Prefetches the indices and the id of the triangle hit (returned, -1 for none), and what those of the one `before`
    lead to, which have arrived by now."""
    face = np.int64(words[i + PRIM_ID * width]) if words[i + GEOM_ID * width] == 0 else np.int64(-1)
    if face >= 0:
        prefetch(address_of(scene.triangles[face]))
        if prefetching.mixed:
            prefetch(address_of(scene.triangle_primitives) + 4 * face)
    if before >= 0:
        primitive = np.int64(scene.triangle_primitives[before]) if prefetching.mixed else before
        prefetch(address_of(scene.primitives[primitive]))
        row, vertices = scene.triangles[before], address_of(scene.vertices)
        for vertex in (row.a, row.b, row.c):
            prefetch(vertices + prefetching.vertex_bytes * np.int64(vertex))
    return face


@inline
def write_rays(rays, embree, memory, width, widening, real):
    """Copies the lanes' rays into packets; a lane without a ray is not valid. `widening` is at least 1 and widens
    t_max, where what lies beyond is sorted out afterwards."""
    numbers, words = array_at(memory, np.float32), array_at(memory, np.int32)
    scale = real(embree.scaling[0].scale)
    for first in range(0, LANES, width):
        base = first * PACKET_FIELDS
        for lane in range(np.uint64(first), np.uint64(first + width)):
            i = base + np.int64(lane) - first
            o, d, t = rays.origin[lane], rays.direction[lane], rays.t_max[lane]
            numbers[i + ORG_X * width] = np.float32(o.x * scale)
            numbers[i + ORG_Y * width] = np.float32(o.y * scale)
            numbers[i + ORG_Z * width] = np.float32(o.z * scale)
            numbers[i + DIR_X * width] = np.float32(d.x)
            numbers[i + DIR_Y * width] = np.float32(d.y)
            numbers[i + DIR_Z * width] = np.float32(d.z)
            numbers[i + T_NEAR * width] = np.float32(0)
            numbers[i + TIME * width] = np.float32(0)
            numbers[i + T_FAR * width] = np.float32(t * scale) * widening
            words[i + MASK * width] = np.int32(-1)
            words[i + ID * width] = np.int32(lane)
            words[i + FLAGS * width] = np.int32(0)
            words[i + GEOM_ID * width] = np.int32(-1)
            words[i + INST_ID * width] = np.int32(-1)
            words[i + INST_PRIM_ID * width] = np.int32(-1)
            words[i + VALID * width] = np.int32(-1) if t > 0 else np.int32(0)
            words[CANDIDATE + np.int64(lane)] = np.int32(-1)
