"""Plants."""

from __future__ import annotations

import numpy as np

from engines.scene.geometry import unit_rows
from engines.scene.procedural import libm
from engines.scene.procedural.generator import BYTES_PER_FACE, Faces, generator, grid_faces
from engines.scene.procedural.pieces import PLACED, Array, Patch, joined, placed, seamless_normals, tangents_of
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POSITIVE, integer, one_of, within

GOLDEN = np.pi * (3.0 - 5.0**0.5)
"""The angle between a leaf and the next."""


def plant(
    leaves: int,
    stem: float,
    length: float,
    width: float,
    spread: float,
    droop: float,
    crease: float,
    segments: int,
    part: str,
    seed: int,
    center: Triple,
    tilt: float,
    rotate_y: float,
) -> Faces:
    """Leaves on arching stems that rise from one foot, the first upright and the last outwards.

    Part `leaves` are blades, cut to a pointed oval: texture coordinate u goes across a blade and v from its tip to its stem.
    Part `stems` are the stalks below them.
    """
    random = np.random.default_rng(seed)
    turns = GOLDEN * np.arange(leaves) + random.uniform(-0.3, 0.3, leaves)
    order = (np.arange(leaves) + 0.5) / leaves
    rising = np.radians(88.0 - spread * order + random.uniform(-5.0, 5.0, leaves))
    sizes = random.uniform(0.75, 1.1, leaves)
    stems = stem * (1.0 - 0.45 * order) * random.uniform(0.85, 1.15, leaves)
    make = _blade if part == "leaves" else _stalk
    patches = []
    for turn, angle, size, stalk, bend in zip(turns, rising, sizes, stems, random.uniform(0.7, 1.3, leaves), strict=True):
        path = _arch(stalk, size * length, angle, np.radians(droop) * bend, segments)
        out = np.array([np.cos(turn), 0.0, -np.sin(turn)])
        points = path[:, :1] * out + path[:, 1:] * np.array([0.0, 1.0, 0.0])
        side = np.array([np.sin(turn), 0.0, np.cos(turn)])
        patches.append(make(points, side, size * width, crease, segments))
    return placed(joined(patches, "plant"), tilt, rotate_y, center)


def _arch(stem: float, blade: float, angle: float, droop: float, segments: int) -> Array:
    """(2 segments + 1, 2): distance from the axis and height along a stem and the blade on it, which bends down."""
    s = np.concatenate([np.linspace(0.0, stem, segments + 1), stem + np.linspace(0.0, blade, segments + 1)[1:]])
    fall = angle - droop * (s / (stem + blade)) ** 2
    middle, steps = 0.5 * (fall[1:] + fall[:-1]), np.diff(s)[:, None]
    ways = np.stack([np.cos(middle), np.sin(middle)], axis=1) * steps
    return np.concatenate([np.zeros((1, 2)), np.cumsum(ways, axis=0)])


def _blade(points: Array, side: Array, width: float, crease: float, segments: int) -> Patch:
    path = points[segments:]
    t = np.linspace(0.0, 1.0, segments + 1)
    rise = np.sin(np.pi * libm.power(t, 0.75))
    half = 0.5 * width * libm.power(rise, 0.8) + 0.004 * width
    up = unit_rows(np.cross(np.broadcast_to(side, path.shape), tangents_of(path)))
    up = np.where(up[:, 1:2] < 0.0, -up, up)
    across = np.linspace(-1.0, 1.0, 5)
    lifted = crease * np.abs(across)[None, :, None] * half[:, None, None] * up[:, None]
    vertices = path[:, None] + across[None, :, None] * half[:, None, None] * side + lifted
    u = 0.5 + 0.5 * across[None, :] * (half / half.max())[:, None]
    uvs = np.stack(np.broadcast_arrays(u, 1.0 - t[:, None]), axis=2)
    faces = grid_faces(segments, 4)[:, [0, 2, 1]]
    flat = vertices.reshape(-1, 3)
    return Patch(flat, seamless_normals(flat, faces), uvs.reshape(-1, 2), faces)


def _stalk(points: Array, side: Array, width: float, crease: float, segments: int) -> Patch:
    path = points[: segments + 1]
    along = tangents_of(path)
    other = np.cross(along, side)
    angle = np.linspace(0.0, 2.0 * np.pi, 7)
    ring = np.cos(angle)[None, :, None] * side + np.sin(angle)[None, :, None] * other[:, None]
    radius = np.linspace(0.045, 0.025, len(path))[:, None, None] * width
    faces = grid_faces(segments, 6)[:, [0, 2, 1]]
    uvs = np.full((len(path) * 7, 2), 0.5)
    return Patch((path[:, None] + radius * ring).reshape(-1, 3), unit_rows(ring.reshape(-1, 3)), uvs, faces)


GENERATORS = {
    "plant": generator(
        plant,
        {
            "leaves": Key(integer(1, 1 << 20), "How many leaves.", 24),
            "stem": Key(POSITIVE, "Length of the first stem; the last has about half.", 0.5, unit="metres"),
            "length": Key(POSITIVE, "Length of a blade.", 0.3, unit="metres"),
            "width": Key(POSITIVE, "Width of a blade.", 0.14, unit="metres"),
            "spread": Key(within(0, 90), "How far the last leaf leans out from the first.", 50.0, unit="degrees"),
            "droop": Key(within(0, 180), "How far the tips bend down.", 70.0, unit="degrees"),
            "crease": Key(within(0, 2), "Slope of the two halves of a blade.", 0.25),
            "segments": Key(integer(1, 1 << 12), "Segments along a blade, and along a stem.", 10),
            "part": Key(one_of(("leaves", "stems"), "part"), "What is made: leaves or stems.", "leaves"),
            "seed": Key(integer(0, 2**32 - 1), "Seed of the random numbers.", 0),
            **PLACED,
        },
        lambda options: 12.0 * BYTES_PER_FACE * options["leaves"] * options["segments"],
    )
}
