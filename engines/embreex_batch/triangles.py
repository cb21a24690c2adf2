"""Triangles through embreex's batch class, in float32; spheres and planes are not its business."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from engines.numpy_reference.nearest import Nearest
from engines.numpy_reference.triangle import Triangles
from engines.numpy_reference.vectors import Array, Indices, Mask, dot


class BatchTriangles:
    """A part of a tracer. The mesh is moved to the origin, where float32 has most digits.

    Of a hit only the triangle is taken from embreex: t is that of its plane, in float64.
    """

    nbytes = 0  # embreex does not tell

    def __init__(self, triangles: Triangles, robust: bool) -> None:
        self._triangles = triangles
        low, high = triangles.boxes()
        self._center = 0.5 * (low.min(axis=1) + high.max(axis=1))[:, None]
        corners = np.stack([(corner - self._center).T for corner in (triangles.a, triangles.b, triangles.c)], axis=1)
        self._scene = EmbreeScene(robust=robust)
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(corners, np.float32))
        self._ask(np.zeros((3, 1)), np.ones((3, 1)), np.ones(1), "OCCLUDED")  # the first query builds the tree

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower rank."""
        check()
        found = self._ask(origin, direction, nearest.t, "INTERSECT")
        lanes = np.flatnonzero(found >= 0)
        hit = found[lanes]
        normal, corner = self._triangles.normal.take(hit, axis=1), self._triangles.a.take(hit, axis=1)
        t = dot(normal, corner - origin.take(lanes, axis=1)) / dot(normal, direction.take(lanes, axis=1))
        good = np.flatnonzero((t > 0.0) & (t < np.inf))  # a plane that is met nowhere confirms no hit
        nearest.offer(lanes[good], t[good], self._triangles.rank[hit[good]])

    def occluded(self, origin: Array, direction: Array, t_max: Array, check: Callable[[], None]) -> Mask:
        """(n,) whether anything lies in (0, t_max)."""
        check()
        return self._ask(origin, direction, t_max, "OCCLUDED") >= 0

    def _ask(self, origin: Array, direction: Array, reach: Array, query: str) -> Indices:
        """(n,) int32 triangles that rays (3, n) hit before `reach`, -1 for none; under OCCLUDED any number for a hit."""
        if not reach.size:
            return np.zeros(0, np.int64)
        with np.errstate(over="ignore"):
            start, way = (np.ascontiguousarray(array.T, np.float32) for array in (origin - self._center, direction))
            return self._scene.run(start, way, dists=reach.astype(np.float32), query=query)
