"""Triangles and the faces of meshes. Which rays meet them is the business of `watertight`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.shapes import watertight
from engines.numpy_reference.shapes.interface import LocalGeometry, ShapeSample, pdf_solid_angle
from engines.numpy_reference.vectors import Array, Indices, cross, dot, norm, unit
from engines.scene import Mesh, Triangle


class Triangles:
    """All triangles of a scene that have an area; the others keep their ids, but are never hit and never sampled.

    `a`, `b`, `c`, `normal` (3, m), the normal unit and on the front. `data` (3, 9, m) is that of `watertight`.
    """

    planar = True
    bounded = True
    separate_lights = False
    rays = staticmethod(watertight.rays)
    distance = staticmethod(watertight.distance)

    def __init__(self, shapes: Sequence[Triangle | Mesh], primitive_id: Indices) -> None:
        corners = np.concatenate([np.zeros((3, 3, 0)), *map(_corners, shapes)], axis=2)
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            normal = cross(corners[1] - corners[0], corners[2] - corners[0])
            largest = np.abs(normal).max(axis=0)
            good = np.flatnonzero((largest > 0.0) & np.isfinite(largest))
            area = 0.5 * largest * np.sqrt(((normal / largest) ** 2).sum(axis=0))
        self.primitive_id = primitive_id[good]
        self.a, self.b, self.c = corners[:, :, good]
        self.normal, self.area = unit(normal[:, good]), area[good]
        self.data = watertight.copies_by_axis(corners[:, :, good])
        self._vertex_normals = _vertex_normals(shapes, good)
        self._corners = corners.transpose(1, 0, 2).reshape(3, -1)

    @staticmethod
    def count(shape: Triangle | Mesh) -> int:
        return len(shape.faces) if isinstance(shape, Mesh) else 1

    def barycentric(self, index: Indices, origin: Array, direction: Array) -> tuple[Array, Array]:
        """(n,) weights of the second and third vertex where rays hit."""
        copies, rays = self.rays(origin, direction)
        return watertight.barycentric(self.data[copies, :, index].T, rays)

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """The first coordinate runs from the first vertex to the second."""
        normal = self.normal.take(index, axis=1)
        edge = self.b.take(index, axis=1) - self.a.take(index, axis=1)
        return LocalGeometry(normal, self._shading_normal(index, origin, direction, normal), edge, 0.0)

    def _shading_normal(self, index: Indices, origin: Array, direction: Array, flat: Array) -> Array:
        """The normals of the vertices, interpolated, where a mesh has them; elsewhere `flat`, as where they cancel out."""
        if self._vertex_normals is None:
            return flat
        u, v = self.barycentric(index, origin, direction)
        a, b, c = self._vertex_normals.take(index, axis=2)
        interpolated = (1.0 - u - v) * a + u * b + v * c
        return np.where(norm(interpolated) > 0.0, unit(interpolated), flat)  # false for NaN: a flat mesh

    def bounds(self) -> tuple[Array, Array]:
        return (
            np.minimum(np.minimum(self.a, self.b), self.c),
            np.maximum(np.maximum(self.a, self.b), self.c),
        )

    def corners(self) -> Array:
        return self._corners

    def sample(self, index: Indices, point: Array, u0: Array, u1: Array, area: Array) -> ShapeSample:
        """Uniform over the area."""
        a, b, c = (corner.take(index, axis=1) for corner in (self.a, self.b, self.c))
        su = np.sqrt(u0)
        to_shape = (1.0 - su) * a + su * (1.0 - u1) * b + su * u1 * c - point
        distance = norm(to_shape)
        wi = to_shape / distance
        cosine = -dot(wi, self.normal.take(index, axis=1))
        return ShapeSample(wi, distance, cosine > 0.0, pdf_solid_angle(distance, cosine, area))

    @staticmethod
    def pdf(index: Indices, point: Array, distance: Array, cosine: Array, area: Array) -> Array:
        return pdf_solid_angle(distance, cosine, area)


SHAPES = {Triangle: Triangles, Mesh: Triangles}


def _corners(shape: Triangle | Mesh) -> Array:
    """Positions of the corners: (vertex, axis, face)."""
    if isinstance(shape, Triangle):
        return np.array([shape.a, shape.b, shape.c])[:, :, None]
    return np.asarray(shape.vertices, np.float64)[np.asarray(shape.faces).T].transpose(0, 2, 1)


def _vertex_normals(shapes: Sequence[Triangle | Mesh], good: Indices) -> Array | None:
    """Normals of the corners of the faces `good`: (vertex, axis, face), NaN where flat; None where all are."""
    if not any(isinstance(shape, Mesh) and shape.normals is not None for shape in shapes):
        return None
    parts = []
    for shape in shapes:
        if isinstance(shape, Mesh) and shape.normals is not None:
            parts.append(np.asarray(shape.normals, np.float64)[np.asarray(shape.faces).T].transpose(0, 2, 1))
        else:
            parts.append(np.full((3, 3, Triangles.count(shape)), np.nan))
    return np.concatenate(parts, axis=2)[:, :, good]
