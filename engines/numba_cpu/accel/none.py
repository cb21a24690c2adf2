"""No tree: every triangle against sixteen rays at once. For small scenes nothing is faster.

Vertices are sheared into each ray's frame once and shared by the triangles around them, in chunks that fit the first
cache; then a triangle costs three edge functions and a division, all in vector code.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np

from engines.kernels import block as at
from engines.kernels.jit import (
    LANES,
    compile_stage,
    count,
    fetch,
    get,
    get_int,
    inline,
    keep,
    pointer,
    put,
    put_int,
    select,
    table,
)
from engines.kernels.linear import block_shadow, closest_planes, closest_spheres, occluded_planes, occluded_spheres
from engines.kernels.shapes import Frame, ray_frame, shear, triangle_distance
from engines.kernels.vector import Vec3
from engines.kernels.world import ACCELERATOR, TRIANGLE_RANK, TRIANGLES, VERTICES, Needs, World

CHUNKS, RANGES, CORNERS, FACES = (ACCELERATOR + k for k in range(4))
CHUNK = 64
"""Triangles a chunk: at most 192 vertices of 3 x 16 numbers, 36 KiB in float32."""
SCRATCH = 3 * CHUNK * 3 * LANES


class Accelerator:
    """Lists of vertices and faces, chunk by chunk."""

    name = "none"
    precision = None
    scratch = SCRATCH

    def __init__(self, options: Any) -> None:
        self.build_seconds = 0.0

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        faces, vertices = world.arrays[TRIANGLES], world.arrays[VERTICES]
        ranges, corners, local = [(0, 0)], [np.zeros((0, 3), world.real)], [np.zeros((0, 3), np.int32)]
        for first in range(0, len(faces), CHUNK):
            own, index = np.unique(vertices[faces[first : first + CHUNK]].reshape(-1, 3), axis=0, return_inverse=True)
            corners.append(own)
            local.append(index.reshape(-1, 3).astype(np.int32))
            ranges.append((ranges[-1][0] + len(own), ranges[-1][1] + len(local[-1])))
        world.bind(CHUNKS, len(ranges) - 1)
        world.bind(RANGES, np.array(ranges, np.int64))
        world.bind(CORNERS, np.concatenate(corners))
        world.bind(FACES, np.concatenate(local))
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return 0

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        return stages(needs.triangles, needs.spheres, needs.planes, real)


@inline
def _read_frame(lanes, lane):
    return Frame(at.get3(lanes, at.FRAME, lane), at.get3(lanes, at.FRAME + 3, lane), at.get3(lanes, at.FRAME + 6, lane))


@inline
def _make_frames(lanes, direction):
    for lane in range(np.uint64(LANES)):
        frame = ray_frame(at.get3(lanes, direction, lane))
        at.put3(lanes, at.FRAME, lane, frame.x)
        at.put3(lanes, at.FRAME + 3, lane, frame.y)
        at.put3(lanes, at.FRAME + 6, lane, frame.z)


@inline
def _shear_corners(lanes, scratch, corners, first, last, origin):
    for k in range(first, last):
        corner = Vec3(fetch(corners, 3 * k), fetch(corners, 3 * k + 1), fetch(corners, 3 * k + 2))
        place = (k - first) * (3 * LANES)
        for lane in range(np.uint64(LANES)):
            p = shear(_read_frame(lanes, lane), corner - at.get3(lanes, origin, lane))
            keep(scratch, place + np.int64(lane), p.x)
            keep(scratch, place + LANES + np.int64(lane), p.y)
            keep(scratch, place + 2 * LANES + np.int64(lane), p.z)


@inline
def _sheared(scratch, place, lane):
    i = place + np.int64(lane)
    return Vec3(fetch(scratch, i), fetch(scratch, i + LANES), fetch(scratch, i + 2 * LANES))


@inline
def _test(lanes, lane, t, rank, shadow, zero):
    """Takes a distance of the triangle `rank`, inf or NaN where it was missed. Ranks ascend, so of equals the first stays."""
    if shadow:
        block_shadow(lanes, lane, t, (t > zero) & (rank != get_int(lanes, at.LEFT, lane)))
    else:
        best, held = get(lanes, at.T, lane), get_int(lanes, at.RANK, lane)
        better = (t > zero) & (t < best) & (rank != get_int(lanes, at.LEFT, lane))
        put(lanes, at.T, lane, select(better, t, best))
        put_int(lanes, at.RANK, lane, select(better, held - held + rank, held))


def _make(triangles: bool, spheres: bool, planes: bool, shadow: bool, real: Any) -> Any:
    size = np.dtype(real).itemsize
    origin, direction = (at.SHADOW_ORIGIN, at.TO_LIGHT) if shadow else (at.ORIGIN, at.DIRECTION)

    def stage(block, world):
        lanes = pointer(block, real)
        for lane in range(np.uint64(LANES)):
            put_int(lanes, at.OCCLUDED if shadow else at.RANK, lane, 0 if shadow else -1)
        if triangles:
            scratch = pointer(block + at.SCRATCH_FIRST * LANES * size, real)
            ranges, corners = table(world, RANGES, np.int64), table(world, CORNERS, real)
            faces, ranks = table(world, FACES, np.int32), table(world, TRIANGLE_RANK, np.int32)
            _make_frames(lanes, direction)
            for chunk in range(count(world, CHUNKS)):
                _shear_corners(lanes, scratch, corners, fetch(ranges, 2 * chunk), fetch(ranges, 2 * chunk + 2), origin)
                for f in range(fetch(ranges, 2 * chunk + 1), fetch(ranges, 2 * chunk + 3)):
                    a, b, c = (
                        3 * LANES * np.int64(fetch(faces, 3 * f)),
                        3 * LANES * np.int64(fetch(faces, 3 * f + 1)),
                        3 * LANES * np.int64(fetch(faces, 3 * f + 2)),
                    )
                    rank = fetch(ranks, f)
                    for lane in range(np.uint64(LANES)):
                        t = triangle_distance(
                            _sheared(scratch, a, lane), _sheared(scratch, b, lane), _sheared(scratch, c, lane)
                        )
                        _test(lanes, lane, t, rank, shadow, real(0))
        if shadow:
            if spheres:
                occluded_spheres(lanes, world, real)
            if planes:
                occluded_planes(lanes, world, real)
        else:
            if spheres:
                closest_spheres(lanes, world, real)
            if planes:
                closest_planes(lanes, world, real)

    return stage


@cache
def stages(triangles: bool, spheres: bool, planes: bool, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))
