"""Projectors: point lights that project images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.lights.frames import Frames
from engines.numpy_reference.lights.interface import LightSample, LightSet
from engines.numpy_reference.vectors import Array, Indices, columns, dot, norm
from engines.scene import ProjectorLight


class ProjectorLights(LightSet):
    """All projectors of a scene."""

    def __init__(self, lights: Sequence[ProjectorLight]) -> None:
        self._position, self._direction = columns(lights, "position"), columns(lights, "direction")
        self._irradiance, self._frames = columns(lights, "irradiance"), Frames(lights)

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """The irradiance of the plane at a distance of 1, over the square of the distance along the axis, and not across the
        axis but across the direction."""
        to_light = self._position.take(light, axis=1) - point
        distance = norm(to_light)
        wi = to_light / distance
        axis = self._direction.take(light, axis=1)
        shown = self._irradiance.take(light, axis=1) * self._frames(light, -wi)
        strength = np.where(shown > 0.0, shown / (dot(to_light, axis) ** 2 * -dot(wi, axis)), 0.0)
        return LightSample(wi, distance, strength, np.full(light.size, np.inf))


LIGHTS = {ProjectorLight: ProjectorLights}
