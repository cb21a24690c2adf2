"""What a ray finds: the point, its normals, which side was met, and where rays that leave it start."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.geometry import PLANE, SPHERE, TRIANGLE, Geometry
from engines.numpy_reference.nearest import Nearest
from engines.numpy_reference.vectors import Array, Indices, Mask, dot, norm, unit


class Surface(NamedTuple):
    """n points that rays have hit. Both normals are unit and on the side that the ray came from."""

    point: Array
    geometric: Array
    """(3, n) normal of the shape itself."""
    normal: Array
    """(3, n) shading normal: interpolated on smooth meshes, else the geometric one."""
    front: Mask
    """(n,) whether the ray met the front: the counter-clockwise side, the outside, the side of a plane's normal."""
    material: Indices
    rank: Indices
    offset: Array
    """(n,) metres between the surface and the origins of rays that leave it."""

    def take(self, lanes: Indices) -> Surface:
        """The surface at some of the points."""
        return Surface(*(field.take(lanes, axis=-1) for field in self))

    def leave(self, inwards: bool = False) -> Array:
        """(3, n) origins of rays that leave on the side where the ray came from, or on the other one."""
        return self.point + (-self.offset if inwards else self.offset) * self.geometric


def surface_at(geometry: Geometry, origin: Array, direction: Array, hits: Nearest, offset: float) -> Surface:
    """The surface where rays (3, n) hit; every one of them must have hit something. `offset` is the tracer's."""
    point = origin + hits.t * direction
    outward = geometric_normals(geometry, point, hits.rank)
    front = dot(direction, outward) < 0.0
    geometric = np.where(front, outward, -outward)
    shading = _shading_normals(geometry, origin, direction, hits.rank, outward)
    normal = np.where(dot(shading, geometric) < 0.0, -shading, shading)
    normal = np.where(dot(direction, normal) < 0.0, normal, geometric)  # one that the viewer cannot see will not do
    reach = np.maximum(np.maximum(np.abs(point).max(axis=0), np.abs(origin).max(axis=0)), hits.t)
    ball = np.flatnonzero(geometry.kind[hits.rank] == SPHERE)
    reach[ball] = np.maximum(reach[ball], geometry.spheres.radius[geometry.index[hits.rank[ball]]])
    return Surface(point, geometric, normal, front, geometry.material[hits.rank], hits.rank, offset * reach)


def geometric_normals(geometry: Geometry, point: Array, rank: Indices) -> Array:
    """(3, n) unit normals on the front side of the primitives `rank`, at points on them."""
    kind, index = geometry.kind[rank], geometry.index[rank]
    normal = np.empty_like(point)
    for which, normals in ((PLANE, geometry.planes.normal), (TRIANGLE, geometry.triangles.normal)):
        lanes = np.flatnonzero(kind == which)
        normal[:, lanes] = normals.take(index[lanes], axis=1)
    lanes = np.flatnonzero(kind == SPHERE)
    normal[:, lanes] = unit(point.take(lanes, axis=1) - geometry.spheres.center.take(index[lanes], axis=1))
    return normal


def barycentric(geometry: Geometry, origin: Array, direction: Array, rank: Indices) -> tuple[Array, Array]:
    """(n,) weights of the second and third vertex where rays hit triangles; 0 on other shapes and for rank -1."""
    triangles = geometry.triangles
    u, v = np.zeros(rank.size), np.zeros(rank.size)
    lanes = np.flatnonzero((rank >= 0) & (geometry.kind[rank] == TRIANGLE)) if geometry.kind.size else rank[:0]
    copies, rays = triangles.rays(origin.take(lanes, axis=1), direction.take(lanes, axis=1))
    corners = triangles.data[copies, :, geometry.index[rank[lanes]]].T
    u[lanes], v[lanes] = triangles.barycentric(corners, rays)
    return u, v


def _shading_normals(geometry: Geometry, origin: Array, direction: Array, rank: Indices, flat: Array) -> Array:
    """The normals of the vertices, interpolated, where a mesh has them; elsewhere `flat`, as where they cancel out."""
    corners = geometry.triangles.vertex_normals
    if corners is None:
        return flat
    lanes = np.flatnonzero(geometry.kind[rank] == TRIANGLE)
    u, v = barycentric(geometry, origin.take(lanes, axis=1), direction.take(lanes, axis=1), rank[lanes])
    a, b, c = corners.take(geometry.index[rank[lanes]], axis=2)
    bent = (1.0 - u - v) * a + u * b + v * c
    good = norm(bent) > 0.0  # false for NaN: a flat mesh
    normal = flat.copy()
    normal[:, lanes[good]] = unit(bent[:, good])
    return normal
