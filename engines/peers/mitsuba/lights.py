"""Lights in Mitsuba's terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from engines.peers.mitsuba.nodes import Array, Node, Placing, rgb
from engines.peers.mitsuba.textures import Textures
from engines.scene import DirectionalLight, EnvironmentLight, ImageTexture, Light, PointLight, ProjectorLight, Scene, SpotLight
from engines.scene.frames import facing, look_at
from engines.scene.textures import UVTexture, tinted
from engines.scene.triple import product, triple


def light_node(light: Light, placing: Placing, textures: Textures) -> Node:
    """A light of the scene's list, of a type in `LIGHTS`; images of skies go where `placing` says."""
    return LIGHTS[type(light)](light, placing, textures)


def _point(light: PointLight, placing: Placing, textures: Textures) -> Node:
    return {"type": "point", "position": list(light.position), "intensity": rgb(light.intensity)}


def _directional(light: DirectionalLight, placing: Placing, textures: Textures) -> Node:
    return {"type": "directional", "direction": list(light.direction), "irradiance": rgb(light.irradiance)}


def _spot(light: SpotLight, placing: Placing, textures: Textures) -> Node:
    """Textures are upside down there."""
    to_world, intensity, shown = facing(light.position, light.direction, 1.0), light.intensity, {}
    if light.texture is not None:
        texture, factor = _at_most_one(light.texture)
        to_world, intensity = _framed(light, np.negative(light.up)), product(light.intensity, factor)
        shown = {"texture": textures.color(texture)}
    cone = {"intensity": rgb(intensity), "cutoff_angle": light.cutoff, "beam_width": light.beam_width}
    return {"type": "spot", "to_world": to_world, **cone, **shown}


def _projector(light: ProjectorLight, placing: Placing, textures: Textures) -> Node:
    """Its scale is a number, and lacks a factor of pi; a coloured irradiance tints the image."""
    texture, factor = _at_most_one(light.texture)
    scale = max(light.irradiance)
    if min(light.irradiance) < scale:
        texture = tinted(texture, triple(np.divide(light.irradiance, scale)))
    return {
        "type": "projector",
        "to_world": _framed(light, light.up),
        "irradiance": textures.color(texture),
        "scale": scale * factor / np.pi,
        "fov": light.fov,
        "fov_axis": light.fov_axis,
    }


def _at_most_one(texture: UVTexture) -> tuple[UVTexture, float]:
    """The texture and its factor: in Mitsuba, no colour of a checkerboard is above 1."""
    if isinstance(texture, ImageTexture):
        return texture, 1.0
    peak = max(1.0, *texture.a, *texture.b)
    return replace(texture, a=product(texture.a, 1.0 / peak), b=product(texture.b, 1.0 / peak)), peak


def _framed(light: SpotLight | ProjectorLight, up: Any) -> Array:
    """(4, 4) light to world."""
    matrix = look_at((0.0, 0.0, 0.0), light.direction, up)
    matrix[:3, 3] = light.position
    return matrix


def lights_lack(scene: Scene) -> str | None:
    """One sentence on the first image of a light that Mitsuba would show in another way, or None."""
    for light in scene.lights:
        image = light.texture if isinstance(light, SpotLight | ProjectorLight) else None
        if not isinstance(image, ImageTexture):
            continue
        if image.pixels.min() < 0.0:
            return "Mitsuba's lights show no images with negative texels"
        height, width = image.pixels.shape[:2]
        if isinstance(light, ProjectorLight) and height != width and 1 in (height, width):
            return "Mitsuba projects no images of a single row or column"
    return None


def _environment(light: EnvironmentLight, placing: Placing, textures: Textures) -> Node:
    if light.image is None:
        return {"type": "constant", "radiance": rgb(light.radiance)}
    rotation = np.eye(4)
    rotation[:3, :3] = light.rotation
    image = light.image * np.array(light.radiance)
    image = image if light.rows == "poles" else _knots(image)
    return {"type": "envmap", **placing.image("sky", image), "to_world": rotation}


LIGHTS: dict[type, Callable[[Any, Placing, Textures], Node]] = {
    PointLight: _point,
    DirectionalLight: _directional,
    SpotLight: _spot,
    ProjectorLight: _projector,
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
