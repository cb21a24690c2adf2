"""Spot lights: point lights that shine into a cone, dimmer towards its edge, and may show a texture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.lights.frames import Frames
from engines.numpy_reference.lights.interface import LightSample, LightSet
from engines.numpy_reference.vectors import Array, Indices, columns, cross, dot, norm
from engines.scene import SpotLight


class SpotLights(LightSet):
    """All spot lights of a scene."""

    def __init__(self, lights: Sequence[SpotLight]) -> None:
        self._position, self._direction = columns(lights, "position"), columns(lights, "direction")
        self._intensity = columns(lights, "intensity")
        self._cutoff = np.radians([light.cutoff for light in lights])
        self._beam_width = np.radians([light.beam_width for light in lights])
        self._frames = Frames(lights)

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """Intensity over the square of the distance, times `_falloff` at the angle from the axis and the texture."""
        to_light = self._position.take(light, axis=1) - point
        distance = norm(to_light)
        wi = to_light / distance
        axis = self._direction.take(light, axis=1)
        angle = np.arctan2(norm(cross(axis, wi)), -dot(axis, wi))  # keeps its digits near the axis, as arccos does not
        strength = self._falloff(light, angle) / dot(to_light, to_light)
        intensity = self._intensity.take(light, axis=1) * self._frames(light, -wi)
        return LightSample(wi, distance, intensity * strength, np.full(light.size, np.inf))

    def _falloff(self, light: Indices, angle: Array) -> Array:
        """(n,) 1 within the beam, falling linearly in the angle to 0 at the cutoff."""
        cutoff, beam_width = self._cutoff[light], self._beam_width[light]
        with np.errstate(divide="ignore", invalid="ignore"):
            linear = np.minimum((cutoff - angle) / (cutoff - beam_width), 1.0)
        return np.where(angle < cutoff, linear, 0.0)


LIGHTS = {SpotLight: SpotLights}
