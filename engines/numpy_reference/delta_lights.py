"""Lights that have no size: no scattered ray can find them, so they are always sampled and never weighted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.light_sample import LightSample
from engines.numpy_reference.vectors import Array, Indices, dot, norm
from engines.scene.model import DirectionalLight, PointLight


class PointLights:
    """All point lights of a scene."""

    delta = True

    def __init__(self, lights: Sequence[PointLight]) -> None:
        self._position = np.array([light.position for light in lights]).T.copy()
        self._intensity = np.array([light.intensity for light in lights]).T.copy()
        self._falloff = np.array([light.falloff for light in lights])

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """Intensity over the square of the distance, unless the light has no falloff."""
        to_light = self._position.take(light, axis=1) - point
        distance = norm(to_light)
        square = np.where(self._falloff[light], dot(to_light, to_light), 1.0)
        arriving = self._intensity.take(light, axis=1) / square
        return LightSample(to_light / distance, distance, arriving, np.full(light.size, np.inf))


class DirectionalLights:
    """All directional lights of a scene."""

    delta = True

    def __init__(self, lights: Sequence[DirectionalLight]) -> None:
        self._towards = -np.array([light.direction for light in lights]).T.copy()
        self._irradiance = np.array([light.irradiance for light in lights]).T.copy()

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """The same from every point."""
        endless = np.full(light.size, np.inf)
        return LightSample(self._towards.take(light, axis=1), endless, self._irradiance.take(light, axis=1), endless)
