"""Readers of files that scenes name: meshes with their materials (OBJ with MTL, PLY, STL, serialized), and images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class FileMesh(NamedTuple):
    """Triangles as a file has them, not yet checked: `vertices` (n, 3), and `faces` (m, 3) integers, which may be out of range.

    Where the file has them: `normals` (n, 3), of length 1 if it says that they are `exact`; texture coordinates `uvs` (n, 2);
    `face_materials` (m,); `attributes` by name, (n, 1 or 3) or (m, 1 or 3), and of those that cannot be used the reasons.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.integer]
    normals: NDArray[np.float64] | None = None
    uvs: NDArray[np.float64] | None = None
    face_materials: NDArray[np.int32] | None = None
    exact: bool = False
    attributes: Mapping[str, NDArray[np.floating] | str] = {}
