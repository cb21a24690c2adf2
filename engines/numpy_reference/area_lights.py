"""Shapes that emit: triangles and meshes, sampled evenly over their area, and spheres, sampled over their cone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.distribution import first_above, shares
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.light_sample import LightSample
from engines.numpy_reference.material import Materials
from engines.numpy_reference.vectors import Array, Indices, along, dot, norm


class FaceLights:
    """Lights made of triangles: `rank` of all faces, ascending, and for each its `light` (0, 1, ... without gaps)."""

    delta = False

    def __init__(self, geometry: Geometry, materials: Materials, rank: Indices, light: Indices) -> None:
        self._triangles = geometry.triangles
        self._face = geometry.index[rank]
        material = geometry.material[rank]
        self._emission, self._two_sided = materials.emission.take(material, axis=1), materials.two_sided[material]
        self._size = np.bincount(light)
        self._start = np.cumsum(self._size) - self._size
        areas = np.split(self._triangles.area[self._face], self._start[1:])
        self._shares = np.concatenate([shares(area) for area in areas])
        self._total_area = np.array([np.cumsum(area)[-1] for area in areas])

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """A face by `uc`, a point on it by `u0` and `u1`; black behind a face that emits on its front alone."""
        start = self._start[light]
        member = start + first_above(self._shares, start, self._size[light], uc)
        face = self._face[member]
        a, b, c = (corner.take(face, axis=1) for corner in (self._triangles.a, self._triangles.b, self._triangles.c))
        su = np.sqrt(u0)
        to_light = (1.0 - su) * a + su * (1.0 - u1) * b + su * u1 * c - point
        distance = norm(to_light)
        wi = to_light / distance
        cosine = -dot(wi, self._triangles.normal.take(face, axis=1))
        pdf = self.pdf(light, distance, cosine)
        lit = (cosine > 0.0) | self._two_sided[member]
        return LightSample(wi, distance, np.where(lit, self._emission.take(member, axis=1) / pdf, 0.0), pdf)

    def pdf(self, light: Indices, distance: Array, cosine: Array) -> Array:
        """(n,) per solid angle, of a point at this distance, seen under this cosine at the light."""
        return distance * distance / (np.abs(cosine) * self._total_area[light])


class SphereLights:
    """Lights that are spheres: `rank` (m,) of each."""

    delta = False

    def __init__(self, geometry: Geometry, materials: Materials, rank: Indices) -> None:
        index, material = geometry.index[rank], geometry.material[rank]
        self._center, self._radius = geometry.spheres.center.take(index, axis=1), geometry.spheres.radius[index]
        self._emission, self._two_sided = materials.emission.take(material, axis=1), materials.two_sided[material]

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """Evenly over the cone of the sphere from outside, over its surface from inside or close by."""
        radius, emission = self._radius[light], self._emission.take(light, axis=1)
        cone = _cone(self._center.take(light, axis=1) - point, radius)
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
        to_light = cone.distance * cone.axis + radius * outward
        distance = norm(to_light)
        towards = to_light / distance
        cosine = -dot(towards, outward)
        lit = cone.outside | (cosine > 0.0) | self._two_sided[light]
        pdf = np.where(cone.outside, cone.pdf, _pdf_by_area(distance, cosine, radius))
        return LightSample(
            wi=np.where(cone.outside, wi, towards),
            distance=np.where(cone.outside, nearer, distance),
            arriving=np.where(lit, emission / pdf, 0.0),
            pdf=pdf,
        )

    def pdf(self, light: Indices, origin: Array, distance: Array, cosine: Array) -> Array:
        """(n,) per solid angle, of a direction from `origin` that meets the sphere at this distance and cosine."""
        radius = self._radius[light]
        cone = _cone(self._center.take(light, axis=1) - origin, radius)
        return np.where(cone.outside, cone.pdf, _pdf_by_area(distance, cosine, radius))


class _Cone(NamedTuple):
    """How a sphere is seen from a point: `spread` is 1 - cos of the cone's half angle; no cone where not `outside`."""

    outside: np.ndarray
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
