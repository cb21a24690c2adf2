"""A bounding volume hierarchy over triangles and spheres, walked by one ray at a time: near child first, pruned by the
nearest hit so far, on a stack that keeps distances."""

from __future__ import annotations

import time
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels import block as at
from engines.kernels.jit import (
    LANES,
    compile_stage,
    const,
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
from engines.kernels.linear import closest_planes, occluded_planes
from engines.kernels.vector import Vec3
from engines.kernels.world import ACCELERATOR, SPHERE_RANK, SPHERES, TRIANGLE_RANK, TRIANGLES, Needs, World
from engines.numba_cpu.accel import bvh_build
from engines.numba_cpu.accel.primitives import ball_distance, boxes, corner_distance, corners, ray_of

NODES, CHILDREN, CORNERS, RANKS, WHICH = (ACCELERATOR + k for k in range(5))
STACK = bvh_build.STACK
NOTHING = -(2**62)


class Accelerator:
    """Nodes, and the primitives copied in the order of the leaves."""

    name = "bvh"
    precision = None
    scratch = 4 * STACK

    def __init__(self, options: Any) -> None:
        self.build_seconds = 0.0
        self._bytes = 0

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        box = boxes(world)
        n, triangles = len(box), len(world.arrays[TRIANGLES])
        order = np.empty(n, np.int32)
        nodes, children = np.empty((max(n, 1), 12), world.real), np.empty((max(n, 1), 2), np.int32)
        used = bvh_build.build(box, order, nodes, children)
        ranks = np.concatenate([world.arrays[TRIANGLE_RANK], world.arrays[SPHERE_RANK]])
        flat = np.zeros((n, 9), world.real)
        is_triangle = order < triangles
        flat[is_triangle] = corners(world)[order[is_triangle]]
        arrays = {
            NODES: nodes[:used].copy(), CHILDREN: children[:used].copy(), CORNERS: flat, RANKS: ranks[order],
            WHICH: np.where(is_triangle, -1, order - triangles).astype(np.int32),
        }  # fmt: skip
        for slot, array in arrays.items():
            world.bind(slot, array)
        self._bytes = sum(array.nbytes for array in arrays.values())
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return self._bytes

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        return stages(needs.triangles, needs.spheres, needs.planes, real)


class Tree(NamedTuple):
    """Pointers to the accelerator's arrays and to the lane's stack."""

    nodes: Any
    children: Any
    corners: Any
    ranks: Any
    which: Any
    spheres: Any
    far_stack: Any
    node_stack: Any


@inline
def _higher(a, b):
    return select(a > b, a, b)


@inline
def _lower(a, b):
    return select(a < b, a, b)


@inline
def _through_box(nodes, base, planes, first, last, ray, t):
    """(near, far) of the ray in a box of six numbers; missed where near > far. `first` and `last` are the ray's origin,
    moved back and forth by its slack, which widens the box at no cost."""
    x0, x1 = (
        (fetch(nodes, base + planes[0]) - first.x) * ray.inverse.x,
        (fetch(nodes, base + planes[3]) - last.x) * ray.inverse.x,
    )
    y0, y1 = (
        (fetch(nodes, base + planes[1]) - first.y) * ray.inverse.y,
        (fetch(nodes, base + planes[4]) - last.y) * ray.inverse.y,
    )
    z0, z1 = (
        (fetch(nodes, base + planes[2]) - first.z) * ray.inverse.z,
        (fetch(nodes, base + planes[5]) - last.z) * ray.inverse.z,
    )
    return _higher(_higher(x0, y0), _higher(z0, const(0.0, t))), _lower(_lower(x1, y1), _lower(z1, t))


@inline
def _walk(ray, t, left, tree, triangles, spheres, any_hit, widen, real):
    """(distance, rank) of the closest hit nearer than t, or with `any_hit` of any such; rank -1 for none."""
    rank = np.int64(-1)
    nx, ny, nz = ray.inverse.x < real(0), ray.inverse.y < real(0), ray.inverse.z < real(0)
    planes = (3 if nx else 0, 4 if ny else 1, 5 if nz else 2, 0 if nx else 3, 1 if ny else 4, 2 if nz else 5)
    slack = Vec3(-ray.slack if nx else ray.slack, -ray.slack if ny else ray.slack, -ray.slack if nz else ray.slack)
    origin_near, origin_far = ray.o + slack, ray.o - slack
    top, node = 0, np.int64(0)
    while True:
        if node >= 0:
            near0, far0 = _through_box(tree.nodes, node * 12, planes, origin_near, origin_far, ray, t)
            near1, far1 = _through_box(tree.nodes, node * 12 + 6, planes, origin_near, origin_far, ray, t)
            hit0, hit1 = near0 <= far0 * widen, near1 <= far1 * widen
            child0, child1 = np.int64(fetch(tree.children, 2 * node)), np.int64(fetch(tree.children, 2 * node + 1))
            if hit0 and hit1:  # the nearer child now, the other one later
                swap = near1 < near0
                keep(tree.far_stack, top, near0 if swap else near1)
                keep(tree.node_stack, top, np.int32(child0 if swap else child1))
                top += 1
                node = child1 if swap else child0
                continue
            if hit0 or hit1:
                node = child0 if hit0 else child1
                continue
        else:
            start = (-1 - node) >> 4
            for k in range(start, start + ((-1 - node) & 15)):
                this = np.int64(fetch(tree.ranks, k))
                distance, valid = t, False
                if triangles and (not spheres or fetch(tree.which, k) < 0):
                    distance = corner_distance(ray, tree.corners, k)
                    valid = distance > real(0) and this != left
                if spheres and (not triangles or fetch(tree.which, k) >= 0):
                    distance = ball_distance(ray, tree.spheres, np.int64(fetch(tree.which, k)), real)
                    valid = True
                if valid and (distance < t or (distance == t and this < rank)):
                    t, rank = distance, this
                    if any_hit:
                        return t, rank
        node = NOTHING
        while top > 0 and node == NOTHING:
            top -= 1
            if fetch(tree.far_stack, top) <= t * widen:
                node = np.int64(fetch(tree.node_stack, top))
        if node == NOTHING:
            return t, rank


def _make(triangles: bool, spheres: bool, planes: bool, shadow: bool, real: Any) -> Any:
    size, eps = np.dtype(real).itemsize, float(np.finfo(real).eps)
    widen = real(1 + 16 * eps)
    origin, direction, reach = (
        (at.SHADOW_ORIGIN, at.TO_LIGHT, at.SHADOW_T) if shadow else (at.ORIGIN, at.DIRECTION, at.T)
    )

    def stage(block, world):
        lanes = pointer(block, real)
        tree = Tree(
            table(world, NODES, real), table(world, CHILDREN, np.int32), table(world, CORNERS, real),
            table(world, RANKS, np.int32), table(world, WHICH, np.int32), table(world, SPHERES, np.float64),
            pointer(block + at.SCRATCH_FIRST * LANES * size, real),
            pointer(block + (at.SCRATCH_FIRST * LANES + STACK) * size, np.int32),
        )  # fmt: skip
        for lane in range(np.uint64(LANES)):
            t = get(lanes, reach, lane)
            rank = np.int64(-1)
            if (triangles or spheres) and t > real(0):
                ray = ray_of(lanes, lane, origin, direction, eps, real)
                left = np.int64(get_int(lanes, at.LEFT, lane))
                t, rank = _walk(ray, t, left, tree, triangles, spheres, shadow, widen, real)
            if shadow:
                put_int(lanes, at.OCCLUDED, lane, 1 if rank >= 0 else 0)
            else:
                put(lanes, at.T, lane, t)
                put_int(lanes, at.RANK, lane, rank)
        if planes:
            if shadow:
                occluded_planes(lanes, world, real)
            else:
                closest_planes(lanes, world, real)

    return stage


@cache
def stages(triangles: bool, spheres: bool, planes: bool, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))
