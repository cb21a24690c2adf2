"""Shapes as arrays: triangles, spheres, planes, and the other shapes that have a formula (`ANALYTIC`).

An analytic shape is `SHAPE_PARAMETERS` float64 numbers and a module of lane functions. One that is registered here is found by
every accelerator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import kernel
from engines.kernels.lane.shapes import cylinder, disk
from engines.kernels.rows import SHAPE_PARAMETERS, UVRow
from engines.scene import Cylinder, Disk, Instance, Mesh, MeshAttribute, Plane, Sphere, SphereSet, Triangle, groups_of

TRIANGLE, SPHERE, PLANE, DISK, CYLINDER = range(5)

Reals = NDArray[np.float64]


class AnalyticShape(NamedTuple):
    """How a shape of the model becomes parameters (positions relative to `center`), and its bounding box."""

    kind: int
    parameters: Callable[[Any, Reals], list[float]]
    """(shape, center) -> numbers"""
    bounds: Callable[[Reals], tuple[Reals, Reals]]
    """Parameters (n, SHAPE_PARAMETERS) -> lowest and highest coordinates (n, 3)."""
    lane: Any
    """Its module of `engines.kernels.lane.shapes`: `distance`, `intersection`, and `coordinates` of a point of it."""
    curved: bool = False
    """Whether a ray that leaves one may meet it again."""


def _disk(shape: Disk, center: Reals) -> list[float]:
    return [*np.subtract(shape.center, center), *shape.normal, shape.radius]


def _cylinder(shape: Cylinder, center: Reals) -> list[float]:
    return [*np.subtract(shape.p0, center), *np.subtract(shape.p1, shape.p0), shape.radius]


ANALYTIC: dict[type, AnalyticShape] = {
    Disk: AnalyticShape(DISK, _disk, disk.bounds, disk),
    Cylinder: AnalyticShape(CYLINDER, _cylinder, cylinder.bounds, cylinder, curved=True),
}


def analytic_shape(kind: int) -> AnalyticShape:
    """The registered shape of a kind."""
    return next(shape for shape in ANALYTIC.values() if shape.kind == kind)


def outside(shapes: Any) -> list[Any]:
    """The shapes outside of groups: those that are no instances."""
    return [shape for shape in shapes if not isinstance(shape, Instance)]


class Begin(NamedTuple):
    """Where the arrays begin of the shapes outside of groups, and of each group."""

    vertices: int
    triangles: int
    spheres: int
    analytic: int
    primitives: int


class Geometry:
    """The shapes of a scene, collected in order, those outside of groups first, then those of each group; primitives of each
    kind in the order of their ids."""

    def __init__(self, shapes: Any) -> None:
        self.vertices: list[Any] = [np.zeros((0, 3))]
        self.normals: list[Any] = [np.zeros((0, 3))]
        self.uvs: list[tuple[int, Any]] = []
        """Of each mesh and triangle: how many vertices, and their texture coordinates or None."""
        self.attributes: list[tuple[int, int, Any]] = []
        """Of each mesh and triangle: its first vertex, its first triangle, and its attributes by name."""
        self.faces: list[Any] = [np.zeros((0, 3), np.int32)]
        self.spheres: list[Any] = [np.zeros((0, 4))]
        self.planes: list[Any] = [np.zeros((0, 6))]
        self.analytic: list[Any] = []
        self.ids: dict[str, list[Any]] = {name: [np.zeros(0, np.int32)] for name in _COLUMNS}
        self.material: list[Any] = [np.zeros(0, np.int64)]
        self.kind: list[Any] = [np.zeros(0, np.int64)]
        self.index: list[Any] = [np.zeros(0, np.int64)]
        self.first_id: list[int] = []
        """Of each shape that is no instance."""
        self._on_uvs: list[Any] = []
        self.n = 0
        self.n_vertices = 0
        self.counts = dict.fromkeys(_COLUMNS, 0)
        self.groups = groups_of(shapes)
        self.instances = [shape for shape in shapes if isinstance(shape, Instance)]
        self.begins: list[Begin] = []
        """Of the shapes outside of groups, of each group, and of what would come next."""
        for part in (outside(shapes), *(group.shapes for group in self.groups), ()):
            self.begins.append(Begin(self.n_vertices, *(self.counts[name] for name in _BOUNDED), self.n))
            for shape in part:
                self.first_id.append(self.n)
                self._add(shape)

    @staticmethod
    def joined(parts: list[Any]) -> NDArray[Any]:
        """All parts in one array; a single one that is not empty is not copied."""
        filled = [part for part in parts if len(part)] or parts[:1]
        return filled[0] if len(filled) == 1 else np.concatenate(filled)

    def _add(self, shape: Any) -> None:
        if isinstance(shape, Plane):
            self.planes.append(np.array([[*shape.point, *shape.normal]]))
            self._primitives("planes", PLANE, 1, shape.material)
        elif isinstance(shape, Sphere):
            self.spheres.append(np.array([[*shape.center, shape.radius]]))
            self._primitives("spheres", SPHERE, 1, shape.material)
        elif isinstance(shape, SphereSet):
            self.spheres.append(np.column_stack([shape.centers, shape.radii]))
            self._primitives("spheres", SPHERE, len(shape.radii), shape.material)
        elif isinstance(shape, Triangle):
            self._triangles(np.array([shape.a, shape.b, shape.c]), None, None, {}, np.array([[0, 1, 2]]), shape.material)
        elif isinstance(shape, Mesh):
            arrays = shape.vertices, shape.normals, shape.uvs, shape.attributes, shape.faces
            self._triangles(*arrays, shape.materials)
            if shape.uvs is not None:
                self._on_uvs.append(np.unique(shape.materials))
        else:
            self.analytic.append(shape)
            self._primitives("analytic", ANALYTIC[type(shape)].kind, 1, shape.material)

    def _triangles(self, vertices: Any, normals: Any, uvs: Any, attributes: Any, faces: Any, material: Any) -> None:
        self.vertices.append(vertices)
        self.normals.append(np.zeros((len(vertices), 3)) if normals is None else normals)
        self.uvs.append((len(vertices), uvs))
        self.attributes.append((self.n_vertices, self.counts["triangles"], attributes))
        faces = np.asarray(faces, np.int32)
        self.faces.append(faces + np.int32(self.n_vertices) if self.n_vertices else faces)
        self.n_vertices += len(vertices)
        self._primitives("triangles", TRIANGLE, len(faces), material)

    def _primitives(self, column: str, kind: int, n: int, material: Any) -> None:
        first = self.counts[column]
        self.ids[column].append(np.arange(self.n, self.n + n, dtype=np.int32))
        self.material.append(np.broadcast_to(np.asarray(material, np.int64), (n,)))
        self.kind.append(np.full(n, kind, np.int8))
        self.index.append(np.arange(first, first + n, dtype=np.int32))
        self.counts[column] += n
        self.n += n

    def materials_on_uvs(self) -> set[int]:
        """The materials of faces of meshes that have texture coordinates."""
        return {int(index) for indices in self._on_uvs for index in indices}

    def uv_rows(self) -> Reals:
        """(vertices, numbers of a row)."""
        rows = np.zeros((self.n_vertices, UVRow.size))
        first = 0
        for n, uvs in self.uvs:
            if uvs is not None:
                rows[first : first + n] = np.column_stack([uvs, np.ones(n)])
            first += n
        return rows

    def attribute_rows(self, shown: MeshAttribute) -> NDArray[np.float32]:
        """(vertices, 3), or (triangles, 3) of an attribute of faces; 0 of meshes without it. One number is three."""
        rows = np.zeros((self.counts["triangles"] if shown.of_faces else self.n_vertices, 3), np.float32)
        for vertex, triangle, attributes in self.attributes:
            if (values := attributes.get(shown.name)) is not None:
                first = triangle if shown.of_faces else vertex
                rows[first : first + len(values)] = values
        return rows

    def instance_boxes(self) -> Reals:
        """(instances, 2, 3) boxes."""
        return np.reshape([instance.bounds() for instance in self.instances], (-1, 2, 3))

    def bounds(self) -> Reals:
        """(2, 3) box of all finite shapes, NaN where there are none."""
        end = self.begins[1]
        vertices, spheres = self.joined(self.vertices)[: end.vertices], self.joined(self.spheres)[: end.spheres]
        radii = spheres[:, 3:]
        low, high = (ends[: end.analytic] for ends in self.analytic_bounds([np.zeros(3)] * (len(self.groups) + 1)))
        boxes = self.instance_boxes()
        known = vertices, spheres[:, :3] - radii, spheres[:, :3] + radii, low, high, boxes[:, 0], boxes[:, 1]
        ends = [p for p in known if len(p)]
        if not ends:
            return np.full((2, 3), np.nan)
        lows, highs = [part.min(axis=0) for part in ends], [part.max(axis=0) for part in ends]
        return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])

    def relative(self, name: str, rows: Reals, centers: list[Reals]) -> Reals:
        """Rows of vertices, or of spheres and so on, whose first three numbers are a position, relative to the centre of their
        part: of the shapes outside of groups, and of each group."""
        result = rows.astype(np.float64)
        for begin, end, center in zip(self.begins, self.begins[1:], centers, strict=False):
            result[getattr(begin, name) : getattr(end, name), :3] -= center
        return result

    def analytic_rows(self, centers: list[Reals]) -> Reals:
        """(n, SHAPE_PARAMETERS) parameters, positions relative to the centre of their part."""
        result = np.zeros((len(self.analytic), SHAPE_PARAMETERS))
        for begin, end, center in zip(self.begins, self.begins[1:], centers, strict=False):
            for k in range(begin.analytic, end.analytic):
                numbers = ANALYTIC[type(self.analytic[k])].parameters(self.analytic[k], center)
                result[k, : len(numbers)] = numbers
        return result

    def analytic_bounds(self, centers: list[Reals]) -> tuple[Reals, Reals]:
        """Lowest and highest coordinates (n, 3)."""
        parameters = self.analytic_rows(centers)
        low, high = np.zeros((len(parameters), 3)), np.zeros((len(parameters), 3))
        for i, shape in enumerate(self.analytic):
            found = ANALYTIC[type(shape)].bounds(parameters[i : i + 1])
            low[i], high[i] = found[0][0], found[1][0]
        return low, high

    def analytic_kinds(self) -> tuple[int, ...]:
        return tuple(sorted({ANALYTIC[type(shape)].kind for shape in self.analytic}))


_BOUNDED = ("triangles", "spheres", "analytic")
_COLUMNS = (*_BOUNDED, "planes")


@kernel
def collapse_degenerate(faces, vertices):
    """Draws faces without area (as the vertices are rounded) together to a point, which no ray meets. Seen from afar,
    rounding could open a slit."""
    for i in range(len(faces)):
        a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
        px, py, pz = np.float64(vertices[a, 0]), np.float64(vertices[a, 1]), np.float64(vertices[a, 2])
        ux, uy, uz = vertices[b, 0] - px, vertices[b, 1] - py, vertices[b, 2] - pz
        vx, vy, vz = vertices[c, 0] - px, vertices[c, 1] - py, vertices[c, 2] - pz
        if uy * vz - uz * vy == 0.0 and uz * vx - ux * vz == 0.0 and ux * vy - uy * vx == 0.0:
            faces[i, 1] = faces[i, 2] = a
