"""Shapes that are no triangles as triangles, in world space: for renderers that have none, or not these."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.scene import BLACK, Cylinder, Disk, Plane
from engines.scene.frames import tangents
from engines.scene.procedural.solids import tessellated_sphere
from engines.scene.tessellate import Triangles, cylinder, disk

Array = NDArray[np.float64]
Faces = NDArray[np.int32]


def sphere_mesh(subdivisions: int) -> tuple[Array, Faces]:
    """Vertices, which are the normals too, and 20 * 4^`subdivisions` faces of a unit sphere."""
    made = tessellated_sphere(subdivisions, BLACK, 1.0)
    return made.vertices, made.faces


def squares(plane: Plane, half_sides: ArrayLike) -> tuple[Array, Faces]:
    """Vertices and faces of a square about a plane's point, of the first half side, and of rings that end at the following."""
    halves = np.atleast_1d(np.asarray(half_sides, np.float64))
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * halves[:, None, None]
    vertices = plane.point + square.reshape(-1, 2) @ np.stack(tangents(np.array(plane.normal)))
    inner = 4 * np.arange(len(halves) - 1)[:, None] + np.arange(4)
    following = np.roll(inner, -1, axis=1)
    sides = [[inner, inner + 4, following + 4], [inner, following + 4, following]]
    around = np.concatenate([np.stack(side, axis=-1).reshape(-1, 3) for side in sides])
    return vertices, np.concatenate([[[0, 1, 2], [0, 2, 3]], around]).astype(np.int32)


def disk_mesh(shape: Disk, segments: int, same_area: bool = False) -> Triangles:
    """The triangles between the center of a disk and a polygon within it, or one of the `same_area`."""
    step = 2.0 * np.pi / segments
    radius = shape.radius * np.sqrt(step / np.sin(step)) if same_area else shape.radius
    u, v = tangents(np.array(shape.normal))
    return _placed(disk(segments), radius * u, radius * v, np.array(shape.normal), shape.center)


def cylinder_mesh(shape: Cylinder, segments: int) -> Triangles:
    """A prism within a cylinder, open at both ends, with the normals of the cylinder."""
    axis = np.subtract(shape.p1, shape.p0)
    u, v = tangents(axis / np.linalg.norm(axis))
    made = cylinder(segments)
    placed = _placed(made, shape.radius * u, shape.radius * v, axis, shape.p0)
    assert made.normals is not None
    return placed._replace(normals=made.normals @ np.stack([u, v, np.zeros(3)]))


def _placed(made: Triangles, x: Array, y: Array, z: Array, origin: ArrayLike) -> Triangles:
    """The triangles with the images of axes and origin that are given."""
    return made._replace(vertices=made.vertices @ np.stack([x, y, z]) + np.asarray(origin))
