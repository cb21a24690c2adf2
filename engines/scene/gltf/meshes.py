"""Meshes of a glTF file: the triangles of primitives, and copies of them that nodes place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from engines.scene.attributes import Attributes, of_copies
from engines.scene.context import SceneReader
from engines.scene.geometry import has_area, unit_rows, with_face_normals
from engines.scene.gltf.document import DECOMPRESS, Document, extension, integer, listed, mapping, name_of, optional, required
from engines.scene.gltf.materials import VERTEX_ALPHA, VERTEX_COLOR, Materials
from engines.scene.gltf.notes import Notes
from engines.scene.mesh import Mesh, faceted, read_only_mesh
from engines.scene.mitsuba_xml.transforms import Matrix, cofactors, mirrored, placed
from engines.schema.yaml_file import Located

TRIANGLES, STRIP, FAN = 4, 5, 6
LARGEST = 1e30
"""Coordinates within which vertices must lie."""
MAX_COPIED = 4_000_000
"""Triangles of all copies, beyond one for two bytes of the buffers."""
LEAST_COUNTED = 256
"""Triangles that a primitive, and a copy of it, counts as at least: a small one takes as long as so many."""
Rows = Callable[[str, int], NDArray[np.float64] | None]
"""An attribute of the vertices that are used, (n, width), by its name and its width; None where there is none."""
MAX_WEIGHTS = 8
"""Sets of four joints of a vertex."""
NO_DRACO = f"is compressed with Draco, which is not read: {DECOMPRESS}"


@dataclass(frozen=True, slots=True)
class Primitive:
    """Triangles in the space of their mesh: `vertices` (n, 3), `faces` (m, 3), `materials` (m,), and what the file has of unit
    `normals` (n, 3), `uvs` (n, 2) and attributes; and `joints` (n, k) with `weights` (n, k) of a skin."""

    node: Located
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    materials: NDArray[np.int32]
    normals: NDArray[np.float64] | None
    uvs: NDArray[np.float64] | None
    attributes: Attributes
    joints: NDArray[np.int64] | None
    weights: NDArray[np.float64] | None


@dataclass(slots=True)
class Meshes:
    """The meshes of a file that nodes show; `triangles` counts those that have been placed."""

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
            counted = f"a primitive counts as {LEAST_COUNTED} at least"
            raise node.refuse(f"nodes show more than {most:,} triangles in all ({counted}): there must be fewer copies")

    def _copy(self, primitive: Primitive, matrix: Matrix, name: str, joints: NDArray[np.float64] | None) -> Mesh:
        vertices, faces, normals, uvs = primitive.vertices, primitive.faces, primitive.normals, primitive.uvs
        attributes = primitive.attributes
        skin = None if joints is None else _skin(primitive, joints)
        with np.errstate(over="ignore", invalid="ignore"):
            if skin is not None:
                vertices = np.einsum("nij,nj->ni", skin[:, :3, :3], vertices) + skin[:, :3, 3]
                normals = None if normals is None else unit_rows(np.einsum("nij,nj->ni", skin[:, :3, :3], normals))
            else:
                vertices = placed(matrix, vertices)
                if mirrored(matrix):
                    faces = faces[:, [0, 2, 1]]
                if normals is not None:
                    normals = unit_rows(normals @ cofactors(matrix[:3, :3]).T * (-1.0 if mirrored(matrix) else 1.0))
        if not (np.abs(vertices) < LARGEST).all():
            raise primitive.node.refuse(f"vertices must be finite, and lie within {LARGEST:g} of the origin")
        if normals is not None:
            made = with_face_normals(vertices, faces, normals, uvs)
            if made.replaced:
                self.notes.add(faceted(made.replaced), f"mesh {name!r}")
            vertices, faces, normals, uvs = made.vertices, made.faces, made.normals, made.uvs
            attributes = of_copies(attributes, made.copied)
        return read_only_mesh(vertices, faces, primitive.materials, normals, name, uvs, attributes)

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
        if extension(node, "KHR_draco_mesh_compression") is not None and (where is None or self._is_compressed(where)):
            raise node.refuse(NO_DRACO)
        if where is None:
            self.notes.add("primitives without POSITION are left out", name)
            return
        vertices = self._floats(where, "VEC3")
        corners = self._corners(node, len(vertices))
        faces = _triangles(corners, mode)
        if len(corners) and mode == TRIANGLES and len(corners) % 3:
            raise node.refuse(f"has {len(corners)} corners: three for each triangle are expected")
        if len(faces) == 0:
            self.notes.add("primitives without triangles are left out", name)
            return
        used, flat = np.unique(faces, return_inverse=True)
        faces = flat.reshape(-1, 3).astype(np.int32)

        def rows(key: str, width: int) -> NDArray[np.float64] | None:
            found = optional(given, key)
            if found is None:
                return None
            every = self._floats(found, *(("VEC3", "VEC4") if width == 4 else (f"VEC{width}",)))
            if len(every) != len(vertices):
                raise found.refuse(f"has {len(every)} elements, and POSITION {len(vertices)}")
            if not np.isfinite(values := every[used]).all():
                raise found.refuse("holds numbers that are infinite, or none")
            return values

        normals, colors = rows("NORMAL", 3), rows("COLOR_0", 4)
        if colors is not None and not (colors != 1.0).any():
            colors = None
        materials, uvs, attributes = self._looks(node, rows, faces, colors, name)
        joints, weights = self._weights(given, used, len(vertices))
        points = vertices[used]
        if not (np.abs(points) < LARGEST).all():
            raise where.refuse(f"vertices must be finite, and lie within {LARGEST:g} of the origin")
        yield Primitive(
            node, points, faces, materials, None if normals is None else unit_rows(normals), uvs, attributes, joints, weights
        )

    def _is_compressed(self, where: Located) -> bool:
        return optional(self.document.item("accessors", where), "bufferView") is None

    def _floats(self, node: Located, *types: str) -> NDArray[np.float64]:
        """(n, k) of an accessor; integers that are not normalised as they are (KHR_mesh_quantization)."""
        return self.document.array(node, types).astype(np.float64, copy=False)

    def _corners(self, node: Located, count: int) -> NDArray[np.int64]:
        """(k,) the vertices of the corners of triangles, in the order of the file."""
        indices = optional(node, "indices")
        if indices is None:
            return np.arange(count)
        found = self.document.array(indices, ("SCALAR",))[:, 0]
        if found.dtype.kind != "u":
            raise indices.refuse("accessor of indices: unsigned integers are expected")
        if found.max() >= count:
            raise indices.refuse(f"a corner is vertex {found.max()} of {count}")
        return found.astype(np.int64)

    def _looks(
        self, node: Located, rows: Rows, faces: NDArray[np.int32], colors: NDArray[np.float64] | None, name: str
    ) -> tuple[NDArray[np.int32], NDArray[np.float64] | None, Attributes]:
        """The materials of the faces, and the texture coordinates and attributes that they look at."""
        look = self.materials.look(node, colors is not None, mirrored=False)
        material = self.reader.table.materials[look.index]
        materials = np.full(len(faces), look.index, np.int32)
        attributes = {}
        if colors is not None and VERTEX_COLOR in material.attributes:
            attributes[VERTEX_COLOR] = np.clip(colors[:, :3] * look.tint, 0.0, 1.0)
        if colors is not None and VERTEX_ALPHA in material.attributes:
            attributes[VERTEX_ALPHA] = np.clip(colors[:, 3:] if colors.shape[1] == 4 else np.ones((len(colors), 1)), 0.0, 1.0)
        if not material.uses_uvs:
            return materials, None, attributes
        uvs = rows(f"TEXCOORD_{look.uv_set}", 2)
        if uvs is None:
            self.notes.add(f"without TEXCOORD_{look.uv_set} it shows one texel of its textures", name)
            return materials, np.zeros((int(faces.max()) + 1, 2)), attributes
        if look.tilted and (turned := _turned(uvs[faces])).any():
            materials[turned] = self.materials.look(node, colors is not None, mirrored=True).index
        return materials, uvs, attributes

    def _weights(
        self, given: Located, used: NDArray[np.int64], count: int
    ) -> tuple[NDArray[np.int64] | None, NDArray[np.float64] | None]:
        joints, weights = [], []
        for index in range(MAX_WEIGHTS):
            a, b = optional(given, f"JOINTS_{index}"), optional(given, f"WEIGHTS_{index}")
            if a is None or b is None:
                break
            joints.append(self.document.array(a, ("VEC4",)))
            weights.append(self._floats(b, "VEC4"))
            if joints[-1].dtype.kind != "u" or len(joints[-1]) != count or len(weights[-1]) != count:
                raise a.refuse("unsigned integers, as many as POSITION has elements, and as many weights are expected")
        if not joints:
            return None, None
        return np.concatenate(joints, axis=1)[used].astype(np.int64), np.concatenate(weights, axis=1)[used]


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """(m, 3) of corners in a row."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
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


def _skin(primitive: Primitive, joints: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(n, 4, 4) the transforms of vertices; None of a primitive without weights."""
    if primitive.joints is None or primitive.weights is None:
        return None
    if primitive.joints.max() >= len(joints):
        raise primitive.node.refuse(f"has joint {primitive.joints.max()} of {len(joints)}")
    total = np.zeros((len(primitive.vertices), 4, 4))
    for joint, weight in zip(primitive.joints.T, primitive.weights.T, strict=True):
        total += weight[:, None, None] * joints[joint]
    return total
