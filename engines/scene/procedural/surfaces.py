"""Procedural surfaces of many triangles: two fractal landscapes and a torus knot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.scene.procedural.generator import (
    BYTES_PER_FACE,
    CENTER,
    FOOT,
    ORIGIN,
    Faces,
    generator,
    grid_faces,
    grid_uvs,
    quads,
)
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POINT, POSITIVE, integer, within

OCTAVES = 8
FIRST_CELLS = 2
"""Lattice cells along a side in the first octave; every octave doubles them."""


def terrain(cells: int, size: float, height: float, roughness: float, seed: int, center: Triple) -> Faces:
    """A heightfield over a square in the plane y = const, front upwards: gradient noise (Perlin 1985, 2002) in octaves.

    Heights run from center.y to center.y + `height`; the same seed gives the same terrain on every machine.
    """
    line = np.linspace(0.0, 1.0, cells + 1)
    heights = np.zeros((cells + 1, cells + 1))
    for octave in range(OCTAVES):
        lattice = FIRST_CELLS << octave
        if octave and lattice > cells:
            break
        heights += roughness**octave * _gradient_noise(line * lattice, lattice, seed * 0x9E3779B1 + octave)
    spread = np.ptp(heights)
    heights = (heights - heights.min()) * (height / spread if spread > 0.0 else 0.0)
    x, z = np.meshgrid((line - 0.5) * size, (line - 0.5) * size)
    vertices = np.stack([x, heights, z], axis=2).reshape(-1, 3) + np.array(center)
    return Faces(vertices, grid_faces(cells, cells), "terrain", lambda: grid_uvs(cells, cells))


def _gradient_noise(at: NDArray[np.float64], lattice: int, key: int) -> NDArray[np.float64]:
    """Noise on the square grid of coordinates `at` x `at` in [0, lattice]: rows are z, columns x."""
    angles = (2.0 * np.pi * 2.0**-32) * _hash_grid(lattice + 1, key)
    gx, gz = np.cos(angles), np.sin(angles)
    cell = np.minimum(at.astype(np.int64), lattice - 1)
    inside = at - cell
    smooth = inside * inside * inside * (inside * (6.0 * inside - 15.0) + 10.0)

    def corner(right: int, down: int) -> NDArray[np.float64]:
        rows, columns = (cell + down)[:, None], (cell + right)[None, :]
        return gx[rows, columns] * (inside - right)[None, :] + gz[rows, columns] * (inside - down)[:, None]

    s, t = smooth[None, :], smooth[:, None]
    top = corner(0, 0) * (1 - s) + corner(1, 0) * s
    return top * (1 - t) + (corner(0, 1) * (1 - s) + corner(1, 1) * s) * t


def _hash_grid(side: int, key: int) -> NDArray[np.uint64]:
    """(side, side) 32-bit random numbers: Wellons' lowbias32 over the index and the key."""
    x = np.arange(side * side, dtype=np.uint64) * np.uint64(0x9E3779B1) + np.uint64(key % 2**32)
    mask = np.uint64(0xFFFFFFFF)
    for _ in range(2):
        x &= mask
        x ^= x >> np.uint64(16)
        x = (x * np.uint64(0x7FEB352D)) & mask
        x ^= x >> np.uint64(15)
        x = (x * np.uint64(0x846CA68B)) & mask
        x ^= x >> np.uint64(16)
    return x.reshape(side, side)


def mount(level: int, size: float, height: float, roughness: float, seed: int, center: Triple) -> Faces:
    """The fractal mountain of Haines' databases: a square of two triangles whose edges are broken in their middles.

    Every triangle becomes four, `level` times; a middle moves up or down by at most `height`, `roughness` times as much
    in every generation (Fournier, Fussell and Carpenter 1982). 2 * 4^level faces over a square of `size`.
    """
    heights = np.zeros((2, 2))
    for generation in range(level):
        side = 2 * len(heights) - 1
        finer = np.empty((side, side))
        finer[::2, ::2] = heights
        finer[::2, 1::2] = (heights[:, :-1] + heights[:, 1:]) / 2
        finer[1::2, ::2] = (heights[:-1] + heights[1:]) / 2
        finer[1::2, 1::2] = (heights[:-1, :-1] + heights[1:, 1:]) / 2  # along the edge that the two faces share
        moved = _hash_grid(side, seed * 0x9E3779B1 + generation) * 2.0**-31 - 1.0
        moved[::2, ::2] = 0.0
        heights = finer + height * roughness**generation * moved
    line = (np.linspace(0.0, 1.0, len(heights)) - 0.5) * size
    x, z = np.meshgrid(line, line)
    vertices = np.stack([x, heights, z], axis=2).reshape(-1, 3) + np.array(center)
    cells = len(heights) - 1
    return Faces(vertices, grid_faces(cells, cells), "mount", lambda: grid_uvs(cells, cells))


