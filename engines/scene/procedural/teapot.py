"""The Utah teapot (Newell 1975) from its 32 bicubic Bezier patches.

Of its 306 published control points 290 are different ones that a patch uses: the others are written twice or unused. Rim,
body, lid and bottom are four quarters about the axis, each a profile in radius and height; handle and spout are two
halves each. Here z is up, as published; `teapot` stands it on y = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.scene.procedural.generator import BYTES_PER_FACE, ORIGIN, ROTATE_Y, Faces, generator, grid_faces, grid_uvs, turned
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POINT, POSITIVE, integer

HEIGHT = 3.15
ROUND = 0.56
"""A quarter of a round part has control points (r, 0), (r, c), (c, r), (0, r) with c = 0.56 r, but for one ring."""
PROFILES = (
    ((1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)),  # rim
    ((1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9)),  # upper body
    ((2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15)),  # lower body
    ((0.0, 3.15), (0.8, 3.15), (0.0, 2.85), (0.2, 2.7)),  # knob of the lid
    ((0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)),  # lid
    ((1.5, 0.15), (1.5, 0.075), (1.425, 0.0), (0.0, 0.0)),  # bottom
)
"""(radius, height) from the top downwards."""
UNLIKE_OTHERS = {(0.8, 3.15): 0.45}
"""The c of the ring that does not keep to 0.56."""
HANDLE = (
    ((-1.6, 2.025), (-1.5, 2.25), 0.3),
    ((-2.3, 2.025), (-2.5, 2.25), 0.3),
    ((-2.7, 2.025), (-3.0, 2.25), 0.3),
    ((-2.7, 1.8), (-3.0, 1.8), 0.3),
    ((-2.7, 1.575), (-3.0, 1.35), 0.3),
    ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
    ((-2.0, 0.9), (-1.9, 0.6), 0.3),
)
SPOUT = (
    ((1.7, 1.425), (1.7, 0.6), 0.66),
    ((2.6, 1.425), (3.1, 0.825), 0.66),
    ((2.3, 2.1), (2.4, 2.025), 0.25),
    ((2.7, 2.4), (3.3, 2.4), 0.25),
    ((2.8, 2.475), (3.525, 2.49375), 0.25),
    ((2.9, 2.475), (3.45, 2.5125), 0.15),
    ((2.8, 2.4), (3.2, 2.4), 0.15),
)
"""Sections along handle and spout: (x, z) of the inner and of the outer end, and half the width between them."""


def patches() -> NDArray[np.float64]:
    """(32, 4, 4, 3) control points; the front is d/drow x d/dcolumn, on the outside."""
    quarters = [_quarter(profile) for profile in PROFILES]
    pieces = [_spun(quarter, turn) for quarter in quarters for turn in range(4)]
    for sections in (HANDLE, SPOUT):
        for side in (1.0, -1.0):
            around = np.array([_half_section(*section, side) for section in sections])
            ordered = around if side > 0 else around[:, ::-1]
            pieces += [ordered[:4], ordered[3:]]
    return np.array(pieces)


def _quarter(profile: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """(4, 4, 3): rows down the profile, columns from +x to +y."""
    rows = []
    for r, z in profile:
        c = UNLIKE_OTHERS.get((r, z), ROUND * r)
        rows.append([(r, 0.0, z), (r, c, z), (c, r, z), (0.0, r, z)])
    return np.array(rows)


def _spun(quarter: NDArray[np.float64], turn: int) -> NDArray[np.float64]:
    """A quarter turned by `turn` right angles about z."""
    x, y, z = np.moveaxis(quarter, -1, 0)
    for _ in range(turn):
        x, y = -y, x
    return np.stack([x, y, z], axis=-1)


def _half_section(inner: tuple[float, float], outer: tuple[float, float], width: float, side: float) -> list[Triple]:
    """Four control points around one side of a section, from inside to outside."""
    (x0, z0), (x1, z1), y = inner, outer, width * side
    return [(x0, 0.0, z0), (x0, y, z0), (x1, y, z1), (x1, 0.0, z1)]


def teapot(segments: int, center: Triple, height: float, rotate_y: float) -> Faces:
    """`segments` squared quadrangles a patch, each two triangles, without those of no area at knob and bottom.

    Vertices that patches share are one. The surface is not closed: the lid lies loosely, handle and spout end inside the
    body, and the spout is open. Every patch has the whole square of texture coordinates.
    """
    t = np.linspace(0.0, 1.0, segments + 1)
    u = 1 - t
    bernstein = np.stack([u * u * u, 3 * t * u * u, 3 * t * t * u, t * t * t], axis=1)
    points = np.einsum("ui,vj,pijk->puvk", bernstein, bernstein, patches()).reshape(-1, 3)
    x, y, z = (points * (height / HEIGHT)).T
    vertices = turned(np.stack([x, z, -y], axis=1), rotate_y)
    faces = grid_faces(segments, segments) + (segments + 1) ** 2 * np.arange(32, dtype=np.int32)[:, None, None]
    _, first, same = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    faces = same.astype(np.int32).ravel()[faces.reshape(-1, 3)]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)

    def uvs() -> NDArray[np.float64]:
        return np.tile(grid_uvs(segments, segments)[grid_faces(segments, segments)], (32, 1, 1))[~flat]

    return Faces(vertices[first] + np.array(center), faces[~flat], "teapot", uvs)


GENERATORS = {
    "teapot": generator(
        teapot,
        {
            "segments": Key(integer(1, 1 << 14), "Segments along each side of a patch; about 64 segments^2 faces.", 8),
            "center": Key(POINT, "The middle of its bottom.", ORIGIN, unit="metres"),
            "height": Key(POSITIVE, "Height from the bottom to the top of the knob.", 1.0, unit="metres"),
            "rotate_y": ROTATE_Y,
        },
        lambda options: 2.0 * BYTES_PER_FACE * 64.0 * options["segments"] ** 2,
    )
}
