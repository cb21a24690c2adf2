"""Spheres, by the formula that keeps its digits for distant and for huge ones (Haines et al., Ray Tracing Gems 7).

As lights they are sampled over the cone under which they are seen, from inside and close by over their area.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.shapes.interface import LocalGeometry, Primitives, ShapeSample, TextureCoordinates, turn
from engines.numpy_reference.vectors import EPSILON, Array, Indices, Mask, along, dot, norm, unit
from engines.scene import Sphere, SphereSet


class Spheres(Primitives):
    """All spheres of a scene, those of sphere sets too. `data` (1, 4, m): centre, radius."""

    planar = False
    bounded = True
    separate_lights = True

    def __init__(self, shapes: Sequence[Sphere | SphereSet], primitive_id: Indices) -> None:
        self.primitive_id = primitive_id
        centers = [shape.centers if isinstance(shape, SphereSet) else np.array([shape.center]) for shape in shapes]
        radii = [shape.radii if isinstance(shape, SphereSet) else np.array([shape.radius]) for shape in shapes]
        self._center = np.concatenate([np.zeros((0, 3)), *centers]).T.copy()
        self._radius = np.concatenate([np.zeros(0), *radii])
        self.area = 4.0 * np.pi * self._radius * self._radius
        self.data = np.concatenate([self._center, self._radius[None]])[None]

    @staticmethod
    def count(shape: Sphere | SphereSet) -> int:
        return len(shape.radii) if isinstance(shape, SphereSet) else 1

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

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """The first coordinate is the longitude around the world's z axis."""
        outward = unit(point - self._center.take(index, axis=1))
        dp_du = np.stack([-outward[1], outward[0], np.zeros(index.size)])
        return LocalGeometry(outward, outward, dp_du, self._radius[index])

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """u is the longitude around +z, v the angle from +z."""
        x, y, z = point - self._center.take(index, axis=1)
        phi = turn(y, x)
        theta = np.arccos(np.clip(z / self._radius[index], -1.0, 1.0))
        uv = np.stack([phi / (2.0 * np.pi), theta / np.pi])
        dp_du = 2.0 * np.pi * np.stack([-y, x, np.zeros(index.size)])
        return TextureCoordinates(uv, dp_du, np.pi * np.stack([z * np.cos(phi), z * np.sin(phi), -np.hypot(x, y)]))

    def bounds(self) -> tuple[Array, Array]:
        return self._center - self._radius, self._center + self._radius

    def sample(self, index: Indices, point: Array, u0: Array, u1: Array, area: Array) -> ShapeSample:
        """Uniform over the cone of the sphere from outside, over its surface from inside or close by."""
        radius = self._radius[index]
        cone = _cone(self._center.take(index, axis=1) - point, radius)
        phi = 2.0 * np.pi * u1
        # over the cone: the nearer of the two points in the direction
        drop = u0 * cone.spread
        sine2 = drop * (2.0 - drop)
        sine = np.sqrt(sine2)
        wi = along(sine * np.cos(phi), sine * np.sin(phi), 1.0 - drop, cone.axis)
        chord = np.maximum(radius * radius - cone.distance * cone.distance * sine2, 0.0)
        nearer = cone.distance * (1.0 - drop) - np.sqrt(chord)
        # over the surface
        z = 1.0 - 2.0 * u0
        ring = np.sqrt(np.maximum(1.0 - z * z, 0.0))
        outward = np.stack([ring * np.cos(phi), ring * np.sin(phi), z])
        to_shape = cone.distance * cone.axis + radius * outward
        distance = norm(to_shape)
        towards = to_shape / distance
        cosine = -dot(towards, outward)
        return ShapeSample(
            wi=np.where(cone.outside, wi, towards),
            distance=np.where(cone.outside, nearer, distance),
            front=cone.outside | (cosine > 0.0),
            pdf=np.where(cone.outside, cone.pdf, _pdf_by_area(distance, cosine, radius)),
        )

    def pdf(self, index: Indices, point: Array, distance: Array, cosine: Array, area: Array) -> Array:
        """A sphere is a light of its own: `area` is not looked at."""
        radius = self._radius[index]
        cone = _cone(self._center.take(index, axis=1) - point, radius)
        return np.where(cone.outside, cone.pdf, _pdf_by_area(distance, cosine, radius))


SHAPES = {Sphere: Spheres, SphereSet: Spheres}


class _Cone(NamedTuple):
    """How a sphere is seen from a point: `spread` is 1 - cos of the cone's half angle; no cone where not `outside`."""

    outside: Mask
    axis: Array
    distance: Array
    spread: Array
    pdf: Array


def _cone(to_center: Array, radius: Array) -> _Cone:
    square = dot(to_center, to_center)
    outside = square > 1.0001 * radius * radius
    sine2 = np.where(outside, radius * radius / square, 1.0)
    spread = sine2 / (1.0 + np.sqrt(1.0 - sine2))
    distance = np.sqrt(square)
    return _Cone(outside, to_center / distance, distance, spread, 1.0 / (2.0 * np.pi * spread))


def _pdf_by_area(distance: Array, cosine: Array, radius: Array) -> Array:
    return distance * distance / (np.abs(cosine) * 4.0 * np.pi * radius * radius)
