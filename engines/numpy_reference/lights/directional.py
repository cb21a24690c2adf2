"""Directional lights: parallel rays, as from the sun."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.lights.interface import LightSample, LightSet
from engines.numpy_reference.vectors import Array, Indices, columns
from engines.scene import DirectionalLight


class DirectionalLights(LightSet):
    """All directional lights of a scene."""

    def __init__(self, lights: Sequence[DirectionalLight]) -> None:
        self._towards, self._irradiance = -columns(lights, "direction"), columns(lights, "irradiance")

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """The same from every point."""
        endless = np.full(light.size, np.inf)
        return LightSample(self._towards.take(light, axis=1), endless, self._irradiance.take(light, axis=1), endless)


LIGHTS = {DirectionalLight: DirectionalLights}
