"""Vectors of many rays at once: shape (3, n) float64, the last axis being the ray, so `o + t * d` reads as in a book.

Colours have the same shape, with red, green and blue on the first axis. Every operation works element by element, so a
ray's result has the same bits whatever rays share its array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
EPSILON = float(np.finfo(np.float64).eps)


def columns(objects: Sequence[Any], name: str) -> Array:
    """(3, m) an attribute of objects that is three numbers."""
    return np.array([getattr(each, name) for each in objects], np.float64).reshape(-1, 3).T.copy()


def dot(a: Array, b: Array) -> Array:
    """(n,) inner products."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Array, b: Array) -> Array:
    """(3, n) right-handed outer products."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def norm(a: Array) -> Array:
    """(n,) lengths; squares of components below 1e-154 or above 1e154 leave the range of float64."""
    return np.sqrt(dot(a, a))


def unit(a: Array) -> Array:
    """Unit vectors along `a`, whatever its length; NaN where `a` is zero or not finite."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scaled = a / np.abs(a).max(axis=0)
        return scaled / norm(scaled)


def frame(n: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed orthonormal basis (t1, t2, n) with unit `n` (Duff et al. 2017).

    The two charts meet at n.z = -0.7, not at 0: many a facet lies along z, and must not turn on the sign of an error.
    """
    sign = np.where(n[2] < -0.7, -1.0, 1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    t1 = np.stack([1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]])
    t2 = np.stack([b, sign + n[1] * n[1] * a, -n[1]])
    return t1, t2


class Frame(NamedTuple):
    """Right-handed orthonormal frames: three unit vectors (3, n), z along a normal."""

    x: Array
    y: Array
    z: Array

    @classmethod
    def along(cls, n: Array, u: Array) -> Frame:
        """z along unit `n`, x along the part of `u` (of any length) across it; where that is next to nothing, as in `frame`."""
        across = u - n * dot(n, u)
        aligned = dot(across, across) <= 1e-8 * dot(u, u)
        x = np.where(aligned, frame(n)[0], unit(across))
        return cls(x, cross(n, x), n)

    def to_local(self, v: Array) -> Array:
        """(3, n) coordinates of vectors in the frame."""
        return np.stack([dot(self.x, v), dot(self.y, v), dot(self.z, v)])

    def to_world(self, v: Array) -> Array:
        """(3, n) vectors of which the frame's coordinates are given."""
        return v[0] * self.x + v[1] * self.y + v[2] * self.z


def along(x: Array, y: Array, z: Array, n: Array) -> Array:
    """The vector with coordinates (x, y, z) in the frame of unit `n`."""
    t1, t2 = frame(n)
    return x * t1 + y * t2 + z * n


def cosine_hemisphere(n: Array, u0: Array, u1: Array) -> Array:
    """(3, n) directions around unit `n` with density cos/pi per solid angle, from two draws in [0, 1)."""
    radius, phi = np.sqrt(u0), 2.0 * np.pi * u1
    return along(radius * np.cos(phi), radius * np.sin(phi), np.sqrt(1.0 - u0), n)


def uniform_sphere(u0: Array, u1: Array) -> Array:
    """(3, n) directions with density 1/(4 pi) per solid angle, from two draws in [0, 1)."""
    z, phi = 1.0 - 2.0 * u0, 2.0 * np.pi * u1
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z])
