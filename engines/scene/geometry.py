"""Geometry of triangles: normals, which have an area, fans of polygons, and vertex normals of a smooth mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CHUNK = 1 << 18
"""Faces handled at a time, so that temporaries stay small beside the mesh."""


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
