"""No tree: every triangle against sixteen rays at once. For small scenes nothing is faster.

Vertices are sheared into each ray's frame once and shared by the triangles around them, in chunks that fit the first
cache; then a triangle costs three edge functions and a division, all in vector code.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.records import REAL, Row, Table, real, rows, scalar, table_view, vectors
from engines.kernels.compile.values import select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import FlatScene
from engines.kernels.lane.shapes.triangle import Frame, ray_frame, shear, triangle_distance
from engines.kernels.lane.vector import Vec3
from engines.kernels.layout import ACCELERATOR, LANES, RayBatch, SceneTable, TriangleRow, ray_batch, scene_table
from engines.kernels.stages.linear import (
    block_shadow,
    closest_planes,
    closest_spheres,
    make_analytic_test,
    occluded_planes,
    occluded_spheres,
)
from engines.numba_cpu.accel.primitives import clear_hits

CHUNK = 64
"""Triangles a chunk: at most 192 vertices of 3 x 16 numbers, 36 KiB in float32."""
SCRATCH = 3 * CHUNK * 3 * LANES


class ChunkRow(Row):
    """Where a chunk's vertices and faces begin; they end where the next chunk's do."""

    dtype = np.int64
    vertex = real()
    face = real()


class ListTable(Table, first=ACCELERATOR):
    n_chunks = scalar()
    chunks = rows(ChunkRow)  # one more than there are
    vertices = vectors(REAL)  # of each chunk by itself
    faces = rows(TriangleRow)  # indices of vertices in the chunk


list_table = table_view(ListTable)


class Accelerator:
    """Lists of vertices and faces, chunk by chunk."""

    name = "none"
    precision = None
    scratch = SCRATCH

    def __init__(self, options: Any) -> None:
        self.build_seconds = 0.0

    def build(self, flat: FlatScene, threads: int) -> None:
        start = time.perf_counter()
        faces, vertices = flat.arrays[SceneTable.triangles], flat.arrays[SceneTable.vertices]
        chunks, corners, local = [(0, 0)], [np.zeros((0, 3), flat.real)], [np.zeros((0, 3), np.int32)]
        for first in range(0, len(faces), CHUNK):
            own, index = np.unique(vertices[faces[first : first + CHUNK]].reshape(-1, 3), axis=0, return_inverse=True)
            corners.append(own)
            local.append(index.reshape(-1, 3).astype(np.int32))
            chunks.append((chunks[-1][0] + len(own), chunks[-1][1] + len(local[-1])))
        flat.bind(ListTable.n_chunks, len(chunks) - 1)
        flat.bind(ListTable.chunks, np.array(chunks, np.int64))
        flat.bind(ListTable.vertices, np.concatenate(corners))
        flat.bind(ListTable.faces, np.concatenate(local))
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return 0

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]:
        return stages(features.triangles, features.spheres, features.planes, features.analytic, real)


@inline
def _make_frames(rays, direction):
    for lane in range(np.uint64(LANES)):
        frame = ray_frame(direction[lane])
        rays.frame_x[lane] = frame.x
        rays.frame_y[lane] = frame.y
        rays.frame_z[lane] = frame.z


@inline
def _shear_vertices(rays, sheared, vertices, first, last, origin):
    for k in range(first, last):
        vertex = vertices[k]
        place = (k - first) * (3 * LANES)
        for lane in range(np.uint64(LANES)):
            frame = Frame(rays.frame_x[lane], rays.frame_y[lane], rays.frame_z[lane])
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
        block_shadow(rays, lane, t, (t > zero) & (primitive != rays.origin_primitive[lane]))
    else:
        nearest, found = rays.t[lane], rays.primitive[lane]
        better = (t > zero) & (t < nearest) & (primitive != rays.origin_primitive[lane])
        rays.t[lane] = select(better, t, nearest)
        rays.primitive[lane] = select(better, np.int64(primitive), found)


def _make(triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], shadow: bool, real: Any) -> Any:
    scratch = RayBatch.bytes(real)
    test_analytic = make_analytic_test(analytic, shadow)

    def stage(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        if shadow:
            origin, direction = rays.shadow_origin, rays.wi
        else:
            origin, direction = rays.origin, rays.direction
        clear_hits(rays, shadow)
        if triangles:
            sheared, own = array_at(batch + scratch, real), list_table(scene_address, real)
            chunks, vertices, faces, primitives = own.chunks, own.vertices, own.faces, scene.triangle_primitives
            _make_frames(rays, direction)
            for k in range(own.n_chunks):
                _shear_vertices(rays, sheared, vertices, chunks[k].vertex, chunks[k + 1].vertex, origin)
                for f in range(chunks[k].face, chunks[k + 1].face):
                    a, b, c = (
                        3 * LANES * np.int64(faces[f].a),
                        3 * LANES * np.int64(faces[f].b),
                        3 * LANES * np.int64(faces[f].c),
                    )
                    primitive = primitives[f]
                    for lane in range(np.uint64(LANES)):
                        t = triangle_distance(
                            _sheared_vertex(sheared, a, lane),
                            _sheared_vertex(sheared, b, lane),
                            _sheared_vertex(sheared, c, lane),
                        )
                        _take(rays, lane, t, primitive, shadow, real(0))
        if shadow:
            if spheres:
                occluded_spheres(rays, scene, real)
            if planes:
                occluded_planes(rays, scene, real)
        else:
            if spheres:
                closest_spheres(rays, scene, real)
            if planes:
                closest_planes(rays, scene, real)
        test_analytic(rays, scene, real)

    return stage


@cache
def stages(triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes, analytic)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))
