"""Area lights: shapes that emit, whatever their kind; how a point on one is found is the shape's business."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.distribution import first_above, shares
from engines.numpy_reference.lights.interface import LightSample
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.shapes import Primitives
from engines.numpy_reference.vectors import Array, Indices


class AreaLights:
    """All lights of one kind of shape. A light is one primitive, or many that are chosen by their area: a mesh.

    For m primitives that emit: `index` (m,) among `shapes`, ascending; their `light` (0, 1, ... without gaps); and their
    `material` (m,) among `materials`.
    """

    delta = False
    infinite = False

    def __init__(self, shapes: Primitives, index: Indices, light: Indices, materials: Materials, material: Indices) -> None:
        self._shapes, self._index = shapes, index
        self._materials, self._material = materials, material
        self._size = np.bincount(light)
        self._start = np.cumsum(self._size) - self._size
        areas = np.split(shapes.area[index], self._start[1:])
        self._shares = np.concatenate([shares(area) for area in areas])
        self._area = np.array([np.cumsum(area)[-1] for area in areas])

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """A primitive by `uc`, a point on it by `u0` and `u1`; black behind one that emits on its front alone."""
        start = self._start[light]
        member = start + first_above(self._shares, start, self._size[light], uc)
        index, material = self._index[member], self._material[member]
        found = self._shapes.sample(index, point, u0, u1, self._area[light])
        lit = found.front | self._materials.two_sided[material]
        place = point + found.distance * found.wi
        radiance = self._materials.radiance(self._shapes, index, material, -found.wi, place)
        weight = np.where(lit, radiance / found.pdf, 0.0)
        return LightSample(found.wi, found.distance, weight, found.pdf)

    def pdf(self, light: Indices, index: Indices, point: Array, distance: Array, cosine: Array) -> Array:
        """(n,) per solid angle, with which `sample` from `point` finds what lies on the primitive `index` of a light, at
        this distance and under this cosine at the primitive."""
        return self._shapes.pdf(index, point, distance, cosine, self._area[light])
