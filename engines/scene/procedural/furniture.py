"""Solids of furnished rooms: boxes with round edges, throw cushions, rows of books."""

from __future__ import annotations

import numpy as np

from engines.scene.geometry import unit_rows
from engines.scene.procedural import libm
from engines.scene.procedural.generator import BYTES_PER_FACE, Faces, generator, grid_faces
from engines.scene.procedural.pieces import PLACED, Array, Patch, joined, placed, seamless_normals
from engines.scene.procedural.solids import POSITIVE_TRIPLE
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POSITIVE, integer, one_of, within

SIDES = ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1))
"""Axis and sign of the six sides of a box."""


def rounded_box(
    half_size: Triple, radius: float, bulge: float, segments: int, center: Triple, tilt: float, rotate_y: float
) -> Faces:
    """A box whose edges are round, with smooth normals. Its sides bulge by `bulge` in their middles, as upholstery does.

    Texture coordinates are metres along each side; v points down on the walls, and along +z on top.
    """
    half = np.array(half_size)
    radius = min(radius, float(half.min()))
    middle = 1 if bulge == 0.0 else 4 * segments
    patches = []
    for axis, sign in SIDES:
        i, j = [each for each in range(3) if each != axis]
        a, b = _line(half[i] - radius, segments, middle), _line(half[j] - radius, segments, middle)
        points, normals = np.empty((len(a), len(b), 3)), np.empty((len(a), len(b), 3))
        normals[..., i], normals[..., j], normals[..., axis] = a[:, None, 1], b[None, :, 1], sign
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        points[..., i], points[..., j], points[..., axis] = a[:, None, 0], b[None, :, 0], sign * (half[axis] - radius)
        points += radius * normals
        uvs = _metres(points, axis, sign)
        faces = grid_faces(len(a) - 1, len(b) - 1)
        if sign * (-1 if axis == 1 else 1) < 0:  # x cross z is -y
            faces = faces[:, [0, 2, 1]]
        patches.append(Patch(points.reshape(-1, 3), normals.reshape(-1, 3), uvs.reshape(-1, 2), faces))
    made = joined(patches, "rounded_box")
    if bulge != 0.0:
        share = np.clip(made.vertices / half, -1.0, 1.0)
        rest = np.stack([np.prod([1 - share[:, k] ** 2 for k in range(3) if k != axis], axis=0) for axis in range(3)], axis=1)
        vertices = made.vertices + bulge * share * rest
        made = made._replace(vertices=vertices, normals=seamless_normals(vertices, made.faces))
    return placed(made, tilt, rotate_y, center)


def _line(inner: float, segments: int, middle: int) -> Array:
    """(n, 2): places of the sphere that rounds the edges, and the slope of its point."""
    slopes = libm.tan(np.linspace(-np.pi / 4, 0.0, segments + 1))
    flat = np.linspace(-inner, inner, middle + 1)[1:-1]
    left = np.stack([np.full(segments + 1, -inner), slopes], axis=1)
    right = np.stack([np.full(segments + 1, inner), -slopes[::-1]], axis=1)
    return np.concatenate([left, np.stack([flat, np.zeros(len(flat))], axis=1), right])


def _metres(points: Array, axis: int, sign: int) -> Array:
    x, y, z = np.moveaxis(points, -1, 0)
    if axis == 1:
        return np.stack([x, sign * z], axis=-1)
    return np.stack([-sign * z if axis == 0 else sign * x, -y], axis=-1)


def cushion(size: Triple, pinch: float, segments: int, center: Triple, tilt: float, rotate_y: float) -> Faces:
    """A throw cushion that stands upright, its face towards +z: thick in the middle, with a seam around and pointed corners.

    Texture coordinates run from 0 to 1 over each face.
    """
    line = np.sin(np.linspace(-np.pi / 2, np.pi / 2, segments + 1))
    line[[0, -1]] = -1.0, 1.0
    u, v = line[:, None], line[None, :]
    x = 0.5 * size[0] * u * (1.0 - pinch * (1.0 - v**2))
    y = 0.5 * size[1] * v * (1.0 - pinch * (1.0 - u**2))
    z = 0.5 * size[2] * libm.power(np.maximum((1.0 - u**2) * (1.0 - v**2), 0.0), 0.45)
    faces = grid_faces(segments, segments)
    uvs = np.stack(np.broadcast_arrays(0.5 + 0.5 * u, 0.5 - 0.5 * v), axis=2).reshape(-1, 2)
    sides = [np.stack([x, y, sign * z], axis=2).reshape(-1, 3) for sign in (1.0, -1.0)]
    both = np.concatenate([faces, faces[:, [0, 2, 1]] + np.int32((segments + 1) ** 2)])
    points = np.concatenate(sides)
    patch = Patch(points, seamless_normals(points, both), np.concatenate([uvs, uvs]), both)
    return placed(joined([patch], "cushion"), tilt, rotate_y, center)


