"""The shader `albedo`: the colour of what is hit, without any light."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.context import Context
from engines.numpy_reference.vectors import Array, Indices


def radiance(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) the first of kd, ks, kt and emission that is not black, at what is hit; black where nothing is."""
    table = context.materials
    colour = np.zeros(table.kd.shape)
    for candidate in (table.emission, table.kt, table.ks, table.kd):
        colour = np.where((candidate > 0.0).any(axis=0), candidate, colour)
    hits = context.closest(origin, direction)
    seen = np.zeros(origin.shape)
    arrived = np.flatnonzero(hits.rank >= 0)
    seen[:, arrived] = colour.take(context.geometry.material[hits.rank[arrived]], axis=1)
    return seen
