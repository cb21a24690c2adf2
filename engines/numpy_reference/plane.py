"""Infinite planes: the ray crosses where n . (p0 - o) = t n . d."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import Array, Indices, dot


class Planes:
    """All planes of a scene. `data` (1, 6, m): point and normal; `rank` (m,) ascending places in the scene's order."""

    flat = True

    def __init__(self, point: Array, normal: Array, rank: Indices) -> None:
        self.normal, self.rank = normal, rank
        self.data = np.concatenate([point, normal])[None]

    @staticmethod
    def rays(origin: Array, direction: Array) -> tuple[Indices, Array]:
        """Which of the copies in `data` serves each ray (n,), and what `distance` wants of it (6, n)."""
        return np.zeros(origin.shape[1], np.int64), np.concatenate([origin, direction])

    @staticmethod
    def distance(plane: Array, ray: Array) -> Array:
        """t > 0 where the ray crosses, inf where it does not; the arguments broadcast after their first axis."""
        origin, direction, point, normal = ray[:3], ray[3:], plane[:3], plane[3:]
        t = dot(normal, point - origin) / dot(normal, direction)
        return np.where(t > 0.0, t, np.inf)
