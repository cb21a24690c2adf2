"""Meshes from files: OBJ (with MTL), PLY, STL and Mitsuba's serialized.

Faces keep the order of the file; polygons are cut into fans.
"""

from __future__ import annotations

import os
import struct
from codecs import BOM_UTF8
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from engines.errors import RaybenchError, SceneError
from engines.input_files import open_regular, unreadable
from engines.memory import lacking_memory
from engines.scene.attributes import Attributes, checked_attributes
from engines.scene.formats import FileMesh
from engines.scene.formats.mtl import read_mtl
from engines.scene.formats.obj import Polygons, parse_obj
from engines.scene.formats.ply import parse_ply
from engines.scene.formats.serialized import parse_serialized
from engines.scene.formats.stl import parse_stl
from engines.scene.geometry import unit_rows
from engines.scene.materials import Material
from engines.schema import fields
from engines.schema.yaml_file import Located

SUFFIXES = (".obj", ".ply", ".stl", ".serialized")
BYTES_PER_FILE_BYTE = {".obj": 32, ".ply": 12, ".stl": 8, ".serialized": 2}
"""Memory at the height of reading, for each byte of a file."""
NAMES = {".ply": "PLY", ".stl": "STL"}
"""Of formats, where messages call them otherwise than files do."""
NOT_FINITE = "has vertex normals that are infinite or not a number"
MAX_LIBRARIES = 1000
"""MTL files of an OBJ."""


class At(Protocol):
    """Where a file is named: what messages begin with, and the error for the file."""

    @property
    def where(self) -> str:
        """The place, for the beginning of a message."""
        ...

    def refuse(self, expected: str) -> RaybenchError:
        """The error to raise: the place, the file's name and what is expected."""
        ...


