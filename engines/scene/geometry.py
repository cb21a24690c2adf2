"""Geometry of triangles: normals, which have an area, fans of polygons, and vertex normals of a smooth mesh; read-only arrays.

A vertex normal of zeros says that there is none: `with_face_normals` gives each face its own there.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

CHUNK = 1 << 18
"""Faces handled at a time, so that temporaries stay small beside the mesh."""
UP = np.array([0.0, 1.0, 0.0])
"""The normal of what no ray can hit."""
CANCELLED = 1e-6
"""A sum of normals shorter than this share of their lengths has no direction but that of rounding."""

A = TypeVar("A", bound=NDArray[Any])


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
    """(n, 3) unit: area-weighted means of the adjacent faces; zeros where there is none, or where they cancel."""
    corners = vertices[faces]
    extent = np.abs(vertices).max(initial=1e-300)
    corners = corners / extent
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return summed_normals(faces, np.repeat(areas[:, None], 3, axis=1), len(vertices))


def angle_weighted_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """(n, 3) unit: adjacent faces' normals weighted with their angles at the vertex (Thürmer and Wüthrich 1998); zeros where
    they cancel."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    shares = np.empty((len(faces), 3, 3))
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
        shares[:, corner] = normals * angle[:, None]
    return summed_normals(faces, shares, len(vertices))


def summed_normals(faces: NDArray[np.int32], shares: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(count, 3) unit sums, at each vertex, of the `shares` (m, 3, 3) of faces at their corners; zeros where they cancel."""
    sums, lengths = np.zeros((count, 3)), np.zeros(count)
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(faces[:, corner], shares[:, corner, axis], count)
        lengths += np.bincount(faces[:, corner], np.linalg.norm(shares[:, corner], axis=1), count)
    sums[np.linalg.norm(sums, axis=1) <= CANCELLED * lengths] = 0.0
    return unit_rows(sums)


def unit_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) rows at length 1; rows of zeros stay as they are."""
    largest = np.abs(rows).max(axis=1, initial=0.0, keepdims=True)
    scaled = rows / np.where(largest > 0.0, largest, 1.0)
    return scaled / np.where(largest > 0.0, np.linalg.norm(scaled, axis=1, keepdims=True), 1.0)


def lacks_normal(normals: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) which rows are zeros."""
    return ~np.asarray(normals.any(axis=1))


def read_only(array: A) -> A:
    """The array, to which nobody may write any more."""
    array.flags.writeable = False
    return array


class Smooth(NamedTuple):
    """A mesh with a unit normal at each vertex. `replaced` counts the corners that have the normal of their face, and `copied`
    are the vertices of which copies stand behind the others."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64]
    uvs: NDArray[np.float64] | None
    replaced: int
    copied: NDArray[np.int32]


def with_face_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], normals: NDArray[np.float64], uvs: NDArray[np.float64] | None
) -> Smooth:
    """The mesh with a vertex of its own, and the normal of its face, for each corner whose normal is zeros."""
    lacking = lacks_normal(normals)
    if not lacking.any():
        return Smooth(vertices, faces, normals, uvs, 0, np.zeros(0, np.int32))
    face, corner = np.nonzero(lacking[faces])
    normals = np.where(lacking[:, None], UP, normals)  # of vertices that no face has any more
    own = unit_rows(face_normals(vertices, faces[face]))
    own[lacks_normal(own)] = UP
    vertex, faces = faces[face, corner], faces.copy()
    faces[face, corner] = np.arange(len(vertices), len(vertices) + len(face))
    more = None if uvs is None else np.concatenate([uvs, uvs[vertex]])
    apart, normals = np.concatenate([vertices, vertices[vertex]]), np.concatenate([normals, own])
    return Smooth(apart, faces, normals, more, len(face), vertex)


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
