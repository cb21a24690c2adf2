"""The leaves of the eight-wide tree: primitives of one kind, field by field, so that a vector holds one field of all.

The n primitives of a leaf lie at `stride` times the place of the first: nine rows of n reals for triangles (the corners), or
four of n float64 for spheres, and then their ranks. Rows are read eight wide whatever n is; what lies behind is masked.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.jit import keep, kernel, pointer
from engines.kernels.world import SPHERE_RANK, SPHERES, TRIANGLE_RANK, TRIANGLES, VERTICES, World

SPILL = 64
"""Bytes behind the last leaf that its rows may read."""


def stride(real: Any) -> int:
    """Bytes of a primitive, a multiple of eight."""
    return 40 if real == np.float32 else 80


def empty_leaves(n: int, real: Any) -> NDArray[np.uint8]:
    return np.zeros(n * stride(real) + SPILL, np.uint8)


def fill_leaves(leaves: NDArray[np.int32], order: NDArray[np.int32], world: World, data: NDArray[np.uint8]) -> None:
    """Writes the given `leaves` (k, 3): first, count, 1 for spheres."""
    a = world.arrays
    shapes = a[VERTICES], a[TRIANGLES], a[TRIANGLE_RANK], a[SPHERES], a[SPHERE_RANK]
    (_fill32 if world.real == np.float32 else _fill64)(leaves, order, *shapes, data)


def _make_fill(real: Any) -> Any:
    bytes_each, row_bytes = stride(real), 9 * np.dtype(real).itemsize

    def fill(leaves, order, vertices, faces, face_ranks, spheres, sphere_ranks, data):
        for leaf in range(len(leaves)):
            first, n, sphere = np.int64(leaves[leaf, 0]), np.int64(leaves[leaf, 1]), leaves[leaf, 2] == 1
            base = data.ctypes.data + first * bytes_each
            reals, doubles = pointer(base, real), pointer(base, np.float64)
            ranks = pointer(base + n * (32 if sphere else row_bytes), np.int32)
            for k in range(n):
                i = np.int64(order[first + k])
                if sphere:
                    i -= len(faces)
                    for field in range(4):
                        keep(doubles, field * n + k, spheres[i, field])
                    keep(ranks, k, sphere_ranks[i])
                    continue
                for corner in range(3):
                    for axis in range(3):
                        keep(reals, (3 * corner + axis) * n + k, vertices[faces[i, corner], axis])
                keep(ranks, k, face_ranks[i])

    return kernel(fill)


_fill32, _fill64 = _make_fill(np.float32), _make_fill(np.float64)
