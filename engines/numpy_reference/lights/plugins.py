"""Lights that users bring (`engines.plugin.Light`), by their NumPy functions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.lights.interface import LightSample, LightSet
from engines.numpy_reference.vectors import Array, Indices
from engines.scene import CustomLight


class PluginLights(LightSet):
    """All lights of plugins in a scene. They have no surface, so no scattered ray finds them, whatever density theirs
    is: they are sampled like lights without size."""

    def __init__(self, lights: Sequence[CustomLight]) -> None:
        self._lights = lights

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """What the plugins answer; where their pdf is 0 there is no sample."""
        found = LightSample.empty(light.size)
        for member in np.unique(light):
            lanes, own = np.flatnonzero(light == member), self._lights[member]
            here = point.take(lanes, axis=1), normal.take(lanes, axis=1)
            wi, distance, radiance, pdf = own.plugin.numpy(own.options, *here, u0[lanes], u1[lanes])
            there = np.asarray(pdf) > 0.0
            weight, pdf = np.where(there, radiance, 0.0), np.where(there, np.inf, 0.0)
            found.put(lanes, LightSample(wi, distance, weight, pdf))
        return found


LIGHTS = {CustomLight: PluginLights}
