"""Infinite planes: the ray crosses where n . (p0 - o) = t n . d."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.shapes.interface import LocalGeometry, Primitives, ShapeSample, TextureCoordinates
from engines.numpy_reference.vectors import Array, Indices, columns, dot, frame, unit
from engines.scene import Plane


class Planes(Primitives):
    """All planes of a scene. `data` (1, 6, m): point and normal. They emit, but are not sampled: their area is infinite."""

    planar = True
    bounded = False
    separate_lights = False

    def __init__(self, shapes: Sequence[Plane], primitive_id: Indices) -> None:
        self.primitive_id = primitive_id
        self.area = np.full(primitive_id.size, np.inf)
        self._normal = unit(columns(shapes, "normal"))
        self._point = columns(shapes, "point")
        self.data = np.concatenate([self._point, self._normal])[None]

    @staticmethod
    def distance(plane: Array, ray: Array) -> Array:
        """t > 0 where the ray crosses, inf where it does not; the arguments broadcast after their first axis."""
        origin, direction, point, normal = ray[:3], ray[3:], plane[:3], plane[3:]
        t = dot(normal, point - origin) / dot(normal, direction)
        return np.where(t > 0.0, t, np.inf)

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        normal = self._normal.take(index, axis=1)
        return LocalGeometry(normal, normal, np.zeros_like(normal), 0.0)

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """Metres from the plane's point along the local frame of its normal."""
        t1, t2 = frame(self._normal.take(index, axis=1))
        away = point - self._point.take(index, axis=1)
        return TextureCoordinates(np.stack([dot(away, t1), dot(away, t2)]), t1, t2)

    def bounds(self) -> tuple[Array, Array]:
        raise TypeError("a plane has no bounding box")

    @staticmethod
    def corners() -> Array:
        return np.zeros((3, 0))

    def sample(self, index: Indices, point: Array, u0: Array, u1: Array, area: Array) -> ShapeSample:
        raise TypeError("a plane has infinite area and cannot be sampled")

    def pdf(self, index: Indices, point: Array, distance: Array, cosine: Array, area: Array) -> Array:
        return np.zeros(distance.size)


SHAPES = {Plane: Planes}
