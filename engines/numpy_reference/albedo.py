"""The shader `albedo`: the colour of what is hit, without any light."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.context import Context
from engines.numpy_reference.vectors import Array, Indices

WALK = 5
"""The dimension that chooses a lobe at the first vertex."""


def Li(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) the albedo of the material that is hit, its emission where that is black; black where nothing is."""
    hits = context.closest(origin, direction)
    seen = np.zeros(origin.shape)
    arrived = np.flatnonzero(hits.primitive_id >= 0)
    at = context.surface(origin.take(arrived, axis=1), direction.take(arrived, axis=1), hits.take(arrived))
    at, _ = context.materials.walk(at, context.draw(pixel[arrived], sample, WALK))
    seen[:, arrived] = context.materials.albedo(at)
    return seen
