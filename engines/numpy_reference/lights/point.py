"""Point lights: the same intensity in all directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.lights.interface import LightSample, LightSet
from engines.numpy_reference.vectors import Array, Indices, columns, dot, norm
from engines.scene import PointLight


class PointLights(LightSet):
    """All point lights of a scene."""

    def __init__(self, lights: Sequence[PointLight]) -> None:
        self._position, self._intensity = columns(lights, "position"), columns(lights, "intensity")
        self._falloff = np.array([light.falloff for light in lights])

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """Intensity over the square of the distance, unless the light has no falloff."""
        to_light = self._position.take(light, axis=1) - point
        distance = norm(to_light)
        square = np.where(self._falloff[light], dot(to_light, to_light), 1.0)
        irradiance = self._intensity.take(light, axis=1) / square
        return LightSample(to_light / distance, distance, irradiance, np.full(light.size, np.inf))


LIGHTS = {PointLight: PointLights}
