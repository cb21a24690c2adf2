"""The leaves of the eight-wide tree: primitives of one kind, field by field, so that a vector holds one field of all.

The n primitives of a leaf lie at `stride` times the place of the first: nine rows of n reals for triangles (the corners), or
four of n float64 for spheres, and then their ids; for analytic shapes ids, and then indices among the scene's. Rows are read
eight wide whatever n is; what lies behind is masked.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import kernel
from engines.kernels.compile.memory import array_at
from engines.kernels.flatten import FlatScene
from engines.kernels.layout import SceneTable
from engines.numba_cpu.accel.bvh_build import ANALYTIC, SPHERES

SPILL = 64
"""Bytes behind the last leaf that its rows may read."""


def stride(real: Any) -> int:
    """Bytes of a primitive, a multiple of eight."""
    return 40 if real == np.float32 else 80


def empty_leaves(n: int, real: Any) -> NDArray[np.uint8]:
    return np.zeros(n * stride(real) + SPILL, np.uint8)


def fill_leaves(leaves: NDArray[np.int32], order: NDArray[np.int32], flat: FlatScene, data: NDArray[np.uint8]) -> None:
    """Writes the given `leaves` (k, 4), see `widen`, of a part of a scene."""
    fields = (
        *(SceneTable.vertices, SceneTable.triangles, SceneTable.triangle_primitives, SceneTable.spheres),
        *(SceneTable.sphere_primitives, SceneTable.analytic_primitives),
    )
    arrays = (flat.arrays[field] for field in fields)
    (_fill32 if flat.real == np.float32 else _fill64)(leaves, order, *arrays, flat.begins[0].analytic, data)


def _make_fill(real: Any) -> Any:
    bytes_each, row_bytes = stride(real), 9 * np.dtype(real).itemsize

    def fill(leaves, order, vertices, faces, face_ids, spheres, sphere_ids, analytic_ids, first_analytic, data):
        for leaf in range(len(leaves)):
            first, n, kind = np.int64(leaves[leaf, 0]), np.int64(leaves[leaf, 1]), leaves[leaf, 2]
            base = data.ctypes.data + np.int64(leaves[leaf, 3]) * bytes_each
            if kind == ANALYTIC:
                words = array_at(base, np.int32)
                for k in range(n):
                    i = np.int64(order[first + k]) - len(faces) - len(spheres)
                    words[k], words[n + k] = analytic_ids[i], first_analytic + i
                continue
            sphere = kind == SPHERES
            reals, doubles = array_at(base, real), array_at(base, np.float64)
            ids = array_at(base + n * (32 if sphere else row_bytes), np.int32)
            for k in range(n):
                i = np.int64(order[first + k])
                if sphere:
                    i -= len(faces)
                    for field in range(4):
                        doubles[field * n + k] = spheres[i, field]
                    ids[k] = sphere_ids[i]
                    continue
                for corner in range(3):
                    for axis in range(3):
                        reals[(3 * corner + axis) * n + k] = vertices[faces[i, corner], axis]
                ids[k] = face_ids[i]

    return kernel(fill)


_fill32, _fill64 = _make_fill(np.float32), _make_fill(np.float64)
