"""Meshes as binary PLY."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

UNIT_NORMALS = b"comment raybench: normals are of length 1"
"""A file with this line was written here: its normals are kept to the last bit."""


def ply_bytes(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    normals: NDArray[np.float64] | None,
    uvs: NDArray[np.float64] | None,
    face_materials: NDArray[np.int32] | None,
) -> bytes:
    """A PLY file of triangles: float64 coordinates, normals and texture coordinates u, v; of each face its vertices and, where
    given, its material."""
    columns = [vertices, *([] if normals is None else [normals]), *([] if uvs is None else [uvs])]
    names = ["x", "y", "z", *([] if normals is None else ["nx", "ny", "nz"]), *([] if uvs is None else ["u", "v"])]
    lines = [b"ply", b"format binary_little_endian 1.0", UNIT_NORMALS, f"element vertex {len(vertices)}".encode()]
    lines += [f"property double {name}".encode() for name in names]
    lines += [f"element face {len(faces)}".encode(), b"property list uchar int vertex_indices"]
    row = [("count", "u1"), ("corners", "<i4", 3)]
    if face_materials is not None:
        lines += [b"property int material"]
        row += [("material", "<i4")]
    table = np.zeros(len(faces), row)
    table["count"], table["corners"] = 3, faces
    if face_materials is not None:
        table["material"] = face_materials
    head = b"\n".join([*lines, b"end_header", b""])
    return head + np.concatenate(columns, axis=1).astype("<f8").tobytes() + table.tobytes()
