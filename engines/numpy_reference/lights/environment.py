"""Environments: one radiance from all directions at infinity, or an image around the scene (`image_environment`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.lights.image_environment import ImageEnvironment
from engines.numpy_reference.lights.interface import LightSample
from engines.numpy_reference.vectors import Array, Indices, cosine_hemisphere, dot, uniform_sphere
from engines.scene import EnvironmentLight


class EnvironmentLights:
    """All environments of a scene."""

    delta = False
    infinite = True

    def __init__(self, lights: Sequence[EnvironmentLight]) -> None:
        self._lights = [ConstantEnvironment(light) if light.image is None else ImageEnvironment(light) for light in lights]

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        found = LightSample.empty(light.size)
        for number, environment in enumerate(self._lights):
            lanes = np.flatnonzero(light == number)
            if lanes.size:
                wi, pdf = environment.sample(normal.take(lanes, axis=1), u0[lanes], u1[lanes])
                weight = np.where(pdf > 0.0, environment.Li(wi) / pdf, 0.0)
                found.put(lanes, LightSample(wi, np.full(lanes.size, np.inf), weight, pdf))
        return found

    def Li(self, light: int, direction: Array) -> Array:
        return self._lights[light].Li(direction)

    def pdf(self, light: int, direction: Array, normal: Array) -> Array:
        return self._lights[light].pdf(direction, normal)


LIGHTS = {EnvironmentLight: EnvironmentLights}


class ConstantEnvironment:
    """The same `radiance` (3,) from everywhere; sampled by the cosine around the normal of the surface, uniformly where there
    is none (0)."""

    def __init__(self, light: EnvironmentLight) -> None:
        self._radiance = np.array(light.radiance)[:, None]

    def Li(self, direction: Array) -> Array:
        """(3, n) from unit directions."""
        return np.repeat(self._radiance, direction.shape[1], axis=1)

    def pdf(self, direction: Array, normal: Array) -> Array:
        """(n,) per solid angle, of sampling the directions at points with these normals."""
        on_surface = normal.any(axis=0)
        return np.where(on_surface, np.maximum(dot(normal, direction), 0.0) / np.pi, 0.25 / np.pi)

    def sample(self, normal: Array, u0: Array, u1: Array) -> tuple[Array, Array]:
        """Unit directions (3, n) and their pdf per solid angle (n,)."""
        wi = np.where(normal.any(axis=0), cosine_hemisphere(normal, u0, u1), uniform_sphere(u0, u1))
        return wi, self.pdf(wi, normal)
