"""The frame in NumPy: every step over all its rays at once, in the original's float32 order of operations.

Vectors are (3, n) float32. Squares are formed and added in float64 and rounded once, because the original's `pow`
promotes; so is the last square root of an intersection.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.dahlquist.animation import COLOURS, FOCAL, RADII, REAL, Reals
from engines.dahlquist.frame import BACKGROUND, DARK, SPHERE, Frame, Pictures, View
from engines.dahlquist.pictures import Picture

MISS = -1
HITS = 3
"""Balls that a path meets at the most."""


def _dot(a: Reals, b: Reals) -> Reals:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _squared_length(a: Reals) -> Reals:
    x, y, z = a.astype(np.float64)
    return (x * x + y * y + z * z).astype(REAL)


def _unit(a: Reals) -> Reals:
    return a / np.sqrt(_squared_length(a))


TO_LIGHT: Reals = _unit(np.array([[-10], [10], [-5]], REAL))
"""(3, 1) where the directional light comes from."""


class Painter:
    """Draws frames of one size. NumPy uses one thread, whatever `threads` says."""

    def __init__(self, width: int, height: int, pictures: Pictures, threads: int) -> None:
        self._size = width, height
        self._pictures = pictures

    def draw(self, frame: Frame, view: View) -> None:
        """Draws the rows of a call into `frame`."""
        width, height = self._size
        rows, columns = (
            a.ravel() for a in np.meshgrid(np.arange(view.first_row, height, view.row_step), np.arange(width), indexing="ij")
        )
        probe = self._pictures.probe if view.environment else None
        hit, colours = _radiance(_primary_rays(columns, rows, width), view, probe)
        _write(frame, rows[hit], columns[hit], colours, SPHERE)
        wanted = ~hit & (frame[rows, columns, 3] != BACKGROUND)
        rows, columns = rows[wanted], columns[wanted]
        if view.environment:
            colours = _background_colours(self._pictures.background, columns, rows, self._size)
        else:
            colours = np.tile(np.array(DARK, REAL)[:, None], len(rows))
        _write(frame, rows, columns, colours, BACKGROUND)


def _write(frame: Frame, rows: NDArray[np.int64], columns: NDArray[np.int64], colours: Reals, flag: int) -> None:
    """Clamps and truncates colours (3, n) into pixels, and sets their flag."""
    frame[rows, columns, :3] = np.clip(colours, 0, 255).T.astype(np.uint8)
    frame[rows, columns, 3] = flag


def _primary_rays(columns: NDArray[Any], rows: NDArray[Any], width: int) -> Reals:
    """(3, n) unit directions through the upper left corners of pixels. Both offsets are in widths."""
    y = columns.astype(REAL) / REAL(width) - REAL(0.5)
    z = rows.astype(REAL) / REAL(width) - REAL(0.5)
    return _unit(np.stack([np.full_like(y, FOCAL), y, z]))


def _nearest(origin: Reals, direction: Reals, centres: Reals, boxes: Reals | None) -> tuple[NDArray[np.int64], Reals]:
    """(ball, distance) of the nearest entry point; MISS for none. Where `boxes` are given, balls count inside theirs only."""
    n = direction.shape[1]
    ball, best = np.full(n, MISS), np.full(n, np.inf, REAL)
    towards = _unit(direction)
    for k in range(len(centres)):
        distance = _entry(origin, direction, towards, centres[k][:, None], RADII[k])
        closer = (distance >= 0) & (distance < best)
        if boxes is not None:
            y, z = direction[1], direction[2]
            closer &= (y >= boxes[k, 0]) & (y <= boxes[k, 1]) & (z >= boxes[k, 2]) & (z <= boxes[k, 3])
        ball, best = np.where(closer, k, ball), np.where(closer, distance, best)
    return ball, best


def pick(x: float, y: float, width: int, centres: Reals, boxes: Reals) -> int:
    """The ball that pixel (x, y) shows, MISS for none."""
    direction = _primary_rays(np.array([x]), np.array([y]), width)
    ball, _ = _nearest(np.zeros((3, 1), REAL), direction, centres, boxes)
    return int(ball[0])


def _entry(origin: Reals, direction: Reals, towards: Reals, centre: Reals, radius: np.float32) -> Reals:
    """Distance at which rays enter a ball, -1 where they do not: also where its centre lies behind the origin."""
    t = _dot(direction, centre - origin)
    near = origin + towards * t
    left = np.float64(radius) ** 2 - _squared_length(near - centre)
    along = np.sqrt(_squared_length(near - origin))
    entry = (along - np.sqrt(np.maximum(left, 0.0))).astype(REAL)
    return np.where((t > 0) & (left >= 0), entry, REAL(-1))


def _radiance(direction: Reals, view: View, probe: Picture | None) -> tuple[NDArray[np.bool_], Reals]:
    """Whether primary rays `direction` (3, n) hit a ball, and the colours (3, hits), not clamped, of those that do."""
    ball, distance = _nearest(np.zeros((3, 1), REAL), direction, view.centres, view.boxes)
    hit = ball != MISS
    rays = _Rays(np.zeros((3, 1), REAL), direction[:, hit], ball[hit], distance[hit])
    return hit, _colour(rays, view, probe, 1)


class _Rays(NamedTuple):
    """Rays that hit a ball: origin and direction (3, n), ball and distance (n,)."""

    origin: Reals
    direction: Reals
    ball: NDArray[np.int64]
    distance: Reals


def _colour(rays: _Rays, view: View, probe: Picture | None, hits: int) -> Reals:
    """(3, n) colours: the ball's own plus, at full weight, what its mirror shows."""
    centre = view.centres[rays.ball].T
    towards = _unit(rays.direction)
    normal = _unit(rays.origin + towards * rays.distance - centre)
    diffuse = COLOURS[rays.ball].T * np.maximum(_dot(TO_LIGHT, normal), REAL(0))
    # The mirror's point is found with a direction normalised once more, which may differ in its last bit.
    origin = rays.origin + _unit(towards) * rays.distance
    normal = _unit(origin - centre)
    direction = REAL(2) * _dot(-towards, normal) * normal + towards
    if not view.reflections or hits == HITS:
        return diffuse + _probe(direction, probe)
    ball, distance = _nearest(origin, direction, view.centres, None)
    hit = ball != MISS
    mirrored = _probe(direction, probe)
    if hit.any():
        further = _Rays(origin[:, hit], direction[:, hit], ball[hit], distance[hit])
        mirrored[:, hit] = _colour(further, view, probe, hits + 1)
    return diffuse + mirrored


