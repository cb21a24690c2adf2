"""Meshes as binary PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

UNIT_NORMALS = b"comment raybench: normals are of length 1"
"""A file with this line was written here: its normals are kept to the last bit."""


def write_ply(
    path: Path,
    vertices: NDArray[np.floating],
    faces: NDArray[np.integer],
    normals: NDArray[np.floating] | None = None,
    uvs: NDArray[np.floating] | None = None,
    face_materials: NDArray[np.int32] | None = None,
    exact: bool = False,
) -> None:
    """Writes a file of triangles: `vertices` (n, 3), `normals` (n, 3) and texture coordinates (n, 2), of each of the `faces`
    (m, 3) its vertices and, where given, its material.

    Numbers are float32, the precision in which other renderers read them; float64 with `exact`, whose normals raybench then
    reads to the last bit. Raises `OSError`.
    """
    columns = [vertices, *([] if normals is None else [normals]), *([] if uvs is None else [uvs])]
    names = ["x", "y", "z", *([] if normals is None else ["nx", "ny", "nz"]), *([] if uvs is None else ["u", "v"])]
    kind, real = ("double", "<f8") if exact else ("float", "<f4")
    lines = [b"ply", b"format binary_little_endian 1.0", *([UNIT_NORMALS] if exact else [])]
    lines += [f"element vertex {len(vertices)}".encode(), *(f"property {kind} {name}".encode() for name in names)]
    lines += [f"element face {len(faces)}".encode(), b"property list uchar int vertex_indices"]
    row = [("count", "u1"), ("corners", "<i4", 3)]
    if face_materials is not None:
        lines += [b"property int material"]
        row += [("material", "<i4")]
    table = np.zeros(len(faces), row)
    table["count"], table["corners"] = 3, faces
    if face_materials is not None:
        table["material"] = face_materials
    with path.open("wb") as file:
        file.write(b"\n".join([*lines, b"end_header", b""]))
        file.write(np.concatenate(columns, axis=1).astype(real).tobytes())
        file.write(table.tobytes())
