"""Geometry of shapes: bounds, and of triangles which have area, fans, and vertex normals of a smooth mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.model import Disk, Mesh, Plane, Shape, Sphere, SphereSet, Triangle

CHUNK = 1 << 18
"""Faces handled at a time, so that temporaries stay small beside the mesh."""


def bounds(shape: Shape) -> NDArray[np.float64] | None:
    """(2, 3) lowest and highest coordinates; None for planes, which have none, and for meshes without faces."""
    if isinstance(shape, Plane):
        return None
    if isinstance(shape, Disk):
        reach = shape.radius * np.sqrt(np.maximum(0.0, 1.0 - np.square(shape.normal)))
        return np.stack([np.subtract(shape.center, reach), np.add(shape.center, reach)])
    if isinstance(shape, (Sphere, SphereSet)):
        centers, radii = (shape.center, shape.radius) if isinstance(shape, Sphere) else (shape.centers, shape.radii[:, None])
        low, high = np.atleast_2d(np.subtract(centers, radii)), np.atleast_2d(np.add(centers, radii))
        return np.stack([low.min(axis=0), high.max(axis=0)])
    is_triangle = isinstance(shape, Triangle)
    corners = np.array([shape.a, shape.b, shape.c]) if is_triangle else shape.vertices[np.unique(shape.faces)]
    return np.stack([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else None


def face_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """(m, 3) cross products (b - a) x (c - a) of the faces, each after scaling its edges to a largest component of 1.

    Zero exactly where a face has no area: scaling keeps tiny faces from underflow and huge ones from overflow.
    """
    normals = np.empty((len(faces), 3))
    for start in range(0, len(faces), CHUNK):
        corners = vertices[faces[start : start + CHUNK]]
        corners *= 0.25  # differences of the largest floats stay finite
        edges = corners[:, 1:] - corners[:, :1]
        largest = np.abs(edges).max(axis=(1, 2), initial=0.0)
        edges /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
        normals[start : start + CHUNK] = np.cross(edges[:, 0], edges[:, 1])
    return normals


def has_area(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(m,) whether each face has an area above zero."""
    return np.asarray(face_normals(vertices, faces).any(axis=1))


def vertex_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """(n, 3) unit: area-weighted means of the adjacent faces; (0, 1, 0) where there is none."""
    corners = vertices[faces]
    extent = np.abs(vertices).max(initial=1e-300)
    corners = corners / extent
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(vertices)
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(faces[:, corner], areas[:, axis], len(vertices))
    return unit_rows(sums)


def read_only_mesh(vertices: Any, faces: Any, materials: Any, normals: NDArray[np.float64] | None, name: str) -> Mesh:
    """The mesh of these arrays, or of copies in the types of `Mesh`; nobody may write to them any more."""
    vertices = np.ascontiguousarray(vertices, np.float64)
    faces, materials = np.ascontiguousarray(faces, np.int32), np.ascontiguousarray(materials, np.int32)
    for array in (vertices, faces, materials, *([] if normals is None else [normals])):
        array.flags.writeable = False
    return Mesh(vertices, faces, materials, normals, name)


def unit_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) rows at length 1; zero rows become (0, 1, 0)."""
    largest = np.abs(rows).max(axis=1, initial=0.0, keepdims=True)
    scaled = rows / np.where(largest > 0.0, largest, 1.0)
    scaled = np.where(largest > 0.0, scaled, np.array([0.0, 1.0, 0.0]))
    return scaled / np.linalg.norm(scaled, axis=1, keepdims=True)


def fans(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Polygons cut into fans of triangles. `counts` (n,) says how many corners each has; all corners stand in a row.

    Returns (m, 3) places in that row, and (m,) the polygon of each triangle. Less than 3 corners give no triangle.
    """
    triangles = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), triangles)
    first_corner, first_triangle = np.cumsum(counts) - counts, np.cumsum(triangles) - triangles
    step = np.arange(len(polygon)) - first_triangle[polygon]
    start = first_corner[polygon]
    return np.stack([start, start + step + 1, start + step + 2], axis=1), polygon
