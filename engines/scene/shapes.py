"""Shapes of a scene file: sphere, disk, plane, triangle, mesh (from a file or inline) and procedural."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import suggestion
from engines.scene import fields
from engines.scene.files import Place
from engines.scene.geometry import has_area, unit_rows, vertex_normals
from engines.scene.materials import MaterialTable
from engines.scene.mesh import MeshData, read_mesh
from engines.scene.model import Disk, Mesh, Plane, Shape, Sphere, SphereSet, Triangle
from engines.scene.procedural import Spheres, generate
from engines.scene.yaml_file import Located


@dataclass(slots=True)
class ShapeReader:
    """Reads shapes one by one and remembers what the scene should warn about."""

    table: MaterialTable
    place: Place
    degenerate: int = 0
    warnings: list[str] = field(default_factory=list)

    def read(self, node: Located) -> Shape:
        if not isinstance(node.value, dict):
            raise node.refuse(f"must be a mapping with the kind of shape ({', '.join(_KINDS)}) and a material")
        kinds = [key for key in node.value if key != "material"]
        for key in kinds:
            if key not in _KINDS:
                raise node.refuse_key(key, f"unknown shape: {suggestion(key, [*_KINDS, 'material'])}")
        if len(kinds) != 1:
            raise node.refuse(f"must have one kind of shape: {', '.join(_KINDS)}")
        body = node.value[kinds[0]]
        named = node.value.get("material")
        material = None if named is None else self.table.index(named)
        if material is None and not (kinds[0] == "mesh" and isinstance(body.value, dict) and "file" in body.value):
            raise node.refuse_key("material", "is missing")
        shape = _KINDS[kinds[0]](self, body, material)
        self._check_area(node, shape)
        return shape

    def _check_area(self, node: Located, shape: Shape) -> None:
        """Counts degenerate triangles, and refuses an emitting material where they are all there is."""
        if isinstance(shape, Triangle):
            vertices, faces = np.array([shape.a, shape.b, shape.c]), np.array([[0, 1, 2]], np.int32)
            materials = np.array([shape.material], np.int32)
        elif isinstance(shape, Mesh):
            vertices, faces, materials = shape.vertices, shape.faces, shape.materials
        else:
            return
        area = has_area(vertices, faces)
        self.degenerate += int((~area).sum())
        emits = np.array([material.emits for material in self.table.materials], bool)[materials]
        if emits.any() and not (emits & area).any():
            name = self.table.materials[int(materials[emits][0])].name
            raise node.refuse(f"material {name!r} emits, but the shape has no area")


def _sphere(reader: ShapeReader, node: Located, material: Any) -> Sphere:
    given = fields.mapping(node, ("center", "radius"), ("center", "radius"))
    return Sphere(fields.triple(given["center"]), fields.positive(given["radius"]), material)


def _disk(reader: ShapeReader, node: Located, material: Any) -> Disk:
    given = fields.mapping(node, ("center", "normal", "radius"), ("center", "normal", "radius"))
    normal = fields.direction(given["normal"])
    return Disk(fields.triple(given["center"]), normal, fields.positive(given["radius"]), material)


def _plane(reader: ShapeReader, node: Located, material: Any) -> Plane:
    given = fields.mapping(node, ("point", "normal"), ("point", "normal"))
    return Plane(fields.triple(given["point"]), fields.direction(given["normal"]), material)


def _triangle(reader: ShapeReader, node: Located, material: Any) -> Triangle:
    given = fields.mapping(node, "abc", "abc")
    return Triangle(fields.triple(given["a"]), fields.triple(given["b"]), fields.triple(given["c"]), material)


def _mesh(reader: ShapeReader, node: Located, material: int | None) -> Mesh:
    given = fields.mapping(node, ("file", "vertices", "faces", "scale", "translate", "smooth"))
    smooth = fields.boolean(given["smooth"]) if "smooth" in given else False
    if "file" in given:
        for key in ("vertices", "faces"):
            if key in given:
                raise node.refuse_key(key, "either file, or vertices and faces")
        data = read_mesh(given["file"], reader.place, smooth, with_materials=material is None)
        materials = _file_materials(reader, data) if material is None else np.full(len(data.faces), material, np.int32)
        reader.warnings += data.warnings
        name = str(given["file"].value)
    elif material is not None:
        data = _inline(node, given)
        materials, name = np.full(len(data.faces), material, np.int32), "inline mesh"
    else:
        raise node.refuse("needs file, or vertices and faces")
    vertices, normals = _placed(given, data, node)
    if smooth and normals is None:
        normals = vertex_normals(vertices, data.faces)
    return _frozen_mesh(vertices, data.faces, materials, normals if smooth else None, name)


def _inline(node: Located, given: dict[str, Located]) -> MeshData:
    for key in ("vertices", "faces"):
        if key not in given:
            raise node.refuse_key(key, "is missing")
    vertices = fields.rows(given["vertices"], np.float64)
    if len(vertices) == 0:
        raise given["vertices"].refuse("must not be empty")
    faces = fields.rows(given["faces"], np.int32, 0, len(vertices) - 1)
    if len(faces) == 0:
        raise given["faces"].refuse("must not be empty")
    return MeshData(vertices, faces)


def _file_materials(reader: ShapeReader, data: MeshData) -> NDArray[np.int32]:
    indices = np.array([reader.table.add(material) for material in data.materials], np.int32)
    assert data.face_materials is not None
    return indices[data.face_materials]


def _placed(given: dict[str, Located], data: MeshData, node: Located) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Vertices times `scale` (a number or three) plus `translate`, and normals to match."""
    vertices, normals = data.vertices, data.normals
    if "scale" in given:
        at = given["scale"]
        scale = np.array(fields.triple(at) if isinstance(at.value, (list, np.ndarray)) else [fields.number(at)] * 3)
        if not (scale > 0.0).all():
            raise at.refuse("must be greater than 0")
        with np.errstate(over="ignore"):
            vertices = vertices * scale
        if normals is not None:
            normals = unit_rows(normals * (scale.min() / scale))
    if "translate" in given:
        with np.errstate(over="ignore"):
            vertices = vertices + np.array(fields.triple(given["translate"]))
    if not np.isfinite(vertices).all():
        raise node.refuse("scaled and translated vertices must be finite")
    return vertices, normals


def _procedural(reader: ShapeReader, node: Located, material: Any) -> Mesh | SphereSet:
    made = generate(node)
    if isinstance(made, Spheres):
        for array in (made.centers, made.radii):
            array.flags.writeable = False
        return SphereSet(made.centers, made.radii, material, made.name)
    return _frozen_mesh(made.vertices, made.faces, np.full(len(made.faces), material, np.int32), None, made.name)


def _frozen_mesh(vertices: Any, faces: Any, materials: Any, normals: Any, name: str) -> Mesh:
    vertices = np.ascontiguousarray(vertices, np.float64)
    faces, materials = np.ascontiguousarray(faces, np.int32), np.ascontiguousarray(materials, np.int32)
    for array in (vertices, faces, materials, *([] if normals is None else [normals])):
        array.flags.writeable = False
    return Mesh(vertices, faces, materials, normals, name)


_KINDS: dict[str, Callable[[ShapeReader, Located, Any], Shape]] = {
    "sphere": _sphere, "disk": _disk, "plane": _plane, "triangle": _triangle, "mesh": _mesh, "procedural": _procedural,
}  # fmt: skip
