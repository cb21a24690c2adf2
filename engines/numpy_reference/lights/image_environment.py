"""An image on the sphere at infinity, sampled by its brightness."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.distribution import first_above, rest, shares
from engines.numpy_reference.vectors import Array, Indices, dot
from engines.scene import EnvironmentLight


class ImageEnvironment:
    """A latitude-longitude image (h, w, 3) times a radiance: +y up, -z at the left edge, +z in the middle, before it is
    rotated."""

    def __init__(self, light: EnvironmentLight) -> None:
        assert light.image is not None
        image = np.asarray(light.image, np.float64) * np.array(light.radiance)
        self._image = np.ascontiguousarray(image.transpose(2, 0, 1))
        height, width = self._shape = image.shape[:2]
        self._to_world = np.array(light.rotation)
        self._poles = light.rows == "poles"
        smooth = _neighbourhood_mean(image.mean(axis=2))
        weight = smooth * np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]
        total = weight.sum()
        self._density = weight * (width * height / total) if total > 0.0 else weight
        """(h, w) per unit of (u, v), 0 everywhere for a black image."""
        self._columns = shares(weight).reshape(-1)
        self._rows = shares(weight.sum(axis=1))

    def Li(self, direction: Array) -> Array:
        """(3, n) from unit directions, bilinear between the centres of texels; columns wrap, rows clamp."""
        return self._bilinear(*self._place(direction))

    def pdf(self, direction: Array, normal: Array) -> Array:
        """(n,) per solid angle, of sampling the directions; normals play no role."""
        u, v = self._place(direction)
        height, width = self._shape
        row = np.minimum((v * height).astype(np.int64), height - 1)
        column = np.minimum((u * width).astype(np.int64), width - 1)
        return self._per_solid_angle(row, column, v)

    def sample(self, normal: Array, u0: Array, u1: Array) -> tuple[Array, Array]:
        """Unit directions (3, n) and their pdf per solid angle (n,)."""
        height, width = self._shape
        top = np.zeros(u0.size, np.int64)
        row = first_above(self._rows, top, top + height, u1)
        column = first_above(self._columns, row * width, top + width, u0)
        u = (column + rest(self._columns, row * width, column, u0)) / width
        v = (row + rest(self._rows, top, row, u1)) / height
        phi, sine = 2.0 * np.pi * u, np.sin(np.pi * v)
        wi = np.stack([sine * np.sin(phi), np.cos(np.pi * v), -sine * np.cos(phi)])
        return self._rotated(wi, self._to_world), self._per_solid_angle(row, column, v)

    def _place(self, direction: Array) -> tuple[Array, Array]:
        """(u, v) in [0, 1] of unit directions."""
        return _place(self._rotated(direction, self._to_world.T))

    @staticmethod
    def _rotated(direction: Array, matrix: Array) -> Array:
        """Element by element, as a ray's result must not depend on the rays beside it."""
        if np.array_equal(matrix, np.eye(3)):
            return direction
        return np.stack([dot(row, direction) for row in matrix])

    def _per_solid_angle(self, row: Indices, column: Indices, v: Array) -> Array:
        sine = np.sin(np.pi * v)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(sine > 0.0, self._density[row, column] / (2.0 * np.pi**2 * sine), 0.0)

    def _bilinear(self, u: Array, v: Array) -> Array:
        height, width = self._shape
        x, y = u * width - 0.5, v * (height - 1.0) if self._poles else v * height - 0.5
        left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = x - left, y - top
        x0, x1 = left % width, (left + 1) % width
        y0, y1 = np.maximum(top, 0), np.minimum(top + 1, height - 1)
        upper = self._image[:, y0, x0] * (1.0 - fx) + self._image[:, y0, x1] * fx
        lower = self._image[:, y1, x0] * (1.0 - fx) + self._image[:, y1, x1] * fx
        return upper * (1.0 - fy) + lower * fy


def _place(direction: Array) -> tuple[Array, Array]:
    """(u, v) in [0, 1] of unit directions."""
    x, y, z = direction
    turn = np.arctan2(x, -z) / (2.0 * np.pi)
    return turn - np.floor(turn), np.arccos(np.clip(y, -1.0, 1.0)) / np.pi


def _neighbourhood_mean(grey: Array) -> Array:
    """The mean over 3 x 3 texels, so that the bilinear image is positive only where its sampling is."""
    above, below = np.concatenate([grey[:1], grey[:-1]]), np.concatenate([grey[1:], grey[-1:]])
    tall = above + grey + below
    return (np.roll(tall, 1, axis=1) + tall + np.roll(tall, -1, axis=1)) / 9.0
