"""The meshing gears of Haines' Standard Procedural Databases."""

from __future__ import annotations

import numpy as np

from engines.scene.procedural.generator import BYTES_PER_FACE, CENTER, Faces, generator, quads
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POSITIVE, integer

TEETH = 36
"""A multiple of four, so that a gear turned by half a tooth meshes with its neighbours on all four sides."""
ROOT, TIP = 0.94, 1.05
"""Radii of a gear, as shares of half the distance of two neighbours: a tip ends before the other's root."""
FACES_PER_GEAR = 16 * TEETH
LAYERS = 0.6
"""Distance of two layers, as a share of the distance of two neighbours; a gear is half as thick."""


def gears(level: int, center: Triple, radius: float) -> Faces:
    """level^3 gears, closed and facing outwards, in layers along z; `radius` is half the distance of two neighbours."""
    place = np.arange(level) - (level - 1) / 2
    middles = 2 * radius * np.stack(np.meshgrid(place, place, LAYERS * place, indexing="ij"), axis=-1).reshape(-1, 3)
    columns, rows, _ = np.indices((level, level, level)).reshape(3, -1)
    vertices = radius * np.stack([_gear(0.0), _gear(0.5)])[(columns + rows) % 2] + middles[:, None]
    faces = _gear_faces() + (len(_gear(0.0)) * np.arange(len(middles), dtype=np.int32))[:, None, None]
    return Faces(vertices.reshape(-1, 3) + np.array(center), faces.reshape(-1, 3), "gears")


def _gear(turn: float) -> np.ndarray:
    """(2 + 8 TEETH, 3) vertices of a gear of radius 1, turned by a share of a tooth: two middles, back and front rim."""
    places = (np.arange(TEETH)[:, None] + turn + [-0.24, -0.14, 0.14, 0.24]).ravel() * (2 * np.pi / TEETH)
    rim = np.tile([ROOT, TIP, TIP, ROOT], TEETH)
    x, y = rim * np.cos(places), rim * np.sin(places)
    half = LAYERS / 2
    sides = [np.stack([x, y, np.full_like(x, z)], axis=1) for z in (-half, half)]
    return np.concatenate([[[0, 0, -half], [0, 0, half]], *sides])


def _gear_faces() -> np.ndarray:
    back = np.arange(4 * TEETH, dtype=np.int32) + 2
    front, following = back + 4 * TEETH, np.roll(back, -1)
    ahead = following + 4 * TEETH
    flat = [np.stack([np.full_like(back, 0), following, back], axis=1), np.stack([np.full_like(back, 1), front, ahead], axis=1)]
    return np.concatenate([*flat, quads(back, following, ahead, front)])


GENERATORS = {
    "gears": generator(
        gears,
        {
            "level": Key(integer(1, 1000), f"Gears along an edge; {FACES_PER_GEAR} level^3 faces.", 2),
            "center": CENTER,
            "radius": Key(POSITIVE, "Half the distance of two neighbours.", 0.5, unit="metres"),
        },
        lambda options: BYTES_PER_FACE * float(FACES_PER_GEAR) * options["level"] ** 3,
    )
}
