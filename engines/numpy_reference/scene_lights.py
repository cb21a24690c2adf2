"""The lights of a scene in their order, how one is sampled from a point, and how likely a direction was to be sampled.

First the entries of the scene's `lights` as written, then every shape that emits and has an area: a mesh is one light,
each sphere of a set is one. Shapes without bounds are never in the list.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.lights import LIGHTS, InfiniteLightSet, LightSample, LightSet
from engines.numpy_reference.lights.area import AreaLights
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.shapes import Primitives
from engines.numpy_reference.vectors import Array, Indices, dot
from engines.scene import Light


class Infinite(NamedTuple):
    """A light that rays find which hit nothing: member number `member` of its set, and number `light` of all."""

    lights: InfiniteLightSet
    member: int
    light: int

    def Li(self, direction: Array) -> Array:
        """(3, n) radiance from unit directions."""
        return self.lights.Li(self.member, direction)

    def pdf(self, direction: Array, normal: Array) -> Array:
        """(n,) per solid angle, of sampling the directions at points with these shading normals."""
        return self.lights.pdf(self.member, direction, normal)


class Lights:
    """All J lights. `count` is J; `delta` (J,) says which have no size; `infinite` are those at infinity."""

    def __init__(self, lights: Sequence[Light], geometry: Geometry, materials: Materials) -> None:
        row, place = _emitting(geometry, materials, len(lights))
        self.count = len(lights) if not row.size else int(place[-1]) + 1
        self.delta = np.zeros(self.count, bool)
        self._geometry = geometry
        self._sets: list[LightSet | AreaLights] = []
        self._set, self._member = np.zeros(self.count, np.int64), np.zeros(self.count, np.int64)
        self._light = np.full(geometry.kind.size, -1)
        self._light[row] = place
        # the entries of the scene's list
        for kind in dict.fromkeys(LIGHTS.values()):
            places = np.flatnonzero([LIGHTS[type(light)] is kind for light in lights])
            if places.size:
                self._enter(places, kind([lights[j] for j in places]))
        listed = [(self._sets[self._set[j]], int(self._member[j]), j) for j in range(len(lights))]
        self.infinite = [Infinite(cast(InfiniteLightSet, found), *place) for found, *place in listed if found.infinite]
        # shapes that emit
        for shapes, lanes, index in geometry.by_kind(geometry.primitive_id[row]):
            places, light = np.unique(place[lanes], return_inverse=True)
            lit = cast(Primitives, shapes)  # no group emits
            self._enter(places, AreaLights(lit, index, light, materials, geometry.material[row[lanes]]))

    def _enter(self, places: Indices, lights: LightSet | AreaLights) -> None:
        self._set[places] = len(self._sets)
        self._member[places] = np.arange(places.size)
        self.delta[places] = lights.delta
        self._sets.append(lights)

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """One sample of light `light` (n,) from points with shading normals (3, n), by three draws (n,) each."""
        samples = LightSample.empty(light.size)
        chosen = self._set[light]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            for number, lights in enumerate(self._sets):
                lanes = np.flatnonzero(chosen == number)
                if lanes.size:
                    vectors = (vector.take(lanes, axis=1) for vector in (point, normal))
                    draws = (draw[lanes] for draw in (u0, u1, uc))
                    samples.put(lanes, lights.sample(self._member[light[lanes]], *vectors, *draws))
        return samples

    def of_primitive(self, primitive_id: Indices) -> Indices:
        """(n,) the light that each primitive belongs to, -1 for none."""
        return self._light[self._geometry.row(primitive_id)]

    def pdf(self, found: SurfaceInteraction, origin: Array, distance: Array) -> Array:
        """(n,) per solid angle, with which its light's sample would have found each emitting surface from `origin`; 0
        where the surface is in no list. The choice of the light is not included."""
        pdf = np.zeros(distance.size)
        light = self.of_primitive(found.primitive_id)
        cosine = dot(found.wo, found.geometric)
        listed = np.flatnonzero(light >= 0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            for _, some, index in self._geometry.by_kind(found.primitive_id[listed]):
                lanes = listed[some]
                lights = cast(AreaLights, self._sets[self._set[light[lanes[0]]]])  # one set for each kind of shape
                member, start = self._member[light[lanes]], origin.take(lanes, axis=1)
                pdf[lanes] = lights.pdf(member, index, start, distance[lanes], cosine[lanes])
        return pdf


def _emitting(geometry: Geometry, materials: Materials, first: int) -> tuple[Indices, Indices]:
    """Rows of the primitives that are sampled as lights, none of them of a group, and the place of each one's light in the
    list."""
    emits, kind = (materials.emission > 0.0).any(axis=0)[geometry.material], geometry.kind[: geometry.shape.size]
    bounded = np.array([primitives.bounded for primitives in geometry.sets])[kind]
    row = np.flatnonzero(emits[: kind.size] & bounded & (geometry.index[: kind.size] >= 0))
    shape = geometry.shape[row]
    own = np.array([primitives.separate_lights for primitives in geometry.sets])[kind[row]]
    starts = own | (shape != np.concatenate([[-1], shape[:-1]]))
    return row, first + np.cumsum(starts) - 1
