"""No tree: every triangle against sixteen rays at once. For small scenes nothing is faster.

Triangles are tested in chunks, of one shape where that is not tiny, and small enough for the first cache. Where no ray of the
batch meets the box of a chunk, it is left out. Else its vertices are sheared into each ray's frame once and shared by the
triangles around them; then a triangle costs three edge functions and a division, all in vector code.
"""

from __future__ import annotations

import time
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.records import REAL, Row, Table, real, rows, scalar, table_view, vector, vectors
from engines.kernels.compile.values import const, keep_scalar, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import FlatScene
from engines.kernels.lane.shapes.triangle import Shear, ray_frame, shear, triangle_distance
from engines.kernels.lane.vector import Vec3, extent
from engines.kernels.layout import ACCELERATOR, LANES, RayBatch, SceneTable, ray_batch, scene_table
from engines.kernels.rows import TriangleRow
from engines.kernels.stages.instances import enter, leave
from engines.kernels.stages.linear import (
    block_shadow,
    closest_planes,
    closest_spheres,
    make_analytic_test,
    may_meet,
    occluded_planes,
    occluded_spheres,
)
from engines.numba_cpu.accel.primitives import PAD_ULPS, clear_hits, finite_inverse, padding

CHUNK = 64
"""Triangles a chunk: at most 192 vertices of 3 x 16 numbers, 36 KiB in float32."""
INVERSE = 3 * CHUNK * 3 * LANES
"""Where in the scratch memory, behind the vertices, lie the inverse directions."""
INNER = INVERSE + 3 * LANES
"""Where there are instances, the batch of the rays in one of them lies here, in numbers."""
SCRATCH = INNER + RayBatch.bytes(np.float32) // np.dtype(np.float32).itemsize
BOX_COST, CHUNK_COST = 2.5, 4.0
"""In tests of a triangle: the test of a chunk's box; what a chunk costs besides its triangles, for frames and vertices."""
INDEPENDENT = 4
"""Some ray of a batch meets a box as likely as one of so many random lines through the scene's box does."""


class ChunkRow(Row):
    """Where a chunk's vertices and faces begin; they end where the next chunk's do. And whether its box is worth a test."""

    dtype = np.int64
    vertex = real()
    face = real()
    bounded = real()


class BoxRow(Row):
    """The lowest and the highest corner, padded."""

    lowest = vector()
    highest = vector()


class PartRow(Row):
    """Where the chunks, spheres and analytic shapes of a part begin; they end where the next part's do."""

    dtype = np.int64
    chunk = real()
    sphere = real()
    analytic = real()


class ListTable(Table, first=ACCELERATOR):
    n_chunks = scalar()  # outside of groups
    parts = rows(PartRow)  # what is outside of groups, each group, and one more
    chunks = rows(ChunkRow)  # one more than there are
    vertices = vectors(REAL)  # of each chunk by itself
    faces = rows(TriangleRow)  # indices of vertices in the chunk
    boxes = rows(BoxRow)  # of the chunks


list_table = table_view(ListTable)


class Accelerator:
    """Lists of vertices and faces, chunk by chunk."""

    name = "none"
    precision = None
    scratch = SCRATCH
    instances = True

    def __init__(self, options: Any) -> None:
        self.build_seconds, self.bytes = 0.0, 0

    def build(self, flat: FlatScene, threads: int) -> None:
        start = time.perf_counter()
        chunks, corners, local, boxes = [(0, 0, 0)], [np.zeros((0, 3), flat.real)], [np.zeros((0, 3), np.int32)], []
        parts = []
        for number, begin in enumerate(flat.begins):
            parts.append((len(boxes), begin.spheres, begin.analytic))
            if begin is flat.begins[-1]:
                break
            part = flat.part(number)
            faces, vertices = part.arrays[SceneTable.triangles], part.arrays[SceneTable.vertices]
            shapes = np.searchsorted(flat.first_id, part.arrays[SceneTable.triangle_primitives], side="right")
            whole, triangles, pad = _area(np.ptp(part.bounds, axis=0)), vertices[faces], padding(part)
            ends = triangles.min(axis=1).astype(np.float64), triangles.max(axis=1).astype(np.float64)
            for chunk in _chunks(shapes, *ends, whole):
                own, index = np.unique(vertices[faces[chunk.first : chunk.last]].reshape(-1, 3), axis=0, return_inverse=True)
                corners.append(own)
                local.append(index.reshape(-1, 3).astype(np.int32))
                chunks[-1] = (*chunks[-1][:2], int(chunk.bounded(whole)))
                chunks.append((chunks[-1][0] + len(own), chunks[-1][1] + len(local[-1]), 0))
                boxes.append((own.min(axis=0) - pad, own.max(axis=0) + pad))
        flat.bind(ListTable.parts, np.array(parts, np.int64))
        flat.bind(ListTable.n_chunks, parts[1][0])
        flat.bind(ListTable.chunks, np.array(chunks, np.int64))
        flat.bind(ListTable.vertices, np.concatenate(corners))
        flat.bind(ListTable.faces, np.concatenate(local))
        flat.bind(ListTable.boxes, np.reshape(boxes, (-1, BoxRow.size)).astype(flat.real))
        self.build_seconds = time.perf_counter() - start

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]:
        return stages(features.triangles, features.spheres, features.planes, features.analytic, features.instances, real)


