"""Structures of rods and joints from Haines' Standard Procedural Databases: rings, a lattice, a tree.

Each has two parts, generated one at a time so that they may differ in material: `rods`, tubes of triangles that are open
at both ends, and `joints`, the spheres that cover the ends.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene.procedural.generator import (
    BYTES_PER_FACE,
    BYTES_PER_SPHERE,
    CENTER,
    FOOT,
    ORIGIN,
    Faces,
    Spheres,
    generator,
    quads,
)
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POINT, POSITIVE, integer, one_of, within


class Structure(NamedTuple):
    """`ends` (n, 2, 3) of the rods with their radii (n, 2), and joints: `centers` (m, 3), `radii` (m,)."""

    ends: NDArray[np.float64]
    end_radii: NDArray[np.float64]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]

    def part(self, name: str, part: str, sides: int, center: Triple) -> Faces | Spheres:
        """Its "joints" as spheres, or its "rods" as tubes with so many `sides`, moved by `center`."""
        if part == "joints":
            return Spheres(self.centers + np.array(center), self.radii, f"{name} joints")
        return tubes(self.ends + np.array(center), self.end_radii, sides, f"{name} rods")


def tubes(ends: NDArray[np.float64], radii: NDArray[np.float64], sides: int, name: str) -> Faces:
    """(2 sides) outward faces for each rod from `ends[:, 0]` to `ends[:, 1]`; a cone where its two radii differ."""
    axis = ends[:, 1] - ends[:, 0]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(axis).argmin(axis=1)]
    across = np.cross(axis, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * np.cross(axis, across)[:, None]
    vertices = ends[:, :, None] + radii[:, :, None, None] * ring[:, None]
    index = np.arange(len(ends) * 2 * sides, dtype=np.int32).reshape(-1, 2, sides)
    ahead = np.roll(index, -1, axis=2)
    faces = quads(index[:, 0], ahead[:, 0], ahead[:, 1], index[:, 1])
    return Faces(vertices.reshape(-1, 3), faces, name)


# ---- rings ------------------------------------------------------------------------------------------------------------


def rings(level: int, part: str, sides: int, radius: float, rod: float, center: Triple) -> Faces | Spheres:
    """A pyramid of level, level - 1, ..., 1 squared balls of rings, its top upwards.

    A ball is six pentagons that together join the middles of the thirty edges of a dodecahedron, each once. `radius` is
    that of a ball, `rod` the share of it that a rod has as its radius; `center` is the middle of the lowest layer.
    """
    corners = radius * _pentagons()
    spacing = 2.0 * radius * (1.0 + rod)
    middles = np.array(
        [
            ((i - (k - 1) / 2) * spacing, (level - k) * spacing / 2**0.5, (j - (k - 1) / 2) * spacing)
            for k in range(level, 0, -1)
            for i, j in product(range(k), repeat=2)
        ]
    )
    joints = (middles[:, None, None] + corners).reshape(-1, 3)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    rods = (middles[:, None, None, None] + ends).reshape(-1, 2, 3)
    thick = radius * rod
    structure = Structure(rods, np.full((len(rods), 2), thick), joints, np.full(len(joints), thick))
    return structure.part("rings", part, sides, center)


def _pentagons() -> NDArray[np.float64]:
    """(6, 5, 3) corners in order: for each axis through two faces of a dodecahedron every other middle of its equator."""
    golden = (1 + 5**0.5) / 2
    axes = [np.roll([0.0, golden, sign], k) for sign in (1.0, -1.0) for k in range(3)]
    octants = np.array(list(product((1.0, -1.0), repeat=3))) * [0.5 / golden, 0.5, 0.5 * golden]
    middles = np.concatenate([np.eye(3), -np.eye(3), *(np.roll(octants, k, axis=1) for k in range(3))])
    pentagons: list[NDArray[np.float64]] = []
    taken: set[int] = set()
    for axis in axes:
        equator = np.flatnonzero(np.abs(middles @ axis) < 1e-9)
        first = middles[equator[0]]
        second = np.cross(axis, first) / np.linalg.norm(axis)
        angles = np.arctan2(middles[equator] @ second, middles[equator] @ first) % (2 * np.pi - 1e-9)
        ordered = equator[np.argsort(angles)]
        chosen = next((half for half in (ordered[::2], ordered[1::2]) if not taken & set(half.tolist())), ordered[::2])
        taken |= set(chosen.tolist())
        pentagons.append(middles[chosen])
    return np.array(pentagons)


# ---- lattice ----------------------------------------------------------------------------------------------------------


def lattice(level: int, part: str, sides: int, cell: float, rod: float, joint: float, center: Triple) -> Faces | Spheres:
    """(level + 1)^3 joints, each joined to its neighbours; `rod` and `joint` are radii as shares of the side of a cell."""
    place = np.asarray((np.arange(level + 1) - level / 2) * cell, np.float64)
    joints = np.stack(np.meshgrid(place, place, place, indexing="ij"), axis=-1)
    pairs = [np.stack([np.delete(joints, -1, axis), np.delete(joints, 0, axis)], axis=3).reshape(-1, 2, 3) for axis in range(3)]
    ends, centers = np.concatenate(pairs), joints.reshape(-1, 3)
    structure = Structure(ends, np.full((len(ends), 2), rod * cell), centers, np.full(len(centers), joint * cell))
    return structure.part("lattice", part, sides, center)


# ---- tree -------------------------------------------------------------------------------------------------------------

BRANCH_ANGLES = np.radians([[20.0, 0.0], [45.0, 180.0]])
"""Of the two branches: away from the parent's direction, and about it."""
TWIST = np.radians(140.0)
"""By how much a branch turns the plane of its own branches."""
SHRINK, TAPER = np.array([0.86, 0.72]), 0.74
"""Length of a branch over that of its parent, and its radius at one end over that at the other."""


