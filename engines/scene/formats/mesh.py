"""Meshes from files: OBJ (with MTL) by our own reader, PLY and STL through trimesh.

OBJ is read here because trimesh sorts its faces by material, takes index 0 for 1, counts negative indices from the end
of the file, and drops what an MTL says beyond Kd. Faces keep the order of the file; polygons are cut into fans.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.input_files import open_regular, unreadable
from engines.scene.files import Place
from engines.scene.formats.mtl import read_mtl
from engines.scene.formats.obj import Polygons, parse_obj
from engines.scene.geometry import fans, unit_rows
from engines.scene.materials import Material
from engines.schema import fields
from engines.schema.yaml_file import Located

SUFFIXES = (".obj", ".ply", ".stl")
BYTES_PER_FILE_BYTE = {".obj": 32, ".ply": 12, ".stl": 8}
"""Memory at the height of reading, for each byte of a file."""
MAX_LIBRARIES = 1000
"""MTL files of an OBJ."""


@dataclass(frozen=True, slots=True)
class MeshData:
    """`vertices` (n, 3) float64, `faces` (m, 3) int32, unit vertex `normals` (n, 3) where asked for and there, and for
    files with materials `face_materials` (m,) indices into `materials`."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64] | None = None
    face_materials: NDArray[np.int32] | None = None
    materials: list[Material] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def read_mesh(node: Located, place: Place, smooth: bool, with_materials: bool) -> MeshData:
    """The mesh of the file named at `node`.

    `with_materials` takes them from the file, and refuses files that have none. Vertex normals are read only when
    `smooth`. Raises `SceneError` naming the file for whatever cannot be used.
    """
    file = place.find(node, fields.text(node))
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise node.refuse(f"unknown kind of mesh file: known: {', '.join(SUFFIXES)}")
    if with_materials and suffix != ".obj":
        raise node.refuse(f"a {suffix} file has no materials: name one beside 'mesh'")
    data = _content(node, file)
    if suffix == ".obj":
        return _read_obj(node, place, file, data, smooth, with_materials)
    return _read_with_trimesh(node, file, data, smooth)


def _content(node: Located, file: Path) -> bytes:
    try:
        with open_regular(file) as stream:
            size = os.fstat(stream.fileno()).st_size
            fields.refuse_above_memory(node, size * BYTES_PER_FILE_BYTE[file.suffix.lower()], "reading it")
            data = stream.read(size)
    except OSError as problem:
        raise node.refuse(unreadable(problem)) from problem
    if not data.strip():
        raise node.refuse("is empty")
    return data


def _read_obj(
    node: Located, place: Place, file: Path, data: bytes, smooth: bool, with_materials: bool
) -> MeshData:  # fmt: skip
    if b"\0" in data:
        raise node.refuse("is not an OBJ file: it holds binary data")
    polygons = parse_obj(data.decode("latin-1"), lambda line, wanted: _at_line(node, file, line, wanted))
    vertices, faces, normals = polygons.vertices, polygons.faces, None
    if smooth and polygons.face_normals is not None:
        vertices, faces, normals = _split_at_normals(node, polygons, polygons.face_normals)
    if not with_materials:
        return MeshData(vertices, faces, normals)
    materials, notes = _obj_materials(node, place, file, polygons)
    return MeshData(vertices, faces, normals, polygons.face_materials, materials, notes)


def _at_line(node: Located, file: Path, line: int, wanted: str) -> SceneError:
    return SceneError(f"{node.where}: {file}:{line}: {wanted}")


def _split_at_normals(
    node: Located, polygons: Polygons, face_normals: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]:
    """Vertices, faces and normals where each pair of a vertex and a normal that occurs is a vertex of its own."""
    if not np.isfinite(polygons.normals).all():
        raise node.refuse("has vertex normals that are infinite or not a number")
    pairs = polygons.faces.astype(np.int64) * len(polygons.normals) + face_normals
    unique, inverse = np.unique(pairs, return_inverse=True)
    vertex, normal = np.divmod(unique, len(polygons.normals))
    faces = inverse.reshape(-1, 3).astype(np.int32)
    return polygons.vertices[vertex], faces, unit_rows(polygons.normals[normal])


