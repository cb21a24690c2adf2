"""The accelerator `none`: every ray against every primitive, in tiles that fit the processor's cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.shapes import Primitives
from engines.numpy_reference.vectors import Array, Indices

TILE = 32_768
"""Pairs of ray and primitive a tile: with more, temporaries leave the cache; with fewer, calls cost more than work."""


class Exhaustive:
    """Tests all of one kind's primitives; owns no memory of its own."""

    nbytes = 0

    def __init__(self, primitives: Primitives) -> None:
        self._primitives = primitives

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower id."""
        for tile, t in self._distances(origin, direction, nearest, check):
            first = t.min(axis=0)
            better = np.flatnonzero((first <= nearest.t[tile.lanes]) & (first < np.inf))
            if better.size:
                lanes = tile.lanes[better]
                # argmin gives the first of equals: the lowest id of the tile
                found = tile.first_primitive + t[:, better].argmin(axis=0)
                nearest.offer(lanes, first[better], self._primitives.primitive_id[found])

    def occluded(self, origin: Array, direction: Array, before: Nearest, check: Callable[[], None]) -> np.ndarray:
        """(n,) whether anything lies in (0, before.t)."""
        dark = np.zeros(before.t.size, bool)
        for tile, t in self._distances(origin, direction, before, check):
            dark[tile.lanes] |= t.min(axis=0) < before.t[tile.lanes]
        return dark

    def _distances(
        self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]
    ) -> Iterator[tuple[_Tile, Array]]:
        """Tiles with the distances (primitives, rays) in them, inf for what a ray has just left."""
        left = nearest.origins_among(self._primitives)
        for tile in self._tiles(origin, direction):
            check()
            t = self._primitives.distance(tile.primitives, tile.rays)
            if left is not None:
                row = left[tile.lanes] - tile.first_primitive
                here = np.flatnonzero((row >= 0) & (row < t.shape[0]))
                t[row[here], here] = np.inf
            yield tile, t

    def _tiles(self, origin: Array, direction: Array) -> Iterator[_Tile]:
        primitives = self._primitives
        count = primitives.primitive_id.size
        if not count:
            return
        height = min(count, 64)
        width = TILE // height
        copies, rays = primitives.rays(origin, direction)
        for copy, data in enumerate(primitives.data):
            lanes = np.flatnonzero(copies == copy)
            for begin in range(0, lanes.size, width):
                part = lanes[begin : begin + width]
                columns = rays.take(part, axis=1)[:, None]
                for first in range(0, count, height):
                    yield _Tile(first, data[:, first : first + height, None], part, columns)


class _Tile(NamedTuple):
    first_primitive: int
    primitives: Array
    lanes: Indices
    rays: Array
