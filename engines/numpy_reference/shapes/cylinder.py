"""Cylinders without caps: along and across the axis a ray is a line over time and a line in the plane of a circle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.shapes.interface import (
    LocalGeometry,
    Primitives,
    ShapeSample,
    TextureCoordinates,
    pdf_solid_angle,
    turn,
)
from engines.numpy_reference.vectors import EPSILON, Array, Indices, columns, dot, frame, norm, unit
from engines.scene import Cylinder


class Cylinders(Primitives):
    """All cylinders of a scene. `data` (1, 14, m): one end, the frame about the axis (t1, t2, axis), length, radius."""

    planar = False
    bounded = True
    separate_lights = False

    def __init__(self, shapes: Sequence[Cylinder], primitive_id: Indices) -> None:
        self.primitive_id = primitive_id
        self._end, self._way = columns(shapes, "p0"), columns(shapes, "p1") - columns(shapes, "p0")
        self._axis, self._length = unit(self._way), norm(self._way)
        self._across = frame(self._axis)
        self._radius = np.array([shape.radius for shape in shapes], np.float64)
        self.area = 2.0 * np.pi * self._radius * self._length
        rows = [self._end, *self._across, self._axis, self._length[None], self._radius[None]]
        self.data = np.concatenate(rows)[None]

    @staticmethod
    def distance(cylinder: Array, ray: Array) -> Array:
        """Smallest t > 0 on the surface between the ends, inf where there is none; broadcasts after the first axis.

        An origin within four units in the last place of the surface lies on it: the root near zero is not a hit.
        """
        start, direction, length, radius = ray[:3] - cylinder[:3], ray[3:], cylinder[12], cylinder[13]
        x, y, height = (dot(axis, start) for axis in (cylinder[3:6], cylinder[6:9], cylinder[9:12]))
        u, v, climb = (dot(axis, direction) for axis in (cylinder[3:6], cylinder[6:9], cylinder[9:12]))
        speed2, moment, b = u * u + v * v, x * v - y * u, -(x * u + y * v)
        q = b + np.copysign(np.sqrt(radius * radius * speed2 - moment * moment), b)
        away = np.hypot(x, y)
        gap = away - radius
        gap = np.where(np.abs(gap) <= 4.0 * EPSILON * radius, 0.0, gap)
        roots = gap * (away + radius) / q, q / speed2
        t = np.full(np.shape(q), np.inf)
        for root in roots:
            place = height + climb * root
            t = np.where((root > 0.0) & (place >= 0.0) & (place <= length), np.minimum(root, t), t)
        return t

    def _about(self, index: Indices, point: Array) -> tuple[Array, Array, Array]:
        """(n,) angle about the axis, and the unit vectors (3, n) away from it and along increasing angle."""
        t1, t2 = (axis.take(index, axis=1) for axis in self._across)
        away = point - self._end.take(index, axis=1)
        x, y = dot(away, t1), dot(away, t2)
        distance = np.hypot(x, y)
        return turn(y, x), (x * t1 + y * t2) / distance, (x * t2 - y * t1) / distance

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """The first coordinate is the share of a turn about the axis."""
        _, outward, around = self._about(index, point)
        radius = self._radius[index]
        return LocalGeometry(outward, outward, 2.0 * np.pi * radius * around, radius)

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """u runs around the axis, v along it."""
        phi, _, around = self._about(index, point)
        way, axis = self._way.take(index, axis=1), self._axis.take(index, axis=1)
        v = dot(point - self._end.take(index, axis=1), axis) / self._length[index]
        uv = np.stack([phi / (2.0 * np.pi), v])
        return TextureCoordinates(uv, 2.0 * np.pi * self._radius[index] * around, way)

    def bounds(self) -> tuple[Array, Array]:
        """Tight: along an axis of the scene the circles at the ends reach as far as their two diameters along the frame."""
        extent = self._radius * np.hypot(*self._across)
        ends = self._end, self._end + self._way
        return np.minimum(*ends) - extent, np.maximum(*ends) + extent

    def sample(self, index: Indices, point: Array, u0: Array, u1: Array, area: Array) -> ShapeSample:
        """Uniform over the area."""
        (t1, t2), phi = (axis.take(index, axis=1) for axis in self._across), 2.0 * np.pi * u1
        outward = np.cos(phi) * t1 + np.sin(phi) * t2
        to_axis = self._end.take(index, axis=1) + u0 * self._way.take(index, axis=1) - point
        to_shape = to_axis + self._radius[index] * outward
        distance = norm(to_shape)
        wi = to_shape / distance
        cosine = -dot(wi, outward)
        return ShapeSample(wi, distance, cosine > 0.0, pdf_solid_angle(distance, cosine, area))


SHAPES = {Cylinder: Cylinders}
