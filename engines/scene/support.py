"""What engines ask of a scene: the plugins that users have written, its camera, lights and BSDFs; and whether it is one."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from engines.scene.bsdf_tree import leaves, members, own_values
from engines.scene.cameras import CustomCamera
from engines.scene.lights import CustomLight
from engines.scene.media import SIDES
from engines.scene.models import CustomBSDF
from engines.scene.scene import Scene, attributes_lack
from engines.scene.shapes import Instance, emitting, groups_of, singles


def refusal_of(scene: Scene) -> str | None:
    """Why a scene cannot be rendered from what is here: there is nothing but a file of Mitsuba's, in the importer's words, a
    mesh lacks an attribute, or a group emits; else None."""
    refusal = None if scene.native is None else scene.native.refusal
    return refusal or attributes_lack(scene.materials, scene.shapes) or _groups_emit(scene)


def _groups_emit(scene: Scene) -> str | None:
    for group in groups_of(scene.shapes):
        if name := next(filter(None, (emitting(shape, scene.materials) for shape in group.shapes)), None):
            return f"group {group.name!r}: material {name!r} emits: groups hold no lights"
    return None


KINDS = ("camera", "shape", "light", "medium", "BSDF", "texture")
"""Kinds of the parts of a scene."""
MEDIA = {"camera": ("medium",), "shape": SIDES}
"""Fields that are places in `Scene.media`, by kind."""


def foreign(scene: Scene, known: Collection[type], who: str, kinds: Collection[str] = KINDS) -> str | None:
    """One sentence on the first part of a scene whose type is not among `known`, those that `who` translates, or that is in a
    medium which the scene does not have; or None.

    Whatever translates scenes asks this first: what it does not know is refused, and never guessed.
    """
    for where, kind, part in _parts(scene):
        if kind in kinds and type(part) not in known:
            plugin = getattr(part, "plugin", None)
            name = type(part).__name__ if plugin is None else f"plugin {_name_of(plugin)!r}"
            return f"{where}{who} does not support the {kind} {name}"
        for field in MEDIA.get(kind, ()):
            place = getattr(part, field, None)
            if place is not None and place not in range(len(scene.media)):
                return f"{where}{kind}.{field} = {place!r}: must be a place among the {len(scene.media)} media of the scene"
    return None


def _parts(scene: Scene) -> Iterator[tuple[str, str, Any]]:
    """Where each part of a scene stands, its kind, and the part."""
    yield "", "camera", scene.camera
    for index, shape in enumerate(scene.shapes):
        if isinstance(shape, Instance):
            yield f"shapes[{index}]: ", "shape", shape
    for where, shape in singles(scene.shapes):
        yield f"{where}: ", "shape", shape
    for index, light in enumerate(scene.lights):
        yield f"lights[{index}]: ", "light", light
    for medium in scene.media:
        yield f"medium {medium.name!r}: ", "medium", medium
    for material in scene.materials:
        where = f"material {material.name!r}: "
        if not isinstance(material.emission, tuple):
            yield where, "texture", material.emission
        for part in members(material.as_bsdf):
            yield where, "BSDF", part
            plain = (int, float, str, np.generic, type(None))
            yield from ((where, "texture", value) for value in own_values(part) if not isinstance(value, plain))


def plugins(scene: Scene) -> list[tuple[str, Any]]:
    """What each plugin of the scene is ("camera", "light" or "BSDF"), and the plugin."""
    parts = [("camera", scene.camera), *(("light", light) for light in scene.lights)]
    parts += [("BSDF", bsdf) for material in scene.materials for bsdf in leaves(material.bsdf)]
    return [(what, part.plugin) for what, part in parts if isinstance(part, CustomCamera | CustomLight | CustomBSDF)]


def plugin_without(scene: Scene, half: str) -> str | None:
    """The first plugin of the scene that lacks its half for an engine (`jitted` or `numpy`), by kind and name."""
    lacking = ((what, plugin) for what, plugin in plugins(scene) if getattr(plugin, half, None) is None)
    return next((f"the {what} {_name_of(plugin)!r}" for what, plugin in lacking), None)


def _name_of(plugin: Any) -> str:
    return getattr(plugin, "name", type(plugin).__name__)


def option_numbers(options: Mapping[str, Any]) -> list[float]:
    """The values of a plugin's options in order, those of three numbers one after the other."""
    return [float(x) for value in options.values() for x in (value if isinstance(value, tuple | list) else (value,))]
