"""Lights of a scene file. Area lights are not among them: they are shapes whose material emits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from engines.errors import SceneError, suggestion
from engines.scene import fields
from engines.scene.files import Place
from engines.scene.model import DirectionalLight, EnvironmentLight, Light, PointLight, SpotLight
from engines.scene.yaml_file import Located


def read_light(node: Located, place: Place) -> Light:
    """The light of a mapping with one key, its kind."""
    if not isinstance(node.value, dict) or len(node.value) != 1:
        raise node.refuse(f"must be a mapping with one key, the kind of light: {', '.join(_KINDS)}")
    kind, body = next(iter(node.value.items()))
    if kind not in _KINDS:
        raise node.refuse_key(kind, f"unknown light: {suggestion(kind, _KINDS)}")
    return _KINDS[kind](body, place)


def _point(node: Located, place: Place) -> PointLight:
    given = fields.mapping(node, ("position", "intensity", "falloff"), ("position", "intensity"))
    falloff = "falloff" not in given or fields.one_of(given["falloff"], ("inverse_square", "none"), "falloff") != "none"
    return PointLight(fields.triple(given["position"]), fields.color(given["intensity"]), falloff)


def _directional(node: Located, place: Place) -> DirectionalLight:
    given = fields.mapping(node, ("direction", "irradiance"), ("direction", "irradiance"))
    return DirectionalLight(fields.direction(given["direction"]), fields.color(given["irradiance"]))


def _spot(node: Located, place: Place) -> SpotLight:
    known = ("position", "target", "direction", "intensity", "cutoff", "beam_width")
    given = fields.mapping(node, known, ("position", "intensity"))
    if ("target" in given) == ("direction" in given):
        raise node.refuse("needs target or direction, one of them")
    position = fields.triple(given["position"])
    if "direction" in given:
        direction = fields.direction(given["direction"])
    else:
        direction = fields.towards(given["target"], position, "position")
    cutoff = fields.angle(given["cutoff"]) if "cutoff" in given else 20.0
    beam_width = 0.75 * cutoff
    if "beam_width" in given:
        beam_width = fields.angle(given["beam_width"])
        if beam_width > cutoff:
            raise given["beam_width"].refuse(f"must not exceed cutoff, which is {cutoff:g}")
    return SpotLight(position, direction, fields.color(given["intensity"]), cutoff, beam_width)


def _environment(node: Located, place: Place) -> EnvironmentLight:
    given = fields.mapping(node, ("radiance", "image"))
    if not given:
        raise node.refuse("needs radiance, image, or both")
    radiance = fields.color(given["radiance"]) if "radiance" in given else (1.0, 1.0, 1.0)
    image = _image(given["image"], place) if "image" in given else None
    return EnvironmentLight(radiance, image)


def _image(node: Located, place: Place) -> Any:
    from engines.image import read_image

    file = place.find(node, fields.text(node))
    try:
        image = read_image(file)
    except SceneError as problem:
        raise SceneError(f"{node.where}: {problem}") from problem
    if not (image >= 0.0).all() or image.max() == float("inf"):
        raise node.refuse("holds radiance that is negative, infinite or not a number")
    image.flags.writeable = False
    return image


_KINDS: dict[str, Callable[[Located, Place], Light]] = {
    "point": _point, "spot": _spot, "directional": _directional, "environment": _environment,
}  # fmt: skip
