"""Emitters other than those of shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi

import numpy as np

from engines.scene.frames import mirrored, nearest_orthogonal
from engines.scene.geometry import read_only
from engines.scene.lights import (
    DirectionalLight,
    EnvironmentLight,
    Light,
    PointLight,
    ProjectorLight,
    SpotLight,
    without_negative,
)
from engines.scene.mitsuba_xml.colors import EMISSION, color
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.sensors import Film, field_of_view
from engines.scene.mitsuba_xml.sky import baked
from engines.scene.mitsuba_xml.textures import color_or_texture, texture
from engines.scene.mitsuba_xml.transforms import similarity
from engines.scene.textures import Checkerboard, Color, MeshAttribute, Texture, UVTexture, sides
from engines.scene.triple import WHITE, Triple, product, triple
from engines.schema.fields import unit

HARMLESS = ("sampling_weight", "mis_compensation", "cache")


def light(importer: Importer, plugin: Plugin) -> Light:
    """The light of an emitter of the scene. Raises `SceneError`."""
    make = EMITTERS.get(plugin.type)
    if make is None:
        raise plugin.refuse(REFUSED.get(plugin.type, f"unknown emitter: known: {', '.join((*EMITTERS, 'area'))}"))
    plugin.read.update(HARMLESS)
    made = make(importer, plugin)
    importer.finish(plugin)
    return made


def area_radiance(importer: Importer, plugin: Plugin) -> Color:
    """The radiance of an `area` emitter within a shape, or the texture that holds it. Raises `SceneError`."""
    if plugin.type != "area":
        raise plugin.refuse(REFUSED.get(plugin.type, "an emitter of type area is expected within a shape"))
    plugin.read.update(HARMLESS)
    radiance = color_or_texture(importer, plugin, "radiance", default=WHITE, role=EMISSION)
    importer.finish(plugin)
    return radiance


def _light_color(importer: Importer, plugin: Plugin, name: str) -> Triple:
    nested = importer.named(plugin, name)
    if nested is not None:
        radiance = texture(importer, nested, EMISSION)
        if not isinstance(radiance, tuple):
            raise nested.refuse(f"{name} as a texture is not supported: a colour is expected")
        return radiance
    element = plugin.spectrum(name)
    return WHITE if element is None else color(element, EMISSION)


def _direction(plugin: Plugin, vector: Triple) -> Triple:
    direction = unit(vector)
    if direction is None:
        raise plugin.refuse("the direction must not be zero")
    return direction


def _point(importer: Importer, plugin: Plugin) -> PointLight:
    position = plugin.point("position")
    if position is None:
        position = triple(plugin.transform()[:3, 3])
    elif plugin.has("to_world"):
        raise plugin.refuse("either position or to_world")
    return PointLight(position, _light_color(importer, plugin, "intensity"))


def _spot(importer: Importer, plugin: Plugin) -> SpotLight:
    matrix = plugin.transform()
    cutoff = plugin.number("cutoff_angle", default=20.0)
    if not 0.0 < cutoff < 180.0:
        raise plugin.refuse_property("cutoff_angle", "must lie in (0, 180) degrees")
    beam_width = plugin.positive("beam_width", default=0.75 * cutoff)
    if beam_width > cutoff:
        raise plugin.refuse_property("beam_width", f"must not exceed cutoff_angle, which is {cutoff:g}")
    direction = _direction(plugin, triple(matrix[:3, 2]))
    made = SpotLight(triple(matrix[:3, 3]), direction, _light_color(importer, plugin, "intensity"), cutoff, beam_width)
    nested = importer.named(plugin, "texture")
    if nested is None:
        return made
    if cutoff >= 90.0:
        raise plugin.refuse_property("cutoff_angle", "must be below 90 degrees with a texture")
    _scale(plugin)
    up = _direction(plugin, triple(-matrix[:3, 1]))  # the texture of a spot light is upside down in Mitsuba
    return replace(made, texture=_shown(nested, texture(importer, nested), mirrored(matrix)), up=up)


def _projector(importer: Importer, plugin: Plugin) -> ProjectorLight:
    """Mitsuba's irradiance lacks a factor of pi; `to_world` scales the light."""
    matrix, factor = plugin.transform(), pi * _scale(plugin) * plugin.number("scale", default=1.0, low=0.0)
    irradiance = color_or_texture(importer, plugin, "irradiance", default=WHITE, role=EMISSION)
    if isinstance(irradiance, tuple):
        irradiance = Checkerboard(irradiance, irradiance)
    shown = _shown(plugin, irradiance, mirrored(matrix))
    height, width = sides(shown)
    if 1 in (height, width) and height != width:
        raise plugin.refuse("an image of a single row or column is not supported: Mitsuba doubles it")
    fov, axis = field_of_view(plugin, Film(width, height, crop_width=width, crop_height=height))
    direction, up = (_direction(plugin, triple(matrix[:3, column])) for column in (2, 1))
    return ProjectorLight(triple(matrix[:3, 3]), direction, up, product(WHITE, factor), shown, fov, axis)


