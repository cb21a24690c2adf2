"""Lights in Mitsuba's terms."""

from __future__ import annotations

import numpy as np

from engines.mitsuba.nodes import Array, Node, Placing, facing, rgb
from engines.scene import CustomLight, DirectionalLight, EnvironmentLight, Light, PointLight, Scene, SpotLight


def lights_lack(scene: Scene) -> str | None:
    """One sentence on what of the scene's lights Mitsuba has no counterpart for, or None."""
    if sum(isinstance(light, EnvironmentLight) for light in scene.lights) > 1:
        return "the scene has several environments, of which Mitsuba renders one"
    if any(isinstance(light, CustomLight) for light in scene.lights):
        return "Mitsuba has no counterpart of light plugins"
    if any(isinstance(light, PointLight) and not light.falloff for light in scene.lights):
        return "Mitsuba's point lights fall off with the square of the distance"
    return None


def light_node(light: Light, placing: Placing) -> Node:
    if isinstance(light, PointLight):
        return {"type": "point", "position": list(light.position), "intensity": rgb(light.intensity)}
    if isinstance(light, DirectionalLight):
        return {"type": "directional", "direction": list(light.direction), "irradiance": rgb(light.irradiance)}
    if isinstance(light, SpotLight):
        return {
            "type": "spot", "to_world": facing(light.position, light.direction, 1.0), "intensity": rgb(light.intensity),
            "cutoff_angle": light.cutoff, "beam_width": light.beam_width,
        }  # fmt: skip
    assert isinstance(light, EnvironmentLight)
    if light.image is None:
        return {"type": "constant", "radiance": rgb(light.radiance)}
    rotation = np.eye(4)
    rotation[:3, :3] = light.rotation
    image = light.image * np.array(light.radiance)
    image = image if light.rows == "poles" else _knots(image)
    return {"type": "envmap", **placing.image("sky", image), "to_world": rotation}


def _knots(image: Array) -> Array:
    """The image as Mitsuba interpolates it: its rows reach from pole to pole, cells are centred in equal bands.

    Bilinear interpolation over twice as many bands and one row gives the same function, knot for knot.
    """
    rows = np.clip(np.arange(2 * len(image) + 1) / 2.0 - 0.5, 0.0, len(image) - 1.0)
    low = np.floor(rows).astype(int)
    high, share = np.minimum(low + 1, len(image) - 1), (rows - low)[:, None, None]
    return image[low] * (1.0 - share) + image[high] * share