def tree(level: int, part: str, sides: int, height: float, center: Triple) -> Faces | Spheres:
    """A trunk that forks `level` times, after Aono and Kunii (1984): 2^(level + 1) - 1 cones, each with a joint on its end.

    `height` is that of the trunk, in metres; `center` is its foot.
    """
    frames = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])  # rows: across, other, along
    feet, lengths, thick = np.zeros((1, 3)), np.array([height]), np.array([0.08 * height])
    ends, radii = [], []
    for _ in range(level + 1):
        tips = feet + lengths[:, None] * frames[:, 2]
        ends.append(np.stack([feet, tips], axis=1))
        radii.append(np.stack([thick, TAPER * thick], axis=1))
        frames = np.concatenate([_bent(frames, *angles) for angles in BRANCH_ANGLES])
        feet, lengths = np.concatenate([tips, tips]), np.concatenate([lengths * share for share in SHRINK])
        thick = np.concatenate([TAPER * thick] * 2)
    rods, thicknesses = np.concatenate(ends), np.concatenate(radii)
    return Structure(rods, thicknesses, rods[:, 1], thicknesses[:, 1]).part("tree", part, sides, center)


def _bent(frames: NDArray[np.float64], away: float, about: float) -> NDArray[np.float64]:
    """Frames whose direction leans `away` from that of `frames`, towards `about`, and that are twisted for the next fork."""
    across, other, along = frames[:, 0], frames[:, 1], frames[:, 2]
    towards = np.cos(about) * across + np.sin(about) * other
    beside = np.cross(along, towards)
    direction = np.cos(away) * along + np.sin(away) * towards
    leaning = np.cross(beside, direction)
    return np.stack(
        [np.cos(TWIST) * leaning + np.sin(TWIST) * beside, np.cos(TWIST) * beside - np.sin(TWIST) * leaning, direction], axis=1
    )


_PART = Key(one_of(("rods", "joints"), "choice"), "Rods, of 2 sides faces each, or joints, which are spheres.", "rods")
_SIDES = Key(integer(3, 1 << 12), "Sides of a rod.", 12)


def _needs(rods: Callable[[int], float], joints: Callable[[int], float]) -> Callable[..., float]:
    def needs(options):
        level = options["level"]
        if options["part"] == "joints":
            return BYTES_PER_SPHERE * joints(level)
        return BYTES_PER_FACE * 2.0 * options["sides"] * rods(level)

    return needs


def _balls(level: int) -> float:
    return level * (level + 1.0) * (2.0 * level + 1.0) / 6.0


GENERATORS = {
    "rings": generator(
        rings,
        {
            "level": Key(integer(1, 2000), "Balls along an edge of the pyramid; 5 level (level + 1) (2 level + 1) rods.", 3),
            "part": _PART,
            "sides": _SIDES,
            "radius": Key(POSITIVE, "Radius of a ball.", 0.5, unit="metres"),
            "rod": Key(within(0.001, 0.5), "Radius of a rod, as a share of that of a ball.", 0.07),
            "center": FOOT,
        },
        _needs(lambda level: 30.0 * _balls(level), lambda level: 30.0 * _balls(level)),
    ),
    "lattice": generator(
        lattice,
        {
            "level": Key(integer(1, 2000), "Cells along an edge; (level + 1)^3 joints, 3 level (level + 1)^2 rods.", 4),
            "part": _PART,
            "sides": _SIDES,
            "cell": Key(POSITIVE, "Side of a cell.", 0.25, unit="metres"),
            "rod": Key(within(0.001, 0.5), "Radius of a rod, as a share of the cell's side.", 0.06),
            "joint": Key(within(0.001, 0.5), "Radius of a joint, as a share of the cell's side.", 0.16),
            "center": CENTER,
        },
        _needs(lambda level: 3.0 * level * (level + 1) ** 2, lambda level: (level + 1.0) ** 3),
    ),
    "tree": generator(
        tree,
        {
            "level": Key(integer(0, 30), "Times that it forks; 2^(level + 1) - 1 rods and joints.", 8),
            "part": _PART,
            "sides": _SIDES,
            "height": Key(POSITIVE, "Height of the trunk.", 1.0, unit="metres"),
            "center": Key(POINT, "The foot of the trunk.", ORIGIN, unit="metres"),
        },
        _needs(lambda level: 2.0 ** (level + 1), lambda level: 2.0 ** (level + 1)),
    ),
}