@dataclass(frozen=True, slots=True)
class MeshData:
    """`vertices` (n, 3) float64, `faces` (m, 3) int32, unit vertex `normals` (n, 3), zeros where the file gives none, and
    texture coordinates `uvs` (n, 2) where asked for and there, and for files with materials `face_materials` (m,) indices into
    `materials`, or, of a PLY, as they stand there.

    `attributes` are those asked for that the file has, as of a `Mesh`.

    Where vertices of the file have been split for normals or texture coordinates, `origins` (n,) are their indices there.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64] | None = None
    uvs: NDArray[np.float64] | None = None
    face_materials: NDArray[np.int32] | None = None
    materials: list[Material] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    origins: NDArray[np.int64] | None = None
    attributes: Attributes = field(default_factory=dict)


def read_mesh(
    node: Located,
    context: Any,
    smooth: bool,
    uvs: bool,
    with_materials: bool,
    shape_index: int = 0,
    attributes: Collection[str] = (),
) -> MeshData:
    """The mesh of the file named at `node`; `context` is a `SceneReader`.

    `with_materials` takes them from the file, and refuses files that have none. Vertex normals are read only when
    `smooth`, texture coordinates when `uvs` or when the file's own materials look at them; v of an OBJ becomes 1 - v. Raises
    `SceneError` naming the file for whatever cannot be used.
    """
    file = context.place.find(node, fields.text(node))
    if not with_materials:
        return read_mesh_file(node, file, smooth, uvs, shape_index, attributes=attributes)
    suffix = mesh_suffix(node, file)
    if suffix != ".obj":
        raise node.refuse(f"a {suffix} file has no materials: name one beside 'mesh'")
    polygons = _obj(node, file)
    materials, notes = _obj_materials(node, context, file, polygons)
    uvs = any(material.uses_uvs for material in materials)
    data = _obj_mesh(node, file, polygons, smooth, uvs, flip_v=True)
    return replace(data, face_materials=polygons.face_materials, materials=materials, warnings=[*notes, *data.warnings])


def mesh_suffix(at: At, file: Path) -> str:
    """The suffix of a mesh file, which says its format."""
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise at.refuse(f"unknown kind of mesh file: known: {', '.join(SUFFIXES)}")
    return suffix


def read_mesh_file(
    at: At,
    file: Path,
    normals: bool,
    uvs: bool,
    shape_index: int = 0,
    flip_v: bool = True,
    suffix: str = "",
    attributes: Collection[str] = (),
) -> MeshData:
    """The mesh of a file, whatever materials it has: with its vertex normals, its texture coordinates and those `attributes`
    that are asked for and there.

    `flip_v` makes v of an OBJ 1 - v; `shape_index` is that of a `.serialized` file; `suffix` says another format than the
    file's name. Raises `SceneError`, with the file where `at` does not name it.
    """
    suffix = suffix or mesh_suffix(at, file)
    if suffix == ".obj":
        return _obj_mesh(at, file, _obj(at, file), normals, uvs, flip_v)
    data = _content(at, file, suffix)
    try:
        if suffix == ".serialized":
            mesh = parse_serialized(data, shape_index, lambda needed: _check_memory(at, needed))
        else:
            mesh = (parse_ply if suffix == ".ply" else parse_stl)(data)
    except (ValueError, struct.error) as problem:
        raise at.refuse(f"is not a usable {NAMES.get(suffix, suffix[1:])} file: {problem}") from problem
    return _checked(at, mesh, normals, uvs, attributes)


def _checked(at: At, mesh: FileMesh, with_normals: bool, with_uvs: bool, with_attributes: Collection[str]) -> MeshData:
    """The mesh with normals of length 1. Raises what `at` refuses."""
    vertices, faces, normals, uvs, materials, exact, attributes = mesh
    if len(faces) == 0:
        raise at.refuse("has no faces")
    if ((faces < 0) | (faces >= len(vertices))).any():
        raise at.refuse(f"has a face with a vertex outside [0, {len(vertices) - 1}]")
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        index = int(np.argmin(finite))
        raise at.refuse(f"vertex {index} is {vertices[index].tolist()}: must be finite")
    data = MeshData(vertices, faces.astype(np.int32))
    if with_normals and normals is not None:
        if not np.isfinite(normals).all():
            raise at.refuse(NOT_FINITE)
        kept = exact and np.allclose(np.linalg.norm(normals, axis=1), 1.0, 0.0, 1e-9)
        data = replace(data, normals=normals if kept else unit_rows(normals))
    if with_uvs and uvs is not None:
        uvs, notes = _finite_uvs(at.where, uvs)
        data = replace(data, uvs=uvs, warnings=notes)
    if shown := {name: values for name, values in attributes.items() if name in with_attributes}:
        data = replace(data, attributes=_attributes(at, shown, len(vertices), len(faces)))
    return data if materials is None or len(materials) != len(faces) else replace(data, face_materials=materials)


def _attributes(at: At, attributes: Mapping[str, NDArray[np.floating] | str], vertices: int, faces: int) -> Attributes:
    for name, values in attributes.items():
        if isinstance(values, str):
            raise at.refuse(f"attribute {name!r}: {values}")
    try:
        return checked_attributes(attributes, vertices, faces)
    except ValueError as problem:
        raise at.refuse(str(problem)) from problem


def _content(at: At, file: Path, suffix: str) -> bytes:
    try:
        with open_regular(file) as stream:
            size = os.fstat(stream.fileno()).st_size
            _check_memory(at, size * BYTES_PER_FILE_BYTE[suffix])
            data = stream.read(size)
    except OSError as problem:
        raise at.refuse(unreadable(problem)) from problem
    data = data.removeprefix(BOM_UTF8) if suffix in (".obj", ".ply") or data[3:8] == b"solid" else data
    if not data.strip():
        raise at.refuse("is empty")
    return data


def _check_memory(at: At, needed: float) -> None:
    if lacks := lacking_memory(needed):
        raise at.refuse(f"reading it {lacks}")


def _obj(at: At, file: Path) -> Polygons:
    data = _content(at, file, ".obj")
    if b"\0" in data:
        raise at.refuse("is not an OBJ file: it holds binary data")
    return parse_obj(data.decode("latin-1"), lambda line, expected: _at_line(at, file, line, expected))


def _at_line(at: At, file: Path, line: int, expected: str) -> SceneError:
    return SceneError(f"{at.where}: {file}:{line}: {expected}")


def _obj_mesh(at: At, file: Path, polygons: Polygons, normals: bool, uvs: bool, flip_v: bool) -> MeshData:
    """The mesh, in which each combination of a vertex, a normal and a texture coordinate that occurs is a vertex of its own."""
    data = MeshData(polygons.vertices, polygons.faces)
    if uvs and polygons.texture is not None:
        coordinates, corners = polygons.texture.read(lambda line, expected: _at_line(at, file, line, expected))
        if flip_v:
            coordinates[:-1, 1] = 1.0 - coordinates[:-1, 1]
        data, picked = _split(data, corners, len(coordinates))
        good, notes = _finite_uvs(file.name, coordinates[picked])
        data = replace(data, uvs=good, warnings=notes)
    if normals and polygons.face_normals is not None:
        if not np.isfinite(polygons.normals).all():
            raise at.refuse(NOT_FINITE)
        data, picked = _split(data, polygons.face_normals, len(polygons.normals))
        data = replace(data, normals=unit_rows(polygons.normals[picked]))
    return data


def _split(data: MeshData, corners: NDArray[np.int32], count: int) -> tuple[MeshData, NDArray[np.int64]]:
    """The mesh with a vertex for each pair of a vertex and of one of `count` things that its corners (m, 3) have, and which
    thing each vertex then has."""
    pairs = data.faces.astype(np.int64) * count + corners
    unique, inverse = np.unique(pairs, return_inverse=True)
    vertex, thing = np.divmod(unique, count)
    return replace(
        data,
        vertices=data.vertices[vertex],
        faces=inverse.reshape(-1, 3).astype(np.int32),
        uvs=None if data.uvs is None else data.uvs[vertex],
        origins=vertex if data.origins is None else data.origins[vertex],
    ), thing


def _finite_uvs(name: str, uvs: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[str]]:
    wrong = np.flatnonzero(~np.isfinite(uvs).all(axis=1))
    if len(wrong) == 0:
        return uvs, []
    uvs = uvs.copy()
    uvs[wrong] = 0.0
    return uvs, [f"{name}: {len(wrong)} texture coordinates are infinite or not a number: they are taken as (0, 0)"]


def _obj_materials(node: Located, context: Any, file: Path, polygons: Polygons) -> tuple[list[Material], list[str]]:
    """The materials in the order of `polygons.material_names`, and what to warn about."""
    if not polygons.libraries:
        raise node.refuse("names no MTL file: name a material beside 'mesh'")
    if len(polygons.libraries) > MAX_LIBRARIES:
        raise node.refuse(f"names {len(polygons.libraries)} MTL files: at most {MAX_LIBRARIES} are read")
    known: dict[str, Material] = {}
    notes: dict[str, list[str]] = {}
    files = dict.fromkeys(context.place.find(node, library, file.parent) for library in polygons.libraries)
    for path in files:
        materials, more = read_mtl(path, node, context)
        known |= materials
        for name, note in more:
            notes.setdefault(name, []).append(note)
    for name in polygons.material_names:
        if name == "":
            raise node.refuse("has faces before its first usemtl: name a material beside 'mesh'")
        if name not in known:
            raise node.refuse(f"uses material {name!r}, which is not in {_listed(polygons.libraries)}")
    names = polygons.material_names
    return [known[name] for name in names], [note for name in names for note in notes.get(name, ())]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more
