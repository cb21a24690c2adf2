"""The shapes of a scene as arrays: a table of all primitives in the scene's order, and one set for each kind.

The rank of a primitive is its place in the order (shape, primitive), which is also how ties in t are settled. Faces
without area keep their rank, but enter no set: they are never hit and never sampled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from engines.numpy_reference.plane import Planes
from engines.numpy_reference.sphere import Spheres
from engines.numpy_reference.triangle import Triangles
from engines.numpy_reference.vectors import Array, Indices, cross, unit
from engines.scene.model import Mesh, Plane, Shape, Sphere, SphereSet, Triangle

PLANE, SPHERE, TRIANGLE = range(3)
Corners = tuple[Array, Array | None]


class Geometry:
    """Per rank, (n,) each: `shape`, `primitive` (inside its shape), `material`, `kind`, and `index` in the set of its
    kind (-1 for a face without area). Sets: `planes`, `spheres`, `triangles`."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        counts = [_count(shape) for shape in shapes]
        self.first_rank = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        """Rank of the first primitive of each shape, and their number at the end."""
        self.shape = np.repeat(np.arange(len(shapes)), counts)
        self.primitive = np.arange(self.shape.size) - self.first_rank[self.shape]
        self.material = _joined([_materials(shape) for shape in shapes], np.int64)
        self.kind = np.repeat(np.array([_kind(shape) for shape in shapes], np.int64), counts)
        self.index = np.full(self.shape.size, -1)
        self.planes = self._planes([s for s in shapes if isinstance(s, Plane)])
        self.spheres = self._spheres([s for s in shapes if isinstance(s, Sphere | SphereSet)])
        self.triangles, corners = self._triangles([s for s in shapes if isinstance(s, Triangle | Mesh)])
        centers, radii = self.spheres.center, self.spheres.radius
        reach = np.concatenate([corners.transpose(1, 0, 2).reshape(3, -1), centers - radii, centers + radii], axis=1)
        self.upper_corner: Array | None = reach.max(axis=1) if reach.size else None
        """(3,) upper corner of the box around all finite shapes, or None where there is none."""

    def _planes(self, planes: list[Plane]) -> Planes:
        rank = self._enter(np.flatnonzero(self.kind == PLANE))
        return Planes(_columns(p.point for p in planes), unit(_columns(p.normal for p in planes)), rank)

    def _spheres(self, shapes: list[Sphere | SphereSet]) -> Spheres:
        rank = self._enter(np.flatnonzero(self.kind == SPHERE))
        centers = [s.centers if isinstance(s, SphereSet) else np.array([s.center]) for s in shapes]
        radii = [s.radii if isinstance(s, SphereSet) else np.array([s.radius]) for s in shapes]
        return Spheres(np.concatenate([np.zeros((0, 3)), *centers]).T.copy(), _joined(radii, np.float64), rank)

    def _triangles(self, shapes: list[Triangle | Mesh]) -> tuple[Triangles, Array]:
        """The faces that have an area, and the corners (3, 3, m), by vertex and axis, of all."""
        parts = [_corners(shape) for shape in shapes]
        corners = np.concatenate([np.zeros((3, 3, 0)), *(part[0] for part in parts)], axis=2)
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            normal = cross(corners[1] - corners[0], corners[2] - corners[0])
            largest = np.abs(normal).max(axis=0)
            good = np.flatnonzero((largest > 0.0) & np.isfinite(largest))
            area = 0.5 * largest * np.sqrt(((normal / largest) ** 2).sum(axis=0))
        rank = self._enter(np.flatnonzero(self.kind == TRIANGLE)[good])
        smooth = None
        if any(part[1] is not None for part in parts):
            flat = [np.full_like(part[0], np.nan) if part[1] is None else part[1] for part in parts]
            smooth = np.concatenate(flat, axis=2)[:, :, good]
        return Triangles(corners[:, :, good], unit(normal[:, good]), area[good], smooth, rank), corners

    def _enter(self, rank: Indices) -> Indices:
        self.index[rank] = np.arange(rank.size)
        return rank


def _kind(shape: Shape) -> int:
    if isinstance(shape, Plane):
        return PLANE
    return SPHERE if isinstance(shape, Sphere | SphereSet) else TRIANGLE


def _count(shape: Shape) -> int:
    if isinstance(shape, Mesh):
        return len(shape.faces)
    return len(shape.radii) if isinstance(shape, SphereSet) else 1


def _materials(shape: Shape) -> Array:
    return np.asarray(shape.materials) if isinstance(shape, Mesh) else np.full(_count(shape), shape.material)


def _corners(shape: Triangle | Mesh) -> Corners:
    """Positions and, where the mesh is smooth, normals of the corners: (vertex, axis, face)."""
    if isinstance(shape, Triangle):
        return np.array([shape.a, shape.b, shape.c])[:, :, None], None
    by_corner = np.asarray(shape.faces).T
    positions = np.asarray(shape.vertices, np.float64)[by_corner].transpose(0, 2, 1)
    normals = None if shape.normals is None else np.asarray(shape.normals, np.float64)[by_corner].transpose(0, 2, 1)
    return positions, normals


def _columns(triples: Iterable[Sequence[float]]) -> Array:
    return np.array(list(triples), np.float64).reshape(-1, 3).T.copy()


def _joined(parts: list, dtype: type) -> np.ndarray:
    return np.concatenate([np.zeros(0, dtype), *parts]).astype(dtype)
