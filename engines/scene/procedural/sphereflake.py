"""The sphereflake of Haines' Standard Procedural Databases (Haines 1987, `balls`): every sphere carries nine of a third
of its radius, three on its top and six around its equator, seen along the axis on which it stands itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.scene.procedural import libm
from engines.scene.procedural.generator import BYTES_PER_SPHERE, CENTER, Spheres, generator
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POSITIVE, integer


def sphere_count(level: int) -> int:
    """How many spheres a sphereflake of so many generations has."""
    return (9 ** (level + 1) - 1) // 8


def sphereflake(level: int, center: Triple, radius: float) -> Spheres:
    """Level by level, parents before children; a child touches its parent. The first axis is +y.

    Six directions stand around the equator at 15, 75, ... degrees, and three, 60 degrees from each other (the diagonals
    of three faces of a cube), at a latitude of 54.7 degrees at 45, 165 and 285 degrees.
    """
    directions = _nine_directions()
    centers, axes = [np.array([center], np.float64)], np.array([[0.0, 1.0, 0.0]])
    radii = [np.array([radius])]
    for generation in range(1, level + 1):
        frames = _frames(axes)
        outward = np.einsum("nij,kj->nki", frames, directions).reshape(-1, 3)
        parent = radius / 3.0 ** (generation - 1)
        child = parent / 3.0
        centers.append(np.repeat(centers[-1], 9, axis=0) + (parent + child) * outward)
        radii.append(np.full(len(outward), child))
        axes = outward
    return Spheres(np.concatenate(centers), np.concatenate(radii), "sphereflake")


def _nine_directions() -> NDArray[np.float64]:
    """(9, 3) unit vectors with +y as the axis."""
    around = np.radians(np.concatenate([15.0 + 60.0 * np.arange(6), 45.0 + 120.0 * np.arange(3)]))
    up = libm.arcsin(np.concatenate([np.zeros(6), np.full(3, (2.0 / 3.0) ** 0.5)]))
    return np.stack([np.cos(up) * np.cos(around), np.sin(up), -np.cos(up) * np.sin(around)], axis=1)


def _frames(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 3) rotations that take +y to each axis (Duff et al. 2017, with y and z exchanged)."""
    x, y, z = axes.T
    sign = np.copysign(1.0, y)
    a = -1.0 / (sign + y)
    b = x * z * a
    first = np.stack([1.0 + sign * x * x * a, -sign * x, sign * b], axis=1)
    last = np.stack([b, -z, sign + z * z * a], axis=1)
    return np.stack([first, axes, last], axis=2)


GENERATORS = {
    "sphereflake": generator(
        sphereflake,
        {
            "level": Key(integer(0, 30), "Generations; (9^(level + 1) - 1)/8 spheres.", 2),
            "center": CENTER,
            "radius": Key(POSITIVE, "Radius of the largest sphere.", 0.5, unit="metres"),
        },
        lambda options: BYTES_PER_SPHERE * sphere_count(options["level"]),
    )
}
