"""Disks: the plane of a disk is crossed where n . (c - o) = t n . d, and the disk hit up to its radius around c."""

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
from engines.numpy_reference.vectors import Array, Indices, along, columns, dot, frame, norm, unit
from engines.scene import Disk


class Disks(Primitives):
    """All disks of a scene. `data` (1, 7, m): centre, normal, radius."""

    planar = True
    bounded = True
    separate_lights = False

    def __init__(self, shapes: Sequence[Disk], primitive_id: Indices) -> None:
        self.primitive_id = primitive_id
        self._center, self._normal = columns(shapes, "center"), unit(columns(shapes, "normal"))
        self._radius = np.array([shape.radius for shape in shapes], np.float64)
        self.area = np.pi * self._radius * self._radius
        self.data = np.concatenate([self._center, self._normal, self._radius[None]])[None]

    @staticmethod
    def distance(disk: Array, ray: Array) -> Array:
        """t > 0 where the ray crosses the disk, its edge included, inf elsewhere; broadcasts after the first axis."""
        origin, direction, center, normal, radius = ray[:3], ray[3:], disk[:3], disk[3:6], disk[6]
        from_center = origin - center
        t = -dot(normal, from_center) / dot(normal, direction)
        return np.where((t > 0.0) & (norm(from_center + t * direction) <= radius), t, np.inf)

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """The first coordinate is the distance from the centre."""
        normal = self._normal.take(index, axis=1)
        return LocalGeometry(normal, normal, point - self._center.take(index, axis=1), self._radius[index])

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """u runs from the centre to the rim, v around the normal."""
        t1, t2 = frame(self._normal.take(index, axis=1))
        away, radius = point - self._center.take(index, axis=1), self._radius[index]
        phi, distance = turn(dot(away, t2), dot(away, t1)), norm(away)
        outwards, around = np.cos(phi) * t1 + np.sin(phi) * t2, np.cos(phi) * t2 - np.sin(phi) * t1
        uv = np.stack([distance / radius, phi / (2.0 * np.pi)])
        return TextureCoordinates(uv, radius * outwards, 2.0 * np.pi * distance * around)

    def bounds(self) -> tuple[Array, Array]:
        """Tight: along an axis a disk reaches as far as the sine of the angle between the axis and its normal."""
        extent = self._radius * np.sqrt(np.maximum(1.0 - self._normal * self._normal, 0.0))
        return self._center - extent, self._center + extent

    def sample(self, index: Indices, point: Array, u0: Array, u1: Array, area: Array) -> ShapeSample:
        """Uniform over the area."""
        normal, radius, phi = self._normal.take(index, axis=1), self._radius[index] * np.sqrt(u0), 2.0 * np.pi * u1
        from_center = along(radius * np.cos(phi), radius * np.sin(phi), np.zeros(index.size), normal)
        to_shape = self._center.take(index, axis=1) + from_center - point
        distance = norm(to_shape)
        wi = to_shape / distance
        cosine = -dot(wi, normal)
        return ShapeSample(wi, distance, cosine > 0.0, pdf_solid_angle(distance, cosine, area))


SHAPES = {Disk: Disks}
