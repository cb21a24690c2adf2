"""Shapes of many primitives: meshes, with the keys of a scene file, and sets of spheres."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.scene.attributes import Attributes, checked_attributes, of_copies
from engines.scene.context import SceneReader
from engines.scene.formats.mesh import MeshData, read_mesh
from engines.scene.geometry import read_only, unit_rows, vertex_normals, with_face_normals
from engines.scene.media import MediumInterface
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, NUMBER, POINT, POSITIVE, ROWS, TEXT, Kind, array_of, integer
from engines.schema.yaml_file import Located, locate

__all__ = ["Mesh", "SphereSet"]

SINGULAR = 1e-12
"""Least determinant of a transform whose largest number is 1."""


def is_singular(linear: NDArray[np.float64]) -> bool:
    """Whether a linear part (3, 3) flattens space."""
    largest = np.abs(linear).max()
    return largest == 0.0 or not abs(np.linalg.det(linear / largest)) > SINGULAR


@dataclass(frozen=True, slots=True, eq=False)
class Mesh(MediumInterface):
    """Indexed triangles: `vertices` (n, 3) float64, `faces` (m, 3) int32, `materials` (m,) int32, one per face.

    `normals` (n, 3) unit vertex normals, or None where the mesh is flat-shaded. Faces of zero area may occur: they are
    never hit and never sampled. `uvs` (n, 2) float64 are texture coordinates of the vertices, or None.

    `attributes` are float32 values in [0, 1], (n, 3) or (n, 1) of each vertex ("vertex_color"), (m, 3) or (m, 1) of each face
    ("face_color"). Arrays of other types, and those that can be written to, are copied. Raises `SceneError` for wrong names,
    shapes or values.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    materials: NDArray[np.int32]
    normals: NDArray[np.float64] | None = None
    name: str = "mesh"
    uvs: NDArray[np.float64] | None = None
    attributes: Attributes = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.attributes:
            try:
                checked = checked_attributes(self.attributes, len(self.vertices), len(self.faces))
            except ValueError as problem:
                raise SceneError(f"{self.name}: {problem}") from problem
            object.__setattr__(self, "attributes", checked)

    def bounds(self) -> NDArray[np.float64] | None:
        """(2, 3) lowest and highest coordinates of the faces; None where there are none."""
        corners = self.vertices[np.unique(self.faces)]
        return np.stack([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else None


def read_only_mesh(
    vertices: Any,
    faces: Any,
    materials: Any,
    normals: NDArray[np.float64] | None,
    name: str,
    uvs: NDArray[np.float64] | None = None,
    attributes: Attributes | None = None,
) -> Mesh:
    """The mesh of these arrays, or of copies in the types of `Mesh`; nobody may write to them any more."""
    normals, uvs = (None if rows is None else read_only(np.ascontiguousarray(rows, np.float64)) for rows in (normals, uvs))
    faces, materials = (read_only(np.ascontiguousarray(array, np.int32)) for array in (faces, materials))
    vertices = read_only(np.ascontiguousarray(vertices, np.float64))
    return Mesh(vertices, faces, materials, normals, name, uvs, attributes or {})


@dataclass(frozen=True, slots=True, eq=False)
class SphereSet(MediumInterface):
    """Many spheres that make one shape (a sphereflake): `centers` (n, 3), `radii` (n,), one material."""

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    material: int
    name: str = "spheres"

    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest coordinates."""
        radii = self.radii[:, None]
        return np.stack([(self.centers - radii).min(axis=0), (self.centers + radii).max(axis=0)])


def _mesh(given: Given, context: SceneReader) -> Mesh:
    smooth, several = given["smooth"], context.face_materials
    material = several[0] if several else context.material
    shown = [] if material is None else [context.table.materials[each] for each in several or [material]]
    uvs, attributes = any(each.uses_uvs for each in shown), set[str]().union(*(each.attributes for each in shown))
    if given.has("file"):
        if given.has("uvs"):
            raise given.node.refuse_key("uvs", "belongs to vertices that are listed: a file has its own")
        if given.has("attributes"):
            raise given.node.refuse_key("attributes", "belongs to vertices that are listed: a file has its own")
        data = read_mesh(given.at("file"), context, smooth, uvs, material is None, _shape_index(given), attributes)
        context.warnings += data.warnings
    else:
        data = _inline(given, uvs, attributes)
    materials = _face_materials(given, context, data)
    data = _placed(given, data)
    name = given["file"] or "inline mesh"
    if not smooth:
        return read_only_mesh(data.vertices, data.faces, materials, None, name, data.uvs, data.attributes)
    normals = smooth_normals(data) if data.normals is None else data.normals
    made = with_face_normals(data.vertices, data.faces, normals, data.uvs)
    if made.replaced:
        context.warnings.append(f"{name}: {faceted(made.replaced)}")
    attributes_made = of_copies(data.attributes, made.copied)
    return read_only_mesh(made.vertices, made.faces, materials, made.normals, name, made.uvs, attributes_made)


def faceted(corners: int) -> str:
    """The note about so many corners that `with_face_normals` has replaced."""
    several = f"{corners} corners of triangles have" if corners > 1 else "1 corner of a triangle has"
    return f"{several} no vertex normal, or normals that cancel: the normal of the triangle is taken there"


def _shape_index(given: Given) -> int:
    if given.has("shape_index") and not given["file"].lower().endswith(".serialized"):
        raise given.node.refuse_key("shape_index", "belongs to .serialized files: others hold one mesh")
    return given["shape_index"]


def smooth_normals(data: MeshData) -> NDArray[np.float64]:
    """(n, 3) area-weighted means of adjacent faces, zeros where they cancel; vertices that texture coordinates have split count
    as one."""
    if data.origins is None:
        return vertex_normals(data.vertices, data.faces)
    whole = np.zeros((int(data.origins.max()) + 1, 3))
    whole[data.origins] = data.vertices
    return vertex_normals(whole, data.origins[data.faces].astype(np.int32))[data.origins]


def _inline(given: Given, with_uvs: bool, attributes: Collection[str]) -> MeshData:
    vertices = fields.rows(given["vertices"], np.float64)
    if len(vertices) == 0:
        raise given["vertices"].refuse("must not be empty")
    faces = fields.rows(given["faces"], np.int32, 0, len(vertices) - 1)
    if len(faces) == 0:
        raise given["faces"].refuse("must not be empty")
    uvs = None
    if given.has("uvs"):
        uvs = fields.rows(given["uvs"], np.float64, width=2)
        if len(uvs) != len(vertices):
            raise given["uvs"].refuse(f"{len(uvs)} pairs for {len(vertices)} vertices: one for each is expected")
    try:
        named = checked_attributes(given["attributes"] or {}, len(vertices), len(faces))
    except ValueError as problem:
        raise given.at("attributes").refuse(str(problem)) from problem
    shown = {name: values for name, values in named.items() if name in attributes}
    return MeshData(vertices, faces, uvs=uvs if with_uvs else None, attributes=shown)


def _attributes(node: Located) -> dict[str, NDArray[Any]]:
    """By name, the rows of an array or of lists."""
    if not isinstance(node.value, dict):
        raise node.refuse("must be a mapping from names of attributes to rows of numbers")
    return {name: _numbers(rows) for name, rows in node.value.items()}


def _numbers(node: Located) -> NDArray[Any]:
    if isinstance(node.value, np.ndarray):
        return node.value
    try:
        return np.array(node.plain())
    except ValueError as problem:
        raise node.refuse("must be rows of 1 or 3 numbers") from problem


def _face_materials(given: Given, context: SceneReader, data: MeshData) -> NDArray[np.int32]:
    """(m,) indices into the table: of one material, of those of an MTL, or of the list by the numbers that a PLY has."""
    if context.material is not None:
        return np.full(len(data.faces), context.material, np.int32)
    if not context.face_materials:
        indices = np.array([context.table.add(material) for material in data.materials], np.int32)
        assert data.face_materials is not None
        return indices[data.face_materials]
    numbers, count = data.face_materials, len(context.face_materials)
    if numbers is None:
        raise given.at("file").refuse("has no column 'material' for its triangles: one material is expected, not a list")
    if ((numbers < 0) | (numbers >= count)).any():
        raise given.at("file").refuse(f"has a face with a material outside [0, {count - 1}]")
    return np.array(context.face_materials, np.int32)[numbers]


def _scale(node: Located) -> NDArray[np.float64]:
    """A number or three, above 0."""
    several = isinstance(node.value, (list, np.ndarray))
    scale = np.array(fields.triple(node) if several else [fields.number(node)] * 3)
    if not (scale > 0.0).all():
        raise node.refuse("must be greater than 0")
    return scale


def _matrix(node: Located) -> NDArray[np.float64]:
    """(3, 4) of a matrix of 3 x 3, 3 x 4 or 4 x 4 numbers."""
    array = node.value if isinstance(node.value, np.ndarray) else None
    if array is not None and array.shape == (3, 4) and array.dtype == np.float64 and np.isfinite(array).all():
        return array
    rows = locate(array.tolist()).value if array is not None else node.value
    sizes = {len(row.value) if isinstance(row.value, list) else 0 for row in rows} if isinstance(rows, list) else set()
    if not sizes <= {3, 4} or len(sizes) != 1 or len(rows) not in (3, 4) or (len(rows), *sizes) == (4, 3):
        raise node.refuse("must be a matrix of 3 x 3, 3 x 4 or 4 x 4 numbers")
    numbers = np.array([[fields.number(item) for item in row.value] for row in rows])
    if len(numbers) == 4 and numbers[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise node.refuse("must be affine: its last row must be [0, 0, 0, 1]")
    matrix = np.zeros((3, 4))
    matrix[:, : numbers.shape[1]] = numbers[:3]
    return matrix


def _transform(node: Located) -> NDArray[np.float64]:
    """A matrix that does not flatten."""
    matrix = _matrix(node)
    if is_singular(matrix[:, :3]):
        raise node.refuse("must not be singular")
    return matrix


def _placed(given: Given, data: MeshData) -> MeshData:
    """Vertices times `scale` plus `translate`, or by `transform`, with normals to match; a matrix that mirrors exchanges two
    corners of each face, so that its front stays where it was."""
    scale, vertices, normals, faces = given["scale"], data.vertices, data.normals, data.faces
    with np.errstate(over="ignore", invalid="ignore"):
        if given.has("transform"):
            for key in ("scale", "translate"):
                if given.has(key):
                    raise given.node.refuse_key(key, "either transform, or scale and translate")
            matrix = given["transform"]
            vertices = vertices @ matrix[:, :3].T + matrix[:, 3]
            if normals is not None:
                normals = unit_rows(normals @ np.linalg.inv(matrix[:, :3]))
            if np.linalg.det(matrix[:, :3]) < 0.0:
                faces = np.ascontiguousarray(faces[:, [0, 2, 1]])
        if given.has("scale"):
            vertices = vertices * scale
        if given.has("translate"):
            vertices = vertices + np.array(given["translate"])
    if normals is not None and given.has("scale"):
        normals = unit_rows(normals * (scale.min() / scale))
    if not np.isfinite(vertices).all():
        placing = "transformed" if given.has("transform") else "scaled and translated"
        raise given.node.refuse(f"{placing} vertices must be finite")
    return replace(data, vertices=vertices, normals=normals, faces=faces)


MATRIX = Kind(_matrix, array_of(array_of(NUMBER.json, 3, 4), 3, 4))
_ATTRIBUTE = {"type": "array", "items": {"anyOf": [array_of(NUMBER.json, 1), array_of(NUMBER.json, 3)]}}
_PAIRS = {"type": "array", "items": array_of(NUMBER.json, 2)}
MESH = Record(
    "Triangles from a file, or listed.",
    {
        "file": Key(TEXT, "An .obj, .ply, .stl or .serialized file, relative to the scene's folder.", None),
        "shape_index": Key(integer(0, 2**31 - 1), "Which mesh of a .serialized file, counted from 0.", 0),
        "vertices": Key(ROWS, "Vertices of the triangles.", None, unit="metres"),
        "faces": Key(ROWS, "Three indices of vertices for each triangle, counter-clockwise seen from the front.", None),
        "uvs": Key(
            Kind(lambda node: node, _PAIRS),
            "Texture coordinates [u, v], one pair for each vertex; v = 0 is the top of an image.",
            None,
        ),
        "attributes": Key(
            Kind(_attributes, {"type": "object", "additionalProperties": _ATTRIBUTE}),
            "Numbers in [0, 1] by names for textures: rows of 1 or 3, one for each vertex where the name begins with vertex_, "
            "one for each face where it begins with face_.",
            None,
        ),
        "scale": Key(Kind(_scale, {"anyOf": [POSITIVE.json, POINT.json]}), "Factor of coordinates, or one for each axis.", 1),
        "translate": Key(POINT, "Vector that is added after scaling.", [0, 0, 0], unit="metres"),
        "transform": Key(
            Kind(_transform, MATRIX.json),
            "Instead of scale and translate, a matrix of 3 x 3, 3 x 4 or 4 x 4 numbers, by rows.",
            None,
        ),
        "smooth": Key(BOOLEAN, "Whether normals are interpolated: those of the file, else means of adjacent faces.", False),
    },
    _mesh,
    either=(("file",), ("vertices", "faces")),
)