def _scale(plugin: Plugin) -> float:
    """The scale of the `to_world` of a light with a texture. Raises `SceneError` where it stretches."""
    scale = similarity(plugin.transform()[:3, :3])
    if scale is None:
        raise plugin.refuse("to_world of a light with a texture must not stretch or shear")
    return scale


def _shown(plugin: Plugin, made: Texture | Triple, mirror: bool) -> UVTexture:
    """The texture of a light, left and right exchanged if its `to_world` mirrors."""
    if isinstance(made, tuple | MeshAttribute):
        raise plugin.refuse("an image or a checkerboard is expected here")
    a, b, c, d, e, f = made.to_uv
    return replace(made, to_uv=(-a, b, c + a, -d, e, f + d)) if mirror else made


def _directional(importer: Importer, plugin: Plugin) -> DirectionalLight:
    vector = plugin.point("direction")
    if vector is None:
        vector = triple(plugin.transform()[:3, 2])
    elif plugin.has("to_world"):
        raise plugin.refuse("either direction or to_world")
    return DirectionalLight(_direction(plugin, vector), _light_color(importer, plugin, "irradiance"))


def _constant(importer: Importer, plugin: Plugin) -> EnvironmentLight:
    plugin.read.add("to_world")
    return EnvironmentLight(_light_color(importer, plugin, "radiance"))


def rotation(plugin: Plugin) -> tuple[Triple, Triple, Triple]:
    """The rows of the rotation or reflection of `to_world`. Raises `SceneError` for other transforms."""
    linear = plugin.transform()[:3, :3]
    if similarity(linear) is None:
        raise plugin.refuse("to_world of an environment must be a rotation")
    a, b, c = map(triple, nearest_orthogonal(linear))
    return a, b, c


def _envmap(importer: Importer, plugin: Plugin) -> EnvironmentLight:
    named = plugin.file("filename")
    images = importer.reader.images
    file = images.file(named.located(named.attributes["value"]), importer.place)
    image = images.linear(file, images.texels[file].dtype.kind == "u", "").astype(np.float64)
    image = np.broadcast_to(image, (*image.shape[:2], 3))
    image, negative = without_negative(image)
    if negative:
        importer.notes.add(negative, named)
    scale = plugin.number("scale", default=1.0, low=0.0)
    return EnvironmentLight((scale, scale, scale), image, rotation(plugin), "poles")


def _sky(importer: Importer, plugin: Plugin) -> EnvironmentLight:
    return EnvironmentLight(WHITE, read_only(baked(importer, plugin).astype(np.float64)), rows="poles")


EMITTERS: dict[str, Callable[[Importer, Plugin], Light]] = {
    "point": _point,
    "spot": _spot,
    "projector": _projector,
    "directional": _directional,
    "constant": _constant,
    "envmap": _envmap,
    "sunsky": _sky,
    "sky": _sky,
    "sun": _sky,
}
REFUSED = {
    "directionalarea": "light of a surface in one direction is not supported: use directional, or area",
    "collimated": "a single ray of light is not supported: use a narrow spot",
    "volumelight": "volumes that emit are not supported: use area",
    "timed_sunsky": "a sky that moves is not supported: use sunsky",
}
