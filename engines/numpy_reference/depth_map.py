"""The shader `depth_map`: how near things are, as a level of grey."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.context import Context
from engines.numpy_reference.vectors import Array, Indices, norm


def Li(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) grey levels: 1 at the eye, 0 from 1.1 times the distance of `max_point` on, 0 on a miss."""
    hits = context.closest(origin, direction)
    far = context.options["max_point"]
    if far is None:
        far = context.geometry.upper_corner
    if far is None:  # only planes, which have no corner
        return np.zeros(origin.shape)
    scale = 1.1 * norm(np.reshape(far, (3, 1)).astype(np.float64) - origin)
    with np.errstate(divide="ignore", invalid="ignore"):
        grey = np.maximum((scale - hits.t) / scale, 0.0)
    grey = np.where((hits.primitive_id >= 0) & (scale > 0.0), grey, 0.0)
    return np.stack([grey, grey, grey])