def _obj_materials(node: Located, place: Place, file: Path, polygons: Polygons) -> tuple[list[Material], list[str]]:
    """The materials in the order of `polygons.material_names`, and what to warn about."""
    if not polygons.libraries:
        raise node.refuse("names no MTL file: name a material beside 'mesh'")
    if len(polygons.libraries) > MAX_LIBRARIES:
        raise node.refuse(f"names {len(polygons.libraries)} MTL files: at most {MAX_LIBRARIES} are read")
    found: dict[str, Material] = {}
    notes: dict[str, list[str]] = {}
    files = dict.fromkeys(place.find(node, library, file.parent) for library in polygons.libraries)
    for path in files:
        materials, more = read_mtl(path, node)
        found |= materials
        for name, note in more:
            notes.setdefault(name, []).append(note)
    for name in polygons.material_names:
        if name == "":
            raise node.refuse("has faces before its first usemtl: name a material beside 'mesh'")
        if name not in found:
            raise node.refuse(f"uses material {name!r}, which is not in {_listed(polygons.libraries)}")
    names = polygons.material_names
    return [found[name] for name in names], [note for name in names for note in notes.get(name, ())]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def _read_with_trimesh(node: Located, file: Path, data: bytes, smooth: bool) -> MeshData:
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore")
            warnings.filterwarnings("error", message=".*could not be read to its end.*")
            found = _ply_parts(data) if file.suffix.lower() == ".ply" else _stl_parts(data)
            parts = [_arrays(part) for part in found]
    except Exception as problem:
        raise node.refuse(f"is not a usable {file.suffix[1:].upper()} file: {problem}") from problem
    if not any(len(part.faces) for part in parts):
        raise node.refuse("has no faces")
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = np.concatenate([
        _triangles(node, part.faces, len(part.vertices)) + start for part, start in zip(parts, starts[:-1], strict=True)
    ])  # fmt: skip
    _check_finite(node, vertices)
    normals = parts[0].normals if smooth and len(parts) == 1 else None
    if normals is not None:
        if not np.isfinite(normals).all():
            raise node.refuse("has vertex normals that are infinite or not a number")
        normals = unit_rows(normals)
    return MeshData(vertices, faces.astype(np.int32), normals)


class _Part(NamedTuple):
    vertices: NDArray[np.float64]
    faces: NDArray[Any]
    normals: NDArray[np.float64] | None


def _arrays(part: dict[str, Any]) -> _Part:
    """What trimesh found, as arrays; it gives lists and arrays of objects where a file is damaged."""
    vertices, normals = np.asarray(part["vertices"], np.float64), part.get("vertex_normals")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices of shape {vertices.shape}")
    return _Part(vertices, np.asarray(part["faces"]), None if normals is None else np.asarray(normals, np.float64))


def _ply_parts(data: bytes) -> list[dict[str, Any]]:
    from trimesh.exchange.ply import load_ply

    found = load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
    elements = found["metadata"]["_ply_raw"]
    for name, element in elements.items():
        _check_ply_element(name, element)
    if found.get("faces") is None:
        return []
    content = elements["face"]["data"]
    for name in ("vertex_index", "vertex_indices"):
        if isinstance(content, dict) and name in content and content[name].dtype == object:
            # polygons of several lengths: trimesh would put the triangles before the others
            counts = np.array([len(polygon) for polygon in content[name]], np.int64)
            found["faces"] = np.concatenate(content[name])[fans(counts)[0]]
    return [found]


def _check_ply_element(name: str, element: dict[str, Any]) -> None:
    """trimesh reads every list of a binary file at the length of the first: mixed polygons would become garbage."""
    content = element.get("data")
    if not isinstance(content, np.ndarray) or content.dtype.names is None:
        return
    for key in content.dtype.names:
        lists = content[key]
        if lists.dtype.names == ("f0", "f1") and lists["f1"].ndim == 2 and (lists["f0"] != lists["f1"].shape[1]).any():
            raise ValueError(f"element {name!r} mixes lists of several lengths: triangulate it, or save it as ASCII")


def _stl_parts(data: bytes) -> list[dict[str, Any]]:
    from trimesh.exchange.stl import load_stl

    found = load_stl(io.BytesIO(data))
    return [found] if "faces" in found else list(found.get("geometry", {}).values())


def _triangles(node: Located, faces: NDArray[Any], vertices: int) -> NDArray[np.int64]:
    """(m, 3) indices from polygons (n, k) cut into fans."""
    if faces.ndim != 2 or faces.shape[1] < 3 or faces.dtype.kind not in "iu":
        raise node.refuse("has faces that are no polygons")
    if ((faces < 0) | (faces >= vertices)).any():
        raise node.refuse(f"has a face with a vertex outside [0, {vertices - 1}]")
    fans = [faces[:, [0, corner, corner + 1]] for corner in range(1, faces.shape[1] - 1)]
    return np.stack(fans, axis=1).reshape(-1, 3).astype(np.int64)


def _check_finite(node: Located, vertices: NDArray[np.float64]) -> None:
    good = np.isfinite(vertices).all(axis=1)
    if not good.all():
        index = int(np.argmin(good))
        raise node.refuse(f"vertex {index} is {vertices[index].tolist()}: must be finite")
