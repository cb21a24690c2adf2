"""Meshes of a glTF file: the triangles of primitives, and copies of them that nodes place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.attributes import Attributes, of_copies
from engines.scene.context import SceneReader
from engines.scene.frames import LARGEST, Matrix, cofactors
from engines.scene.geometry import has_area, unit_rows, with_face_normals
from engines.scene.gltf.document import DECOMPRESS, Document, extension, integer, listed, mapping, name_of, optional, required
from engines.scene.gltf.materials import VERTEX_ALPHA, VERTEX_COLOR, Look, Materials
from engines.scene.mesh import Mesh, faceted, read_only_mesh
from engines.scene.notes import Notes
from engines.schema.yaml_file import Located

TRIANGLES, STRIP, FAN = 4, 5, 6
MAX_COPIED = 4_000_000
"""Triangles of all primitives and copies, beyond one for two bytes of the files."""
LEAST_COUNTED = 16
"""Triangles that a mesh, a primitive, and a copy of either counts as at least: they take time without any."""
MAX_WEIGHTS = 8
"""Sets of four joints of a vertex."""
NO_DRACO = f"is compressed with Draco, which is not read: {DECOMPRESS}"
Rows = Callable[..., NDArray[Any] | None]
"""An attribute of the vertices that are used, (n, width), by its name and its types; None where there is none."""


@dataclass(frozen=True, slots=True)
class Primitive:
    """Triangles in the space of their mesh: `vertices` (n, 3), `faces` (m, 3), and what the file has of unit `normals` (n, 3),
    `uvs` (n, 2), attributes, and a `skin` of joints (n, k) and their weights (n, k). `turned` (m,) says of which faces
    the texture coordinates are mirrored, where that matters to their `look`."""

    node: Located
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64] | None
    look: Look
    uvs: NDArray[np.float64] | None
    attributes: Attributes
    turned: NDArray[np.bool_] | None
    skin: tuple[NDArray[Any], NDArray[Any]] | None


@dataclass(slots=True)
class Meshes:
    """The meshes of a file that nodes show; `triangles` counts those that have been read and placed."""

    document: Document
    reader: SceneReader
    notes: Notes
    materials: Materials
    primitives: dict[int, list[Primitive]] = field(default_factory=dict)
    triangles: int = 0

    def placed(self, named: Located, to_world: Matrix, joints: NDArray[np.float64] | None = None) -> Iterator[Mesh]:
        """The mesh that is named there, at its place in the scene, a shape for each primitive. This is where a mesh becomes a
        copy: an engine with instances would share `primitives` here.

        `joints` (k, 4, 4) are those of a skin, which places the vertices instead. Raises `SceneError`."""
        self._count(named, 0)
        mesh = self.document.item("meshes", named)
        if named.value not in self.primitives:
            self.primitives[named.value] = list(self._read(mesh))
        for primitive in self.primitives[named.value]:
            self._count(named, len(primitive.faces))
            copy = self._copy(primitive, to_world, name_of(mesh, "mesh"), joints)
            area = has_area(copy.vertices, copy.faces)
            if area.any():
                self.reader.degenerate += int((~area).sum())
                yield copy
            else:
                self.notes.add("without an area it is left out", f"mesh {copy.name!r}")

    def _count(self, node: Located, triangles: int) -> None:
        self.triangles += max(triangles, LEAST_COUNTED)
        if self.triangles > (most := MAX_COPIED + self.document.held // 2):
            counted = f"a mesh and a primitive count as {LEAST_COUNTED} at least"
            raise node.refuse(f"nodes show more than {most:,} triangles in all ({counted}): there must be fewer copies")

    def _copy(self, primitive: Primitive, matrix: Matrix, name: str, joints: NDArray[np.float64] | None) -> Mesh:
        faces, normals, uvs, attributes = primitive.faces, primitive.normals, primitive.uvs, primitive.attributes
        skin = matrix[None] if joints is None or primitive.skin is None else _skin(primitive.node, *primitive.skin, joints)
        linear = skin[:, :3, :3]
        with np.errstate(over="ignore", invalid="ignore"):
            mirrored = np.linalg.det(linear) < 0.0
            vertices = np.einsum("nij,nj->ni", linear, primitive.vertices) + skin[:, :3, 3]
            if normals is not None:
                sides = np.where(mirrored, -1.0, 1.0)[:, None, None]
                normals = unit_rows(np.einsum("nij,nj->ni", sides * cofactors(linear), normals))
        if not (np.abs(vertices) < LARGEST).all():
            raise primitive.node.refuse(f"vertices must be finite, and lie within {LARGEST:g} of the origin")
        swapped = np.broadcast_to(mirrored, len(vertices))[faces].sum(axis=1) > 1
        faces = np.where(swapped[:, None], faces[:, [0, 2, 1]], faces)
        materials = np.full(len(faces), primitive.look.index, np.int32)
        if primitive.turned is not None and (turned := primitive.turned != swapped).any():
            materials[turned] = self.materials.look(primitive.node, primitive.look.colored, mirrored=True).index
        if normals is not None:
            made = with_face_normals(vertices, faces, normals, uvs)
            if made.replaced:
                self.notes.add(faceted(made.replaced), f"mesh {name!r}")
            vertices, faces, normals, uvs = made.vertices, made.faces, made.normals, made.uvs
            attributes = of_copies(attributes, made.copied)
        return read_only_mesh(vertices, faces, materials, normals, name, uvs, attributes)

    # ---- primitives

    def _read(self, mesh: Located) -> Iterator[Primitive]:
        name = f"mesh {name_of(mesh, 'mesh')!r}"
        for node in listed(mesh, "primitives"):
            self._count(node, 0)
            if optional(mapping(node), "targets") is not None:
                self.notes.add("it is at rest: morph targets are not applied", name)
            mode = integer(node, "mode", TRIANGLES, most=FAN)
            if mode < TRIANGLES:
                self.notes.add("points and lines are left out", name)
                continue
            yield from self._primitive(node, mode, name)

    def _primitive(self, node: Located, mode: int, name: str) -> Iterator[Primitive]:
        given = mapping(required(node, "attributes"))
        where = optional(given, "POSITION")
        if extension(node, "KHR_draco_mesh_compression") is not None and (
            where is None or optional(self.document.item("accessors", where), "bufferView") is None
        ):
            raise node.refuse(NO_DRACO)
        if where is None:
            self.notes.add("primitives without POSITION are left out", name)
            return
        vertices = self.document.array(where, ("VEC3",))
        faces = _triangles(node, self._corners(node, len(vertices)), mode)
        if len(faces) == 0:
            self.notes.add("primitives without triangles are left out", name)
            return
        self._count(node, len(faces))
        used, flat = np.unique(faces, return_inverse=True)
        faces = flat.reshape(-1, 3).astype(np.int32)

        def rows(key: str, *types: str, whole: bool = False) -> NDArray[Any] | None:
            found = optional(given, key)
            if found is None:
                return None
            every = self.document.array(found, types, whole)
            if len(every) != len(vertices):
                raise found.refuse(f"has {len(every)} elements, and POSITION {len(vertices)}")
            if not np.isfinite(values := every[used]).all():
                raise found.refuse("holds numbers that are infinite, or none")
            return values

        points, normals, colors = vertices[used], rows("NORMAL", "VEC3"), rows("COLOR_0", "VEC3", "VEC4")
        if not (np.abs(points) < LARGEST).all():
            raise where.refuse(f"vertices must be finite, and lie within {LARGEST:g} of the origin")
        normals = None if normals is None else unit_rows(normals)
        look = self.materials.look(node, colors is not None and bool((colors != 1.0).any()), mirrored=False)
        shown = self._shown(look, rows, faces, colors, name)
        yield Primitive(node, points, faces, normals, look, *shown, _weights(rows))

    def _corners(self, node: Located, count: int) -> NDArray[np.int64]:
        """(k,) the vertices of the corners of triangles, in the order of the file."""
        indices = optional(node, "indices")
        if indices is None:
            return np.arange(count)
        found = self.document.array(indices, ("SCALAR",), whole=True)[:, 0]
        if found.max() >= count:
            raise indices.refuse(f"a corner is vertex {found.max()} of {count}")
        return found.astype(np.int64)

    def _shown(
        self, look: Look, rows: Rows, faces: NDArray[np.int32], colors: NDArray[np.float64] | None, name: str
    ) -> tuple[NDArray[np.float64] | None, Attributes, NDArray[np.bool_] | None]:
        """The texture coordinates and attributes that a look needs, and which faces are turned."""
        material = self.reader.table.materials[look.index]
        attributes = {}
        if colors is not None and VERTEX_COLOR in material.attributes:
            attributes[VERTEX_COLOR] = np.clip(colors[:, :3] * look.tint, 0.0, 1.0)
        if colors is not None and VERTEX_ALPHA in material.attributes:
            attributes[VERTEX_ALPHA] = np.clip(colors[:, 3:] if colors.shape[1] == 4 else np.ones((len(colors), 1)), 0.0, 1.0)
        if not material.uses_uvs:
            return None, attributes, None
        uvs = rows(f"TEXCOORD_{look.uv_set or 0}", "VEC2")
        if uvs is None:
            self.notes.add(f"without TEXCOORD_{look.uv_set or 0} it shows one texel of its textures", name)
            return np.zeros((int(faces.max()) + 1, 2)), attributes, None
        return uvs, attributes, _turned(uvs[faces]) if look.tilted else None


def _weights(rows: Rows) -> tuple[NDArray[Any], NDArray[Any]] | None:
    """The joints of vertices (n, k) and their weights (n, k)."""
    sets = []
    for index in range(MAX_WEIGHTS):
        joints, weights = rows(f"JOINTS_{index}", "VEC4", whole=True), rows(f"WEIGHTS_{index}", "VEC4")
        if joints is None or weights is None:
            break
        sets.append((joints, weights))
    return (np.hstack([joints for joints, _ in sets]), np.hstack([weights for _, weights in sets])) if sets else None


def _triangles(node: Located, corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """(m, 3) of corners in a row."""
    if mode == TRIANGLES:
        if len(corners) % 3:
            raise node.refuse(f"has {len(corners)} corners: three for each triangle are expected")
        return corners.reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    first = np.arange(count)
    if mode == FAN:
        return corners[np.stack([first + 1, first + 2, np.zeros(count, np.int64)], axis=1)]
    odd = first % 2
    return corners[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]


def _turned(uvs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(m,) which triangles (m, 3, 2) of texture coordinates are mirrored; v counts downwards."""
    a, b = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0.0


def _skin(node: Located, joints: NDArray[Any], weights: NDArray[Any], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) the transforms of vertices: means of the `places` (k, 4, 4) of joints; the identity without weights."""
    if joints.max() >= len(places):
        raise node.refuse(f"has joint {joints.max()} of {len(places)}")
    total = np.zeros((len(joints), 4, 4))
    for joint, weight in zip(joints.T, weights.T, strict=True):
        total += weight[:, None, None] * places[joint]
    sums = weights.sum(axis=1)[:, None, None]
    return np.divide(total, sums, out=np.tile(np.eye(4), (len(total), 1, 1)), where=sums != 0.0)