def _area(size: Any) -> float:
    """Half the area of a box."""
    return float(size[0] * size[1] + size[1] * size[2] + size[2] * size[0])


class Chunk(NamedTuple):
    """Triangles first .. last - 1 and their box."""

    first: int
    last: int
    lowest: Any
    highest: Any

    def joined(self, other: Chunk) -> Chunk:
        """This one with its successor."""
        lowest, highest = np.minimum(self.lowest, other.lowest), np.maximum(self.highest, other.highest)
        return Chunk(self.first, other.last, lowest, highest)

    def _tested(self, whole: float) -> float:
        """What a batch is expected to cost, in tests of a triangle, if the box is tested."""
        share = min(_area(self.highest - self.lowest) / whole, 1.0) if whole > 0.0 else 1.0
        return BOX_COST + (1.0 - (1.0 - share) ** INDEPENDENT) * self._untested

    @property
    def _untested(self) -> float:
        return CHUNK_COST + self.last - self.first

    def bounded(self, whole: float) -> bool:
        """Whether the test of the box pays, in a scene whose box has the area `whole`."""
        return self._tested(whole) < self._untested

    def cost(self, whole: float) -> float:
        """As of `_tested`, if the box is tested where that pays."""
        return min(self._tested(whole), self._untested)


def _chunks(shape: Any, lowest: Any, highest: Any, whole: float) -> list[Chunk]:
    """The chunks, of the shape and the box of each triangle; shapes are in ascending order. Neighbours are joined where both
    together cost no more."""
    edges = [0, *(np.flatnonzero(np.diff(shape)) + 1), len(shape)]
    found: list[Chunk] = []
    for start, end in pairwise(edges):
        for first in range(start, end, CHUNK):
            last = min(first + CHUNK, end)
            chunk = Chunk(first, last, lowest[first:last].min(axis=0), highest[first:last].max(axis=0))
            both = found[-1].joined(chunk) if found else chunk
            few = found and both.last - both.first <= CHUNK
            if few and both.cost(whole) <= found[-1].cost(whole) + chunk.cost(whole):
                found[-1] = both
            else:
                found.append(chunk)
    return found


@inline
def _invert(scratch, direction, real):
    for lane in range(np.uint64(LANES)):
        d, i = direction[lane], INVERSE + np.int64(lane)
        scratch[i] = finite_inverse(d.x, real(1e-18))
        scratch[i + LANES] = finite_inverse(d.y, real(1e-18))
        scratch[i + 2 * LANES] = finite_inverse(d.z, real(1e-18))


@inline
def _clip(o, inverse, lowest, highest, shift, near, far):
    """The stretch of a ray between `near` and `far` within a slab, widened by `shift` on both sides."""
    one, two = (lowest - o - shift) * inverse, (highest - o + shift) * inverse
    first, last = select(one < two, one, two), select(one < two, two, one)
    return select(first > near, first, near), select(last < far, last, far)


@inline
def _some_meet(scratch, origin, end, box, shift_share, end_share):
    """Whether some ray of the batch may meet a box before its end; widened by what rounding may shift."""
    lowest, highest, found = box.lowest, box.highest, np.int32(0)
    for lane in range(np.uint64(LANES)):
        o, i = origin[lane], INVERSE + np.int64(lane)
        shift, near, far = extent(o) * shift_share, const(0.0, shift_share), end[lane]
        near, far = _clip(o.x, scratch[i], lowest.x, highest.x, shift, near, far)
        near, far = _clip(o.y, scratch[i + LANES], lowest.y, highest.y, shift, near, far)
        near, far = _clip(o.z, scratch[i + 2 * LANES], lowest.z, highest.z, shift, near, far)
        found |= np.int32(1 if near <= far * end_share else 0)
    return found != 0


@inline
def _make_frames(rays, direction):
    for lane in range(np.uint64(LANES)):
        frame = ray_frame(direction[lane])
        rays.shear_x[lane] = frame.x
        rays.shear_y[lane] = frame.y
        rays.shear_z[lane] = frame.z


@inline
def _shear_vertices(rays, sheared, vertices, first, last, origin):
    for k in range(first, last):
        vertex = vertices[k]
        place = (k - first) * (3 * LANES)
        for lane in range(np.uint64(LANES)):
            frame = Shear(rays.shear_x[lane], rays.shear_y[lane], rays.shear_z[lane])
            p = shear(frame, vertex - origin[lane])
            sheared[place + np.int64(lane)] = p.x
            sheared[place + LANES + np.int64(lane)] = p.y
            sheared[place + 2 * LANES + np.int64(lane)] = p.z


