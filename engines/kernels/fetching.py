"""From the world into the block: plain loads, a lane at a time.

Stages read all they need of the world in a loop of its own and compute in the next. A table read inside the loop that
computes keeps it from becoming vector code where the machine has no fast gather: the surface stage took seven times as
long on AVX2.
"""

from __future__ import annotations

import numpy as np

from engines.kernels import block as at
from engines.kernels.jit import fetch, inline, put, table
from engines.kernels.world import TRIANGLES, VERTICES


@inline
def copy(lanes, field, lane, values, place, n):
    """Copies n numbers of a table into the fields of one lane."""
    for k in range(n):
        put(lanes, field + k, lane, fetch(values, place + k))


@inline
def fetch_corners(lanes, lane, world, face, real):
    """The corners of a triangle, by its index among the triangles."""
    vertices, faces = table(world, VERTICES, real), table(world, TRIANGLES, np.int32)
    for corner in range(3):
        vertex = 3 * np.int64(fetch(faces, 3 * face + corner))
        copy(lanes, at.CORNER + 3 * corner, lane, vertices, vertex, 3)