def _probe(direction: Reals, probe: Picture | None) -> Reals:
    """(3, n) texels that directions see: by y and z alone, so that front and back see the same."""
    if probe is None:
        return np.zeros_like(direction)
    height, width, _ = probe.shape
    column = REAL(width) * (direction[1] / REAL(4) + REAL(0.5))
    row = REAL(height) * (direction[2] / REAL(4) + REAL(0.5))
    return probe[row.astype(np.int64), column.astype(np.int64)].T.astype(REAL)


def _background_colours(
    background: Picture, columns: NDArray[np.int64], rows: NDArray[np.int64], size: tuple[int, int]
) -> Reals:
    """(3, n) colours of the background stretched over an image of `size` (width, height): bilinear, a texel at its corner."""
    height, width, _ = background.shape
    x = REAL(width) * (columns.astype(REAL) / REAL(size[0]))
    y = REAL(height) * (rows.astype(REAL) / REAL(size[1]))
    left, top = np.floor(x), np.floor(y)
    fx, fy = x - left, y - top
    x0, y0 = left.astype(np.int64), top.astype(np.int64)
    x1, y1 = np.minimum(np.ceil(x).astype(np.int64), width - 1), np.minimum(np.ceil(y).astype(np.int64), height - 1)
    texels = background.transpose(2, 0, 1).astype(REAL)
    above = texels[:, y0, x0] * (REAL(1) - fx) + texels[:, y0, x1] * fx
    below = texels[:, y1, x0] * (REAL(1) - fx) + texels[:, y1, x1] * fx
    return above * (REAL(1) - fy) + below * fy