@inline
def _sheared_vertex(sheared, place, lane):
    i = place + np.int64(lane)
    return Vec3(sheared[i], sheared[i + LANES], sheared[i + 2 * LANES])


@inline
def _take(rays, lane, t, primitive, shadow, zero):
    """Takes a distance of a triangle, inf or NaN where it was missed. Ids ascend, so of equals the first stays."""
    if shadow:
        block_shadow(rays, lane, t, (t > zero) & may_meet(rays, lane, primitive))
    else:
        nearest, found = rays.t[lane], rays.primitive[lane]
        better = (t > zero) & (t < nearest) & may_meet(rays, lane, primitive)
        rays.t[lane] = select(better, t, nearest)
        rays.primitive[lane] = select(better, np.int64(primitive), found)


@cache
def _make_test_triangles(shadow: bool, real: Any) -> Any:
    """The function (rays, scene, own, sheared, first, last) that tests a batch against the chunks first .. last - 1."""
    eps = np.finfo(real).eps
    shift_share, end_share = real(PAD_ULPS * eps), real(1 + PAD_ULPS * eps)

    @inline
    def test_triangles(rays, scene, own, sheared, first, last):
        if shadow:
            origin, direction, end = rays.shadow.origin, rays.shadow.direction, rays.shadow.t_max
        else:
            origin, direction, end = rays.origin, rays.direction, rays.t
        chunks, vertices, faces, primitives = own.chunks, own.vertices, own.faces, scene.triangle_primitives
        boxes, framed = own.boxes, False
        _invert(sheared, direction, real)
        for k in range(first, last):
            if chunks[k].bounded != 0 and not _some_meet(sheared, origin, end, boxes[k], shift_share, end_share):
                continue
            if not framed:
                _make_frames(rays, direction)
                framed = True
            _shear_vertices(rays, sheared, vertices, chunks[k].vertex, chunks[k + 1].vertex, origin)
            for f in range(chunks[k].face, chunks[k + 1].face):
                a, b, c = (3 * LANES * np.int64(faces[f].a), 3 * LANES * np.int64(faces[f].b), 3 * LANES * np.int64(faces[f].c))
                primitive = primitives[f]
                for lane in range(np.uint64(LANES)):
                    t = triangle_distance(
                        _sheared_vertex(sheared, a, lane), _sheared_vertex(sheared, b, lane), _sheared_vertex(sheared, c, lane)
                    )
                    _take(rays, lane, t, primitive, shadow, real(0))

    return test_triangles


@cache
def _make_test_instances(triangles: bool, spheres: bool, analytic: tuple[int, ...], shadow: bool, real: Any) -> Any:
    """The function (rays, inner, scene, own, sheared) that tests a batch against all instances, in each as batch `inner`."""
    test_triangles, test_analytic = _make_test_triangles(shadow, real), make_analytic_test(analytic, shadow)

    @inline
    def test_instances(rays, inner, scene, own, sheared):
        for i in range(scene.n_instances):
            for lane in range(np.uint64(LANES)):
                keep_scalar()
                enter(rays, inner, scene, lane, i, shadow, real)
            group = np.int64(scene.instances[i].group)
            part, behind = own.parts[group + 1], own.parts[group + 2]
            if triangles:
                test_triangles(inner, scene, own, sheared, part.chunk, behind.chunk)
            if spheres and shadow:
                occluded_spheres(inner, scene, part.sphere, behind.sphere, real)
            elif spheres:
                closest_spheres(inner, scene, part.sphere, behind.sphere, real)
            test_analytic(inner, scene, part.analytic, behind.analytic, real)
            for lane in range(np.uint64(LANES)):
                keep_scalar()
                leave(rays, inner, scene, lane, shadow, real)

    return test_instances


def _make(
    triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], instances: bool, shadow: bool, real: Any
) -> Any:
    scratch = RayBatch.bytes(real)
    inner_batch = scratch + INNER * np.dtype(real).itemsize
    test_analytic = make_analytic_test(analytic, shadow)
    test_triangles = _make_test_triangles(shadow, real)
    test_instances = _make_test_instances(triangles, spheres, analytic, shadow, real) if instances else None

    def stage(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        own, sheared = list_table(scene_address, real), array_at(batch + scratch, real)
        clear_hits(rays, shadow, instances)
        if triangles:
            test_triangles(rays, scene, own, sheared, 0, own.n_chunks)
        if shadow:
            if spheres:
                occluded_spheres(rays, scene, 0, scene.n_spheres, real)
            if planes:
                occluded_planes(rays, scene, real)
        else:
            if spheres:
                closest_spheres(rays, scene, 0, scene.n_spheres, real)
            if planes:
                closest_planes(rays, scene, real, False)
        test_analytic(rays, scene, 0, scene.n_analytic, real)
        if instances:
            test_instances(rays, ray_batch(batch + inner_batch, real), scene, own, sheared)

    return stage


@cache
def stages(
    triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], instances: bool, real: Any
) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes, analytic, instances)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))
