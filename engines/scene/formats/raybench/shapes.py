"""Shapes of a scene file, each one entry of `SHAPES`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.formats.mesh import MeshData, read_mesh
from engines.scene.formats.raybench.context import SceneReader
from engines.scene.geometry import has_area, read_only_mesh, unit_rows, vertex_normals
from engines.scene.model import Disk, Mesh, Plane, Shape, Sphere, Triangle
from engines.scene.procedural import PROCEDURAL
from engines.schema import fields
from engines.schema.keys import Given, Key, Record, Variants
from engines.schema.kinds import BOOLEAN, DIRECTION, POINT, POSITIVE, ROWS, TEXT, Kind
from engines.schema.yaml_file import Located


def _check_area(node: Located, shape: Shape, context: SceneReader) -> None:
    """Counts degenerate triangles, and refuses an emitting material where they are all there is."""
    if isinstance(shape, Triangle):
        vertices, faces = np.array([shape.a, shape.b, shape.c]), np.array([[0, 1, 2]], np.int32)
        materials = np.array([shape.material], np.int32)
    elif isinstance(shape, Mesh):
        vertices, faces, materials = shape.vertices, shape.faces, shape.materials
    else:
        return
    area = has_area(vertices, faces)
    context.degenerate += int((~area).sum())
    emits = np.array([material.emits for material in context.table.materials], bool)[materials]
    if emits.any() and not (emits & area).any():
        name = context.table.materials[int(materials[emits][0])].name
        raise node.refuse(f"material {name!r} emits, but the shape has no area")


def _of(shape: Callable[..., Shape]) -> Callable[[Given, SceneReader], Shape]:
    return lambda given, context: shape(**given.values, material=context.material)


def _mesh(given: Given, context: SceneReader) -> Mesh:
    smooth, material = given["smooth"], context.material
    if given.has("file"):
        data = read_mesh(given.at("file"), context.place, smooth, with_materials=material is None)
        context.warnings += data.warnings
    else:
        data = _inline(given)
    materials = _file_materials(context, data) if material is None else np.full(len(data.faces), material, np.int32)
    vertices, normals = _placed(given, data)
    if smooth and normals is None:
        normals = vertex_normals(vertices, data.faces)
    return read_only_mesh(vertices, data.faces, materials, normals if smooth else None, given["file"] or "inline mesh")


def _inline(given: Given) -> MeshData:
    vertices = fields.rows(given["vertices"], np.float64)
    if len(vertices) == 0:
        raise given["vertices"].refuse("must not be empty")
    faces = fields.rows(given["faces"], np.int32, 0, len(vertices) - 1)
    if len(faces) == 0:
        raise given["faces"].refuse("must not be empty")
    return MeshData(vertices, faces)


def _file_materials(context: SceneReader, data: MeshData) -> NDArray[np.int32]:
    indices = np.array([context.table.add(material) for material in data.materials], np.int32)
    assert data.face_materials is not None
    return indices[data.face_materials]


def _scale(node: Located) -> NDArray[np.float64]:
    """A number or three, above 0."""
    several = isinstance(node.value, (list, np.ndarray))
    scale = np.array(fields.triple(node) if several else [fields.number(node)] * 3)
    if not (scale > 0.0).all():
        raise node.refuse("must be greater than 0")
    return scale


def _placed(given: Given, data: MeshData) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Vertices times `scale` plus `translate`, and normals to match."""
    scale, vertices, normals = given["scale"], data.vertices, data.normals
    with np.errstate(over="ignore"):
        if given.has("scale"):
            vertices = vertices * scale
        if given.has("translate"):
            vertices = vertices + np.array(given["translate"])
    if normals is not None and given.has("scale"):
        normals = unit_rows(normals * (scale.min() / scale))
    if not np.isfinite(vertices).all():
        raise given.node.refuse("scaled and translated vertices must be finite")
    return vertices, normals


_CENTER = Key(POINT, "Center of the shape.", unit="metres")
_NORMAL = Key(DIRECTION, "Direction towards the front, of any length.")
_RADIUS = Key(POSITIVE, "Radius of the shape.", unit="metres")
_CORNER = Key(POINT, "A corner; a, b, c run counter-clockwise seen from the front.", unit="metres")
SHAPES = Variants("shape", {
    "sphere": Record("A sphere. Its outside is the front.", {"center": _CENTER, "radius": _RADIUS}, _of(Sphere)),
    "disk": Record("A flat disk.", {"center": _CENTER, "normal": _NORMAL, "radius": _RADIUS}, _of(Disk)),
    "plane": Record(
        "An infinite plane. One that emits is found by scattered rays alone.",
        {"point": Key(POINT, "Any point of the plane.", unit="metres"), "normal": _NORMAL}, _of(Plane),
    ),
    "triangle": Record("A triangle.", dict.fromkeys("abc", _CORNER), _of(Triangle)),
    "mesh": Record("Triangles from a file, or listed.", {
        "file": Key(TEXT, "An .obj, .ply or .stl file, relative to the scene's folder.", None),
        "vertices": Key(ROWS, "Vertices of the triangles.", None, unit="metres"),
        "faces": Key(ROWS, "Three indices of vertices for each triangle, counter-clockwise seen from the front.", None),
        "scale": Key(Kind(_scale, {"anyOf": [POSITIVE.json, POINT.json]}), "Factor of coordinates, or one for each axis.", 1),
        "translate": Key(POINT, "Vector that is added after scaling.", [0, 0, 0], unit="metres"),
        "smooth": Key(BOOLEAN, "Whether normals are interpolated: those of the file, else means of adjacent faces.", False),
    }, _mesh, either=(("file",), ("vertices", "faces"))),
    "procedural": PROCEDURAL,
}, {"material": Key(TEXT, "Name of one of the materials; a mesh from an OBJ file may leave it to the file.")})  # fmt: skip


class ShapeKind:
    """A shape with its material. The context is a `SceneReader`."""

    def read(self, node: Located, context: Any = None) -> Shape:
        kind = SHAPES.choose(node)
        body, named = node.value[kind], node.value.get("material")
        context.material = None if named is None else context.table.index(named)
        if named is None and not (kind == "mesh" and isinstance(body.value, dict) and "file" in body.value):
            raise node.refuse_key("material", "is missing")
        shape = SHAPES.records[kind].read(body, context)
        _check_area(node, shape, context)
        return shape

    def schema(self) -> dict[str, Any]:
        return SHAPES.schema()
