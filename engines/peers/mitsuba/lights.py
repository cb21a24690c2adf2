"""Lights in Mitsuba's terms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from engines.peers.mitsuba.nodes import Array, Node, Placing, rgb
from engines.scene import DirectionalLight, EnvironmentLight, Light, PointLight, SpotLight
from engines.scene.frames import facing


def light_node(light: Light, placing: Placing) -> Node:
    """A light of the scene's list, of a type in `LIGHTS`; images of skies go where `placing` says."""
    return LIGHTS[type(light)](light, placing)


def _point(light: PointLight, placing: Placing) -> Node:
    return {"type": "point", "position": list(light.position), "intensity": rgb(light.intensity)}


def _directional(light: DirectionalLight, placing: Placing) -> Node:
    return {"type": "directional", "direction": list(light.direction), "irradiance": rgb(light.irradiance)}


def _spot(light: SpotLight, placing: Placing) -> Node:
    return {
        "type": "spot",
        "to_world": facing(light.position, light.direction, 1.0),
        "intensity": rgb(light.intensity),
        "cutoff_angle": light.cutoff,
        "beam_width": light.beam_width,
    }


def _environment(light: EnvironmentLight, placing: Placing) -> Node:
    if light.image is None:
        return {"type": "constant", "radiance": rgb(light.radiance)}
    rotation = np.eye(4)
    rotation[:3, :3] = light.rotation
    image = light.image * np.array(light.radiance)
    image = image if light.rows == "poles" else _knots(image)
    return {"type": "envmap", **placing.image("sky", image), "to_world": rotation}


LIGHTS: dict[type, Callable[[Any, Placing], Node]] = {
    PointLight: _point,
    DirectionalLight: _directional,
    SpotLight: _spot,
    EnvironmentLight: _environment,
}


def _knots(image: Array) -> Array:
    """The image as Mitsuba interpolates it: its rows reach from pole to pole, cells are centred in equal bands.

    Bilinear interpolation over twice as many bands and one row gives the same function, knot for knot.
    """
    rows = np.clip(np.arange(2 * len(image) + 1) / 2.0 - 0.5, 0.0, len(image) - 1.0)
    low = np.floor(rows).astype(int)
    high, share = np.minimum(low + 1, len(image) - 1), (rows - low)[:, None, None]
    return image[low] * (1.0 - share) + image[high] * share
