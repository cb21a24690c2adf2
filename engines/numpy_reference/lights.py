"""The lights of a scene in their order, how one is sampled from a point, and how likely a direction was to be sampled.

First the entries of the scene's `lights` as written, then every shape that emits and has an area: a mesh is one light,
each sphere of a set is one. Planes are never in the list.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from engines.numpy_reference.area_lights import FaceLights, SphereLights
from engines.numpy_reference.delta_lights import DirectionalLights, PointLights
from engines.numpy_reference.environment import Environment, environment
from engines.numpy_reference.geometry import PLANE, SPHERE, Geometry
from engines.numpy_reference.light_sample import LightSample
from engines.numpy_reference.material import Materials
from engines.numpy_reference.surface import Surface
from engines.numpy_reference.vectors import Array, Indices, dot
from engines.scene.model import DirectionalLight, EnvironmentLight, Light, PointLight


class Lights:
    """All J lights. `count` is J; `delta` (J,) says which have no size; `environments` pairs their places with them."""

    def __init__(self, lights: Sequence[Light], geometry: Geometry, materials: Materials) -> None:
        self._groups: list[Any] = []
        rank, place = _emitting(geometry, materials, len(lights))
        self.count = len(lights) if not rank.size else int(place[-1]) + 1
        self.delta = np.zeros(self.count, bool)
        self._group, self._member = np.zeros(self.count, np.int64), np.zeros(self.count, np.int64)
        self._light = np.full(geometry.kind.size, -1)
        self._light[rank] = place
        for kind, group in ((PointLight, PointLights), (DirectionalLight, DirectionalLights)):
            places = [j for j, light in enumerate(lights) if isinstance(light, kind)]
            if places:
                self._enter(places, group([lights[j] for j in places]))
        self.environments: list[tuple[int, Environment]] = []
        for j, light in enumerate(lights):
            if isinstance(light, EnvironmentLight):
                self.environments.append((j, environment(light)))
                self._enter([j], _Sky(self.environments[-1][1]))
        ball = geometry.kind[rank] == SPHERE
        if ball.any():
            self._balls = SphereLights(geometry, materials, rank[ball])
            self._enter(place[ball], self._balls)
        if not ball.all():
            places, face_light = np.unique(place[~ball], return_inverse=True)
            self._faces = FaceLights(geometry, materials, rank[~ball], face_light)
            self._enter(places, self._faces)
        self._is_ball = geometry.kind == SPHERE

    def _enter(self, places: Any, group: Any) -> None:
        self._group[places] = len(self._groups)
        self._member[places] = np.arange(len(places))
        self.delta[places] = group.delta
        self._groups.append(group)

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """One sample of light `light` (n,) from points with shading normals (3, n), by three draws (n,) each."""
        samples = LightSample.empty(light.size)
        chosen = self._group[light]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            for number, group in enumerate(self._groups):
                lanes = np.flatnonzero(chosen == number)
                if lanes.size:
                    vectors = (vector.take(lanes, axis=1) for vector in (point, normal))
                    draws = (draw[lanes] for draw in (u0, u1, uc))
                    samples.put(lanes, group.sample(self._member[light[lanes]], *vectors, *draws))
        return samples

    def pdf(self, surface: Surface, origin: Array, direction: Array, distance: Array) -> Array:
        """(n,) per solid angle, with which its light's sample would have found each emitting surface from `origin`; 0
        where the surface is in no list. The choice of the light is not included."""
        pdf = np.zeros(distance.size)
        light = self._light[surface.rank]
        cosine = dot(direction, surface.geometric)
        is_ball = self._is_ball[surface.rank]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            for lanes in (np.flatnonzero((light >= 0) & is_ball), np.flatnonzero((light >= 0) & ~is_ball)):
                if not lanes.size:
                    continue
                member, far, cos = self._member[light[lanes]], distance[lanes], cosine[lanes]
                if is_ball[lanes[0]]:
                    pdf[lanes] = self._balls.pdf(member, origin.take(lanes, axis=1), far, cos)
                else:
                    pdf[lanes] = self._faces.pdf(member, far, cos)
        return pdf


class _Sky:
    """An environment as a light among others."""

    delta = False

    def __init__(self, sky: Environment) -> None:
        self._sky = sky

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        wi, pdf = self._sky.sample(normal, u0, u1)
        arriving = np.where(pdf > 0.0, self._sky.radiance(wi) / pdf, 0.0)
        return LightSample(wi, np.full(light.size, np.inf), arriving, pdf)


def _emitting(geometry: Geometry, materials: Materials, first: int) -> tuple[Indices, Indices]:
    """Ranks of the primitives that are sampled as lights, and the place of each one's light in the list."""
    emits = (materials.emission > 0.0).any(axis=0)
    rank = np.flatnonzero(emits[geometry.material] & (geometry.kind != PLANE) & (geometry.index >= 0))
    shape = geometry.shape[rank]
    starts = (geometry.kind[rank] == SPHERE) | (shape != np.concatenate([[-1], shape[:-1]]))
    return rank, first + np.cumsum(starts) - 1
