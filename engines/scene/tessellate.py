"""Round shapes as triangles, and the triangles of Mitsuba's flat ones, with its texture coordinates. All are in local space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Triangles(NamedTuple):
    """`vertices` (n, 3), `faces` (m, 3) counter-clockwise from outside, `uvs` (n, 2), `normals` (n, 3) or None where flat."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    uvs: NDArray[np.float64]
    normals: NDArray[np.float64] | None


def rectangle() -> Triangles:
    """[-1, 1]^2 in the plane z = 0, towards +z."""
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    return Triangles(corners, np.array([[0, 1, 2], [2, 3, 0]], np.int32), (corners[:, :2] + 1.0) / 2.0, None)


def cube() -> Triangles:
    """[-1, 1]^3, each face with all of [0, 1]^2."""
    # the vertex with (u, v) = (0, 0) of each face, then the directions in which u and v grow
    frames = [
        ((-1, -1, -1), (0, 0, 1), (1, 0, 0)),
        ((1, 1, 1), (-1, 0, 0), (0, 0, -1)),
        ((1, -1, 1), (0, 1, 0), (0, 0, -1)),
        ((-1, -1, 1), (0, 1, 0), (1, 0, 0)),
        ((-1, -1, -1), (0, 1, 0), (0, 0, 1)),
        ((-1, 1, -1), (0, -1, 0), (1, 0, 0)),
    ]
    return _boxes(frames)


def _boxes(frames: list[tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]]) -> Triangles:
    vertices, uvs, faces = [], [], []
    for start, u, v in frames:
        corner, along_u, along_v = (np.array(vector, np.float64) for vector in (start, u, v))
        first = len(vertices)
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            vertices.append(corner + 2.0 * a * along_u + 2.0 * b * along_v)
            uvs.append((a, b))
        outwards = np.dot(np.cross(along_u, along_v), corner) > 0.0
        turns = ([0, 1, 2], [2, 3, 0]) if outwards else ([0, 2, 1], [2, 0, 3])
        faces += [[first + index for index in turn] for turn in turns]
    return Triangles(np.array(vertices), np.array(faces, np.int32), np.array(uvs, np.float64), None)


def sphere(segments: int, rings: int) -> Triangles:
    """The unit sphere, smooth: u around +z in `segments`, v from +z to -z in `rings`."""
    u, v = _grid(segments, rings)
    phi, theta = 2.0 * np.pi * u, np.pi * v
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return Triangles(points, _grid_faces(segments, rings, True, True)[:, ::-1].copy(), np.stack([u, v], axis=1), points.copy())


def disk(segments: int, rings: int = 1) -> Triangles:
    """The unit disk in the plane z = 0, towards +z: u from its center in `rings`, v around it in `segments`."""
    v, u = _grid(segments, rings)
    points = np.stack([u * np.cos(2.0 * np.pi * v), u * np.sin(2.0 * np.pi * v), np.zeros_like(u)], axis=1)
    return Triangles(points, _grid_faces(segments, rings, True)[:, ::-1].copy(), np.stack([u, v], axis=1), None)


def cylinder(segments: int) -> Triangles:
    """The side of the cylinder of radius 1 from z = 0 to z = 1, smooth: u around +z in `segments`, v along it."""
    u, v = _grid(segments, 1)
    outwards = np.stack([np.cos(2.0 * np.pi * u), np.sin(2.0 * np.pi * u), np.zeros_like(u)], axis=1)
    points = outwards + np.stack([np.zeros_like(v), np.zeros_like(v), v], axis=1)
    return Triangles(points, _grid_faces(segments, 1), np.stack([u, v], axis=1), outwards)


def _grid(columns: int, rows: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) places in [0, 1] along and across, column after column in each row."""
    across, along = np.meshgrid(np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 1.0, columns + 1), indexing="ij")
    return along.ravel(), across.ravel()


def _grid_faces(columns: int, rows: int, first_is_point: bool = False, last_is_point: bool = False) -> NDArray[np.int32]:
    """(m, 3) both triangles of each cell, along x across; one of a cell at a row that is a point."""
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    start = (row * (columns + 1) + column).ravel()
    right, below = start + 1, start + columns + 1
    upper, lower = np.stack([start, right, below + 1], axis=1), np.stack([start, below + 1, below], axis=1)
    halves = [upper[columns if first_is_point else 0 :], lower[: -columns if last_is_point else None]]
    return np.concatenate(halves).astype(np.int32)
