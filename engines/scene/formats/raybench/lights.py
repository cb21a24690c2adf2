"""Lights of a scene file, each one entry of `LIGHTS`. Area lights are not among them: they are shapes whose material emits."""

from __future__ import annotations

from typing import Any

from engines.errors import SceneError
from engines.scene.formats.raybench.context import SceneReader
from engines.scene.formats.raybench.plugins import PluginKind
from engines.scene.model import CustomLight, DirectionalLight, EnvironmentLight, PointLight, SpotLight
from engines.schema import fields
from engines.schema.keys import Given, Key, Record, Variants
from engines.schema.kinds import ANGLE, DIRECTION, POINT, TEXT, color, one_of


def _point(given: Given, context: SceneReader) -> PointLight:
    return PointLight(given["position"], given["intensity"], given["falloff"] != "none")


def _spot(given: Given, context: SceneReader) -> SpotLight:
    position, cutoff, beam_width = given["position"], given["cutoff"], given["beam_width"]
    direction = given["direction"] or fields.towards(given.at("target"), position, "position")
    if beam_width is None:
        beam_width = 0.75 * cutoff
    elif beam_width > cutoff:
        raise given.at("beam_width").refuse(f"must not exceed cutoff, which is {cutoff:g}")
    return SpotLight(position, direction, given["intensity"], cutoff, beam_width)


def _environment(given: Given, context: SceneReader) -> EnvironmentLight:
    if not given.node.value:
        raise given.node.refuse("needs radiance, image, or both")
    return EnvironmentLight(given["radiance"], _image(given, context) if given.has("image") else None)


def _image(given: Given, context: SceneReader) -> Any:
    from engines.image import read_image

    node = given.at("image")
    file = context.place.find(node, given["image"])
    try:
        image = read_image(file)
    except SceneError as problem:
        raise SceneError(f"{node.where}: {problem}") from problem
    if not (image >= 0.0).all() or image.max() == float("inf"):
        raise node.refuse("holds radiance that is negative, infinite or not a number")
    image.flags.writeable = False
    return image


_FALLOFF = one_of(("inverse_square", "none"), "falloff")
_POSITION = Key(POINT, "Position of the light.", unit="metres")
LIGHTS = Variants("light", {
    "point": Record("A point light that is equal in all directions.", {
        "position": _POSITION,
        "intensity": Key(color(), "Radiant intensity.", unit="W/sr"),
        "falloff": Key(_FALLOFF, "Dependence on distance; with none it is everywhere that at 1 m.", "inverse_square"),
    }, _point),
    "spot": Record("A point light that is limited to a cone about an axis.", {
        "position": _POSITION,
        "target": Key(POINT, "A point on the axis.", None, unit="metres"),
        "direction": Key(DIRECTION, "Direction of the axis, of any length.", None),
        "intensity": Key(color(), "Radiant intensity within beam_width of the axis.", unit="W/sr"),
        "cutoff": Key(ANGLE, "Angle from the axis beyond which there is no light.", 20, unit="degrees"),
        "beam_width": Key(
            ANGLE, "Angle from the axis beyond which intensity falls linearly, to 0 at cutoff; by default 3/4 of that.",
            None, unit="degrees",
        ),
    }, _spot, either=(("target",), ("direction",))),
    "directional": Record("Parallel light from infinity, as from the sun.", {
        "direction": Key(DIRECTION, "Direction in which light travels, of any length."),
        "irradiance": Key(color(), "Irradiance of a surface that faces the light.", unit="W/m²"),
    }, lambda given, context: DirectionalLight(**given.values)),
    "environment": Record("Light from infinity, all around. At least one of the keys is required.", {
        "radiance": Key(color(), "Radiance from all directions; with an image, a factor.", 1, unit="W/(sr m²)"),
        "image": Key(TEXT, "File of a latitude-longitude image, +y up, .exr or 8-bit, relative to the scene's folder.", None),
    }, _environment),
    "plugin": PluginKind("light", "A light of one's own; loaded with --allow-imports alone.", CustomLight),
})  # fmt: skip