BOARD = 0.003
MARGIN = 0.006
"""Metres: thickness of the boards of a book, and how far they stand over its pages."""


def books(
    count: int, height: float, depth: float, kinds: int, part: str, seed: int, center: Triple, tilt: float, rotate_y: float
) -> Faces:
    """A row of books that stand side by side along +x, spines towards +z; `center` is the middle of their feet.

    Part `covers` shows one of `kinds` columns of a texture on each spine, and its upper left corner on the boards; `pages` is
    the paper. Thicknesses and sizes are random.
    """
    random = np.random.default_rng(seed)
    thick = random.uniform(0.014, 0.042, count)
    high = height * random.uniform(0.72, 1.0, count)
    deep = depth * random.uniform(0.75, 1.0, count)
    column, jitter = random.integers(0, kinds, count), random.uniform(0.0, 0.012, count)
    starts = np.concatenate([[0.0], np.cumsum(thick + 0.0006)])
    starts -= starts[-1] / 2.0
    patches = []
    for x, t, h, d, k, back in zip(starts, thick, high, deep, column, jitter, strict=False):
        front, rear = 0.5 * depth - back, 0.5 * depth - back - d
        if part == "pages":
            patches += _block((x + BOARD, MARGIN, rear + MARGIN), (x + t - BOARD, h - MARGIN, front - BOARD), None)
            continue
        plain = ((k + 0.08) / kinds, 0.01)
        patches += _block((x, 0.0, rear), (x + BOARD, h, front), plain)
        patches += _block((x + t - BOARD, 0.0, rear), (x + t, h, front), plain)
        patches += _block((x, 0.0, front - BOARD), (x + t, h, front + BOARD), plain, (k / kinds, (k + 1) / kinds))
    return placed(joined(patches, "books")._replace(normals=None), tilt, rotate_y, center)


def _block(
    low: Triple, high: Triple, plain: tuple[float, float] | None, shown: tuple[float, float] | None = None
) -> list[Patch]:
    """The six sides of a box; that towards +z shows the columns `shown` of a texture, the others are `plain`."""
    ends = np.array([low, high])
    patches = []
    for axis, sign in SIDES:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        corners = np.empty((4, 3))
        for place, (a, b) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            corners[place, axis], corners[place, i], corners[place, j] = (ends[(sign + 1) // 2, axis], ends[a, i], ends[b, j])
        corners = corners if sign > 0 else corners[::-1]
        uvs = np.tile(plain or (0.5, 0.5), (4, 1))
        if shown is not None and (axis, sign) == (2, 1):
            share = (corners[:, :2] - low[:2]) / np.subtract(high[:2], low[:2])
            uvs = np.stack([shown[0] + share[:, 0] * (shown[1] - shown[0]), 1.0 - share[:, 1]], axis=1)
        normals = np.tile(sign * np.eye(3)[axis], (4, 1))
        patches.append(Patch(corners, unit_rows(normals), uvs, np.array([[0, 1, 2], [0, 2, 3]], np.int32)))
    return patches


GENERATORS = {
    "rounded_box": generator(
        rounded_box,
        {
            "half_size": Key(POSITIVE_TRIPLE, "Half the extents along its own x, y and z.", (0.5, 0.5, 0.5), unit="metres"),
            "radius": Key(POSITIVE, "Radius of the edges, at most the least half size.", 0.02, unit="metres"),
            "bulge": Key(within(0, 1e6), "How far the middle of a side stands out.", 0.0, unit="metres"),
            "segments": Key(integer(1, 1 << 12), "Segments over half of an edge's rounding.", 2),
            **PLACED,
        },
        lambda options: 12.0 * BYTES_PER_FACE * (2 + (4 if options["bulge"] else 1)) ** 2 * options["segments"] ** 2,
    ),
    "cushion": generator(
        cushion,
        {
            "size": Key(POSITIVE_TRIPLE, "Width, height and thickness.", (0.45, 0.45, 0.16), unit="metres"),
            "pinch": Key(within(0, 0.5), "How far the middles of the seams are drawn in, as a share.", 0.08),
            "segments": Key(integer(2, 1 << 14), "Segments along each side; 4 segments^2 faces.", 24),
            **PLACED,
        },
        lambda options: 8.0 * BYTES_PER_FACE * options["segments"] ** 2,
    ),
    "books": generator(
        books,
        {
            "count": Key(integer(1, 1 << 20), "How many.", 12),
            "height": Key(POSITIVE, "Height of the highest.", 0.26, unit="metres"),
            "depth": Key(POSITIVE, "Depth of the deepest.", 0.18, unit="metres"),
            "kinds": Key(integer(1, 1 << 12), "Spines side by side in the texture.", 16),
            "part": Key(one_of(("covers", "pages"), "part"), "What is made: covers or pages.", "covers"),
            "seed": Key(integer(0, 2**32 - 1), "Seed of the random numbers.", 0),
            **PLACED,
        },
        lambda options: 40.0 * BYTES_PER_FACE * options["count"],
    ),
}
