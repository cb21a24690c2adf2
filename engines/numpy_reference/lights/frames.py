"""Frames of spot lights and projectors: what their textures show in a direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.textures import color
from engines.numpy_reference.vectors import Array, Indices, cross, dot, unit
from engines.scene import ProjectorLight, SpotLight


class Frame:
    """The frame of a light that has a texture: a plane across the axis at a distance of 1."""

    def __init__(self, light: SpotLight | ProjectorLight) -> None:
        assert light.texture is not None
        self._texture = light.texture
        self._axis, up = np.array(light.direction)[:, None], np.array(light.up)[:, None]
        self._right = unit(cross(self._axis, up))
        self._up = cross(self._right, self._axis)
        self._half_width, self._half_height = light.half_extents

    def __call__(self, direction: Array) -> Array:
        """(3, n) what leaves in unit directions, 0 outside of the frame."""
        depth = dot(self._axis, direction)
        x = dot(self._right, direction) / depth / self._half_width
        y = dot(self._up, direction) / depth / self._half_height
        inside = (depth > 0.0) & (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0)
        uv = np.where(inside, np.stack([1.0 + x, 1.0 - y]) / 2.0, 0.0)
        return np.where(inside, np.maximum(color(self._texture, uv), 0.0), 0.0)


class Frames:
    """The frames of some lights; one without a texture is white everywhere."""

    def __init__(self, lights: Sequence[SpotLight | ProjectorLight]) -> None:
        self._frames = {place: Frame(light) for place, light in enumerate(lights) if light.texture is not None}

    def __call__(self, light: Indices, direction: Array) -> Array:
        """(3, n) what the frame of each light (n,) shows in a unit direction from it."""
        shown = np.ones((3, light.size))
        for place, frame in self._frames.items():
            lanes = np.flatnonzero(light == place)
            shown[:, lanes] = frame(direction.take(lanes, axis=1))
        return shown
