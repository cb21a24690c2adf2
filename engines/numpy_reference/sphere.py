"""Spheres, by the formula that keeps its digits for distant and for huge ones (Haines et al., Ray Tracing Gems 7)."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import EPSILON, Array, Indices, dot, norm


class Spheres:
    """All spheres of a scene. `data` (1, 4, m): centre, radius; `rank` (m,) ascending places in the scene's order."""

    flat = False

    def __init__(self, center: Array, radius: Array, rank: Indices) -> None:
        self.center, self.radius, self.rank = center, radius, rank
        self.data = np.concatenate([center, radius[None]])[None]

    def boxes(self) -> tuple[Array, Array]:
        """Lower and upper corners, (3, m) each."""
        return self.center - self.radius, self.center + self.radius

    @staticmethod
    def rays(origin: Array, direction: Array) -> tuple[Indices, Array]:
        """Which of the copies in `data` serves each ray (n,), and what `distance` wants of it (6, n)."""
        return np.zeros(origin.shape[1], np.int64), np.concatenate([origin, direction])

    @staticmethod
    def distance(sphere: Array, ray: Array) -> Array:
        """Smallest t > 0 on the surface, inf where there is none; the arguments broadcast after their first axis.

        An origin within four units in the last place of the surface lies on it: the root near zero is not a hit.
        """
        origin, direction, center, radius = ray[:3], ray[3:], sphere[:3], sphere[3]
        f = origin - center
        a = dot(direction, direction)
        b = -dot(f, direction)
        to_axis = f + (b / a) * direction
        discriminant = radius * radius - dot(to_axis, to_axis)
        q = b + np.copysign(np.sqrt(a * discriminant), b)
        away = norm(f)
        gap = away - radius
        gap = np.where(np.abs(gap) <= 4.0 * EPSILON * radius, 0.0, gap)
        t0, t1 = gap * (away + radius) / q, q / a
        near = np.minimum(t0, t1)
        t = np.where(near > 0.0, near, np.maximum(t0, t1))
        return np.where(t > 0.0, t, np.inf)