def torus_knot(p: int, q: int, segments: int, sides: int, radius: float, tube: float, center: Triple) -> Faces:
    """A closed tube along the (p, q) torus knot about the z axis; p and q without common divisor give one knot.

    The curve is (r cos p t, r sin p t, -sin q t) / 2 with r = cos q t + 2, scaled so that the ring has `radius`. Texture
    coordinate u goes along the tube, v around.
    """
    t = 2.0 * np.pi * np.arange(segments) / segments
    r = np.cos(q * t) + 2.0
    slope = -q * np.sin(q * t)
    scale = radius / 2.0
    curve = scale * np.stack([r * np.cos(p * t), r * np.sin(p * t), -np.sin(q * t)], axis=1)
    tangent = np.stack(
        [slope * np.cos(p * t) - p * r * np.sin(p * t), slope * np.sin(p * t) + p * r * np.cos(p * t), -q * np.cos(q * t)],
        axis=1,
    )
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # across: the torus normal made orthogonal to the tangent; it never vanishes and closes without a twist
    across = np.stack([np.cos(q * t) * np.cos(p * t), np.cos(q * t) * np.sin(p * t), -np.sin(q * t)], axis=1)
    across -= (across * tangent).sum(axis=1, keepdims=True) * tangent
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(tangent, across)
    around = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.cos(around)[None, :, None] * across[:, None, :] + np.sin(around)[None, :, None] * other[:, None, :]
    vertices = (curve[:, None, :] + tube * ring).reshape(-1, 3) + np.array(center)
    index = np.arange(segments * sides, dtype=np.int32).reshape(segments, sides)
    ahead = np.roll(index, -1, axis=0)
    faces = quads(index, np.roll(index, -1, axis=1), np.roll(ahead, -1, axis=1), ahead)

    def uvs() -> NDArray[np.float64]:
        corners = np.array([(0, 0), (0, 1), (1, 1), (0, 0), (1, 1), (1, 0)])  # as `quads` has them
        return (np.moveaxis(np.indices((segments, sides)), 0, 2)[:, :, None] + corners).reshape(-1, 3, 2) / (segments, sides)

    return Faces(vertices, faces, "torus_knot", uvs)


_SIZE = Key(POSITIVE, "Length of a side.", 10.0, unit="metres")
_SEED = Key(integer(0, 2**32 - 1), "Seed of the random numbers.", 0)

GENERATORS = {
    "terrain": generator(
        terrain,
        {
            "cells": Key(integer(1, 1 << 20), "Cells along each side; 2 cells^2 faces.", 128),
            "size": _SIZE,
            "height": Key(POSITIVE, "Height from the lowest point to the highest.", 2.0, unit="metres"),
            "roughness": Key(within(0.0, 1.0), "What an octave adds, as a share of the one before.", 0.5),
            "seed": _SEED,
            "center": FOOT,
        },
        lambda options: BYTES_PER_FACE * 2.0 * options["cells"] ** 2,
    ),
    "mount": generator(
        mount,
        {
            "level": Key(integer(0, 30), "Times that every face becomes four; 2 * 4^level faces.", 6),
            "size": _SIZE,
            "height": Key(POSITIVE, "How far the first middles of edges move at most.", 2.0, unit="metres"),
            "roughness": Key(within(0.0, 1.0), "How far a generation moves, as a share of the one before.", 0.5),
            "seed": _SEED,
            "center": Key(POINT, "The middle of the square before its edges move.", ORIGIN, unit="metres"),
        },
        lambda options: BYTES_PER_FACE * 2.0 * 4.0 ** options["level"],
    ),
    "torus_knot": generator(
        torus_knot,
        {
            "p": Key(integer(1, 64), "Turns about the axis.", 2),
            "q": Key(integer(1, 64), "Turns about the ring.", 3),
            "segments": Key(integer(8, 1 << 24), "Segments along the tube.", 512),
            "sides": Key(integer(3, 1 << 16), "Sides around the tube.", 32),
            "radius": Key(POSITIVE, "Radius of the ring.", 1.0, unit="metres"),
            "tube": Key(POSITIVE, "Radius of the tube.", 0.2, unit="metres"),
            "center": CENTER,
        },
        lambda options: BYTES_PER_FACE * 2.0 * options["segments"] * options["sides"],
    ),
}
