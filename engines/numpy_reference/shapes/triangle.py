"""Triangles and the faces of meshes. Which rays meet them is the business of `watertight`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.shapes import watertight
from engines.numpy_reference.shapes.interface import LocalGeometry, Primitives, ShapeSample, TextureCoordinates, pdf_solid_angle
from engines.numpy_reference.vectors import Array, Indices, cross, dot, norm, unit
from engines.scene import Mesh, Triangle
from engines.scene.attributes import FACE


class Triangles(Primitives):
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
        self._vertex_normals = _of_corners(shapes, good, [getattr(shape, "normals", None) for shape in shapes])
        self._vertex_uvs = _of_corners(shapes, good, [getattr(shape, "uvs", None) for shape in shapes])
        self._attributes = _attributes(shapes, good)
        self._corners = corners.transpose(1, 0, 2).reshape(3, -1)

    @staticmethod
    def count(shape: Triangle | Mesh) -> int:
        return len(shape.faces) if isinstance(shape, Mesh) else 1

    def barycentric(self, index: Indices, origin: Array, direction: Array) -> tuple[Array, Array]:
        """(n,) weights of the second and third vertex where rays hit."""
        copies, rays = self.rays(origin, direction)
        return watertight.barycentric(self.data[copies, :, index].T, rays)

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """Without texture coordinates of its mesh, a face's first coordinate runs from the first vertex to the second."""
        normal, (dp_du, _) = self.normal.take(index, axis=1), self._derivatives(index)
        return LocalGeometry(normal, self._shading_normal(index, origin, direction, normal), dp_du, 0.0)

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """Those of the vertices, interpolated; the weights of the second and third vertex where the mesh has none."""
        u, v = self.barycentric(index, origin, direction)
        uv = np.stack([u, v])
        if self._vertex_uvs is not None:
            a, b, c = self._vertex_uvs.take(index, axis=2)
            uv = np.where(np.isnan(a), uv, (1.0 - u - v) * a + u * b + v * c)
        attributes = {}
        for name, of_corners in self._attributes.items():
            a, b, c = of_corners.take(index, axis=2)
            attributes[name] = (1.0 - u - v) * a + u * b + v * c
        return TextureCoordinates(uv, *self._derivatives(index), attributes)

    def _derivatives(self, index: Indices) -> tuple[Array, Array]:
        """dp/du and dp/dv, (3, n) each: the edges to the second and third vertex where the mesh has no texture coordinates,
        or has some that lie on a line."""
        a = self.a.take(index, axis=1)
        ab, ac = self.b.take(index, axis=1) - a, self.c.take(index, axis=1) - a
        if self._vertex_uvs is None:
            return ab, ac
        a, b, c = self._vertex_uvs.take(index, axis=2)
        (du1, dv1), (du2, dv2) = b - a, c - a
        determinant = du1 * dv2 - dv1 * du2
        plain = np.isnan(determinant) | (determinant == 0.0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            dp_du = np.where(plain, ab, (dv2 * ab - dv1 * ac) / determinant)
            return dp_du, np.where(plain, ac, (du1 * ac - du2 * ab) / determinant)

    def _shading_normal(self, index: Indices, origin: Array, direction: Array, flat: Array) -> Array:
        """The normals of the vertices, interpolated, where a mesh has them; elsewhere `flat`, as where they cancel out."""
        if self._vertex_normals is None:
            return flat
        u, v = self.barycentric(index, origin, direction)
        a, b, c = self._vertex_normals.take(index, axis=2)
        interpolated = (1.0 - u - v) * a + u * b + v * c
        return np.where(norm(interpolated) > 0.0, unit(interpolated), flat)  # false for NaN: a flat mesh

    def bounds(self) -> tuple[Array, Array]:
        return (np.minimum(np.minimum(self.a, self.b), self.c), np.maximum(np.maximum(self.a, self.b), self.c))

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


SHAPES = {Triangle: Triangles, Mesh: Triangles}


def _corners(shape: Triangle | Mesh) -> Array:
    """Positions of the corners: (vertex, axis, face)."""
    if isinstance(shape, Triangle):
        return np.array([shape.a, shape.b, shape.c])[:, :, None]
    return np.asarray(shape.vertices, np.float64)[np.asarray(shape.faces).T].transpose(0, 2, 1)


def _attributes(shapes: Sequence[Triangle | Mesh], good: Indices) -> dict[str, Array]:
    """By name, the attributes of meshes at the corners of the faces `good`: (vertex, 3, face), NaN where a mesh has none. One
    number is three."""
    found = {}
    for name in sorted({name for shape in shapes if isinstance(shape, Mesh) for name in shape.attributes}):
        given = [shape.attributes.get(name) if isinstance(shape, Mesh) else None for shape in shapes]
        wide = [None if values is None else np.broadcast_to(values, (len(values), 3)) for values in given]
        corners = _of_corners(shapes, good, wide, of_faces=name.startswith(FACE))
        assert corners is not None
        found[name] = corners
    return found


def _of_corners(
    shapes: Sequence[Triangle | Mesh], good: Indices, values: Sequence[Array | None], of_faces: bool = False
) -> Array | None:
    """What the vertices or faces of meshes have, at the corners of the faces `good`: (vertex, number, face), NaN where a
    mesh has none; None where all have none."""
    numbers = next((given.shape[1] for given in values if given is not None), 0)
    if not numbers:
        return None
    parts = []
    for shape, given in zip(shapes, values, strict=True):
        if isinstance(shape, Mesh) and given is not None:
            places = np.tile(np.arange(len(shape.faces)), (3, 1)) if of_faces else np.asarray(shape.faces).T
            parts.append(np.asarray(given, np.float64)[places].transpose(0, 2, 1))
        else:
            parts.append(np.full((3, numbers, Triangles.count(shape)), np.nan))
    return np.concatenate(parts, axis=2)[:, :, good]
