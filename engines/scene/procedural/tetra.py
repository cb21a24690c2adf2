"""The tetrahedron of tetrahedra of Haines' Standard Procedural Databases: Sierpinski's, in space."""

from __future__ import annotations

import numpy as np

from engines.scene.procedural.generator import BYTES_PER_FACE, CENTER, RADIUS, Faces, generator
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import integer

CORNERS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], np.int32)


def tetra(level: int, center: Triple, radius: float) -> Faces:
    """4^(level - 1) regular tetrahedra, closed and facing outwards, that touch in their corners.

    Each of one level becomes four of half its size in its corners; `radius` is that of the sphere around them all.
    """
    middles, size = np.zeros((1, 3)), 1.0
    for _ in range(level - 1):
        size /= 2.0
        middles = (middles[:, None] + size * CORNERS).reshape(-1, 3)
    vertices = (middles[:, None] + size * CORNERS).reshape(-1, 3) * radius + np.array(center)
    faces = FACES + 4 * np.arange(len(middles), dtype=np.int32)[:, None, None]
    return Faces(vertices, faces.reshape(-1, 3), "tetra")


GENERATORS = {
    "tetra": generator(
        tetra,
        {"level": Key(integer(1, 30), "Generations; 4^level faces.", 4), "center": CENTER, "radius": RADIUS},
        lambda options: BYTES_PER_FACE * 4.0 ** options["level"],
    )
}
