"""What engines ask of a scene: the plugins that users have written, its camera, lights and BSDFs; and whether it is one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from engines.scene.bsdf import (
    Blend,
    Bsdf,
    Bump,
    CustomBSDF,
    Mask,
    Mixture,
    NormalMap,
    Null,
    Sides,
    ThinDielectric,
    is_opaque,
)
from engines.scene.cameras import CustomCamera
from engines.scene.lights import CustomLight
from engines.scene.materials import Material
from engines.scene.scene import Scene


def refusal_of(scene: Scene) -> str | None:
    """Why there is nothing of a scene but a file of Mitsuba's, in the importer's words, or None."""
    return None if scene.native is None else scene.native.refusal


def plugins(scene: Scene) -> list[tuple[str, Any]]:
    """What each plugin of the scene is ("camera", "light" or "BSDF"), and the plugin."""
    parts = [("camera", scene.camera), *(("light", light) for light in scene.lights)]
    parts += [("BSDF", bsdf) for material in scene.materials for bsdf in leaves(material.bsdf)]
    return [(what, part.plugin) for what, part in parts if isinstance(part, CustomCamera | CustomLight | CustomBSDF)]


def model_of(material: Material) -> Bsdf:
    """The material's BSDF, that of kd, ks and kt included."""
    if material.bsdf is not None:
        return material.bsdf
    return Mixture(material.kd, material.ks, material.kt, material.ior, material.fresnel)


def members(bsdf: Bsdf) -> Iterator[Bsdf]:
    """A BSDF and all that it is made of, from the outside in; sides without one are left out."""
    yield bsdf
    inner = (getattr(bsdf, name, None) for name in ("of", "a", "b", "front", "back"))
    for part in inner if isinstance(bsdf, Mask | Blend | Bump | NormalMap | Sides) else ():
        if part is not None:
            yield from members(part)


def has_null_lobes(material: Material) -> bool:
    """Whether rays may pass the material as if it were not there: by null, a mask or a thin dielectric (docs/transport.md)."""
    return any(isinstance(part, Mask | Null | ThinDielectric) for part in members(model_of(material)))


def tilts_null_lobes(material: Material) -> bool:
    """Whether a bump or normal map is around what lets rays pass so."""
    tilts = (part.of for part in members(model_of(material)) if isinstance(part, Bump | NormalMap))
    return any(isinstance(part, Mask | Null | ThinDielectric) for tilted in tilts for part in members(tilted))


def transmits(bsdf: Bsdf) -> bool:
    """Whether a model to which wrappers lead lets light through, whatever its textures say; masks are no models."""
    return any(leaf is not None and _transmits(leaf) for leaf in leaves(bsdf))


def _transmits(leaf: Bsdf) -> bool:
    if isinstance(leaf, CustomBSDF):
        return any(getattr(leaf.plugin, name, False) for name in ("transmission", "specular_transmission"))
    return not is_opaque(leaf)


def leaves(bsdf: Bsdf | None) -> list[Bsdf | None]:
    """Where wrappers lead, each BSDF once: a BSDF that is no wrapper leads to itself, a side without one to None."""
    found: dict[int, Bsdf | None] = {}
    waiting, seen = [bsdf], set[int]()
    while waiting:
        bsdf = waiting.pop()
        if id(bsdf) in seen:
            continue
        seen.add(id(bsdf))
        match bsdf:
            case Sides(front, back):
                waiting += [back, front]
            case Blend(_, a, b):
                waiting += [b, a]
            case Mask(of=of) | Bump(of=of) | NormalMap(of=of):
                waiting.append(of)
            case _:
                found[id(bsdf)] = bsdf
    return list(found.values())


def plugin_without(scene: Scene, half: str) -> str | None:
    """The first plugin of the scene that lacks its half for an engine (`jitted` or `numpy`), by kind and name."""
    lacking = ((what, plugin) for what, plugin in plugins(scene) if getattr(plugin, half, None) is None)
    return next((f"the {what} {getattr(plugin, 'name', type(plugin).__name__)!r}" for what, plugin in lacking), None)


def option_numbers(options: Mapping[str, Any]) -> list[float]:
    """The values of a plugin's options in order, those of three numbers one after the other."""
    return [float(x) for value in options.values() for x in (value if isinstance(value, tuple | list) else (value,))]
