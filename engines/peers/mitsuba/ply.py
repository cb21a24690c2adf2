"""Binary PLY files, in which meshes reach Mitsuba."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def write_ply(path: Path, vertices: Array, faces: Array, normals: Array | None = None, uvs: Array | None = None) -> None:
    """Vertices (n, 3) in float32, the precision of whoever reads it; faces (m, 3) int32; normals (n, 3), uvs (n, 2) or None."""
    columns = [vertices] + [values for values in (normals, uvs) if values is not None]
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else []) + (["u", "v"] if uvs is not None else [])
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = np.empty(len(faces), np.dtype([("count", "u1"), ("index", "<i4", 3)]))
    rows["count"], rows["index"] = 3, faces
    with open(path, "wb") as file:
        file.write(("\n".join(lines) + "\n").encode())
        file.write(np.ascontiguousarray(np.concatenate(columns, axis=1), "<f4").tobytes())
        file.write(rows.tobytes())
