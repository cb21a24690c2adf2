"""Triangles through embreex's batch class, in float32; spheres and planes are not its business."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.shapes import Triangles
from engines.numpy_reference.vectors import Array, Indices, Mask, dot

SLACK = 1e-3
"""How far outside a triangle, in barycentric weights, a hit may lie in float64: float32 cannot see edges exactly, but
on slivers embreex reports hits that are far away from them."""


class BatchTriangles:
    """A part of a tracer. Of a hit only the triangle is taken from embreex; t is computed anew, in float64.

    Shadow rays are traced as closest hits: OCCLUDED does not give the triangle, without which a hit cannot be checked.
    """

    nbytes = 0  # embreex does not report it

    def __init__(self, triangles: Triangles, robust: bool) -> None:
        self._triangles = triangles
        self._center = _center(*triangles.bounds())
        corners = np.stack([(corner - self._center).T for corner in (triangles.a, triangles.b, triangles.c)], axis=1)
        self._scene = EmbreeScene(robust=robust)
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(corners, np.float32))
        self._query(np.zeros((3, 1)), np.ones((3, 1)), np.ones(1))  # the first query builds the tree

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower id."""
        check()
        found = self._query(origin, direction, nearest.t)
        lanes = np.flatnonzero(found >= 0)
        hit, origin, direction = found[lanes], origin.take(lanes, axis=1), direction.take(lanes, axis=1)
        normal, corner = self._triangles.normal.take(hit, axis=1), self._triangles.a.take(hit, axis=1)
        t = dot(normal, corner - origin) / dot(normal, direction)
        v, w = self._triangles.barycentric(hit, origin, direction)
        inside = np.minimum(np.minimum(v, w), 1.0 - v - w) >= -SLACK
        met = self._triangles.primitive_id[hit] != nearest.origin_primitive[lanes]
        good = np.flatnonzero(inside & met & (t > 0.0) & (t < np.inf))
        nearest.offer(lanes[good], t[good], self._triangles.primitive_id[hit[good]])

    def occluded(self, origin: Array, direction: Array, before: Nearest, check: Callable[[], None]) -> Mask:
        """(n,) whether anything lies in (0, before.t); overwrites `before`."""
        self.closest(origin, direction, before, check)
        return before.primitive_id >= 0

    def _query(self, origin: Array, direction: Array, t_max: Array) -> Indices:
        """(n,) triangles that rays (3, n) hit before `t_max`, -1 for none."""
        if not t_max.size:
            return np.zeros(0, np.int64)
        with np.errstate(over="ignore"):
            start, way = (np.ascontiguousarray(array.T, np.float32) for array in (origin - self._center, direction))
            return self._scene.run(start, way, dists=t_max.astype(np.float32), query="INTERSECT")


def _center(low: Array, high: Array) -> Array:
    """(3, 1) near the middle of all boxes, in whole steps of a power of two above their extent: 0 for a mesh around
    the origin, and what is subtracted elsewhere costs the corners no digits."""
    low, high = low.min(axis=1, keepdims=True), high.max(axis=1, keepdims=True)
    step = 4.0 * 2.0 ** np.ceil(np.log2((high - low).max()))
    return step * np.rint(0.5 * (low + high) / step)
