"""Meshes: what engines get, and the keys of a scene file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.context import SceneReader
from engines.scene.formats.mesh import MeshData, read_mesh
from engines.scene.geometry import unit_rows, vertex_normals
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, POINT, POSITIVE, ROWS, TEXT, Kind
from engines.schema.yaml_file import Located

__all__ = ["Mesh"]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Indexed triangles: `vertices` (n, 3) float64, `faces` (m, 3) int32, `materials` (m,) int32, one per face.

    `normals` (n, 3) unit vertex normals, or None where the mesh is flat-shaded. Faces of zero area may occur: they are
    never hit and never sampled. `uvs` (n, 2) float64 are texture coordinates of the vertices, or None.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    materials: NDArray[np.int32]
    normals: NDArray[np.float64] | None = None
    name: str = "mesh"
    uvs: NDArray[np.float64] | None = None

    def bounds(self) -> NDArray[np.float64] | None:
        """(2, 3) lowest and highest coordinates of the faces; None where there are none."""
        corners = self.vertices[np.unique(self.faces)]
        return np.stack([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else None


def read_only_mesh(vertices: Any, faces: Any, materials: Any, normals: NDArray[np.float64] | None, name: str) -> Mesh:
    """The mesh of these arrays, or of copies in the types of `Mesh`; nobody may write to them any more."""
    vertices = np.ascontiguousarray(vertices, np.float64)
    faces, materials = np.ascontiguousarray(faces, np.int32), np.ascontiguousarray(materials, np.int32)
    for array in (vertices, faces, materials, *([] if normals is None else [normals])):
        array.flags.writeable = False
    return Mesh(vertices, faces, materials, normals, name)


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


MESH = Record("Triangles from a file, or listed.", {
    "file": Key(TEXT, "An .obj, .ply or .stl file, relative to the scene's folder.", None),
    "vertices": Key(ROWS, "Vertices of the triangles.", None, unit="metres"),
    "faces": Key(ROWS, "Three indices of vertices for each triangle, counter-clockwise seen from the front.", None),
    "scale": Key(Kind(_scale, {"anyOf": [POSITIVE.json, POINT.json]}), "Factor of coordinates, or one for each axis.", 1),
    "translate": Key(POINT, "Vector that is added after scaling.", [0, 0, 0], unit="metres"),
    "smooth": Key(BOOLEAN, "Whether normals are interpolated: those of the file, else means of adjacent faces.", False),
}, _mesh, either=(("file",), ("vertices", "faces")))  # fmt: skip
