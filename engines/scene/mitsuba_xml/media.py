"""Media: those of shapes and sensors. Homogeneous ones are read; others are refused where something is in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.media import SIDES, HomogeneousMedium
from engines.scene.mitsuba_xml.colors import INDEX, REFLECTANCE, color
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin, element_of, name_of
from engines.scene.mitsuba_xml.transforms import LARGEST_NUMBER
from engines.scene.triple import Triple, product, triple

MOST_AGAINST = 0.01
"""Share of the faces of a mesh with media that may wind the other way around their normals than the others."""
DEFAULT_SIGMA_T, DEFAULT_ALBEDO, DEFAULT_G = 1.0, 0.75, 0.8


def sides_of(importer: Importer, plugin: Plugin, exchanged: bool | NDArray[np.bool_]) -> dict[str, int]:
    """The media of a shape, by the fields of ours. `exchanged` says, of a mesh for each face (m,), whether Mitsuba's geometric
    normal is on our back: that of a mesh follows the winding after `to_world`, and `flip_normals`. Raises `SceneError`."""
    found: dict[str, int] = {}
    for made, child in importer.children(plugin, "medium"):
        plugin.take(child)
        side = name_of(child)
        if side not in SIDES:
            importer.notes.add("a medium of a shape is its interior or its exterior: others are not used", plugin.element)
        elif side in found:
            raise element_of(child).refuse(f"a second {side}: a shape may have one")
        else:
            found[side] = medium(importer, made)
    if not found or not np.any(exchanged):
        return found
    share = float(np.mean(exchanged))
    if MOST_AGAINST < share < 1.0 - MOST_AGAINST:
        raise plugin.refuse("the faces of a mesh with media must all wind the same way around their normals")
    if share < 1.0:
        least = round(min(share, 1.0 - share) * np.size(exchanged))
        said = f"{least} of {np.size(exchanged)} faces wind against the others: their media are on the sides of those"
        importer.notes.add(said, plugin.element)
    if share < 0.5:
        return found
    opposite: dict[str, str] = dict(zip(SIDES, reversed(SIDES), strict=True))
    return {opposite[side]: index for side, index in found.items()}


def medium_around(importer: Importer, plugin: Plugin) -> dict[str, int]:
    """The medium that a sensor is in, by the field of ours. Raises `SceneError`."""
    found: dict[str, int] = {}
    for made, child in importer.children(plugin, "medium"):
        plugin.take(child)
        if found:
            raise element_of(child).refuse("a second medium: a sensor may be in one")
        found["medium"] = medium(importer, made)
    return found


def medium(importer: Importer, plugin: Plugin) -> int:
    """The place of a medium among those of the scene. Raises `SceneError`."""
    key = (id(plugin), "medium")
    if key not in importer.built:
        if plugin.type != "homogeneous":  # of constant volumes, too, a heterogeneous one ends at their box
            raise plugin.refuse(
                "media that are not homogeneous are not supported: use homogeneous, with one sigma_t and albedo"
            )
        importer.media.append(_homogeneous(importer, plugin))
        importer.built[key] = len(importer.media) - 1
    return importer.built[key]


def _homogeneous(importer: Importer, plugin: Plugin) -> HomogeneousMedium:
    scale = plugin.number("scale", default=1.0, low=0.0)
    if plugin.has("material"):
        raise plugin.refuse_property("material", "presets of media are not supported: give sigma_t and albedo")
    pairs = ("sigma_s", "sigma_a"), ("sigma_t", "albedo")
    older = plugin.has(*pairs[0])
    if older and plugin.has(*pairs[1]):
        raise plugin.refuse("sigma_s and sigma_a, or sigma_t and albedo are expected, not some of both")
    one, other = pairs[not older]
    if plugin.element.source.old and not (plugin.has(one) and plugin.has(other)):
        raise plugin.refuse(f"both {one} and {other} are expected: what is missing is that of the preset Skin1 in Mitsuba 0.6")
    if older:
        sigma_s, sigma_a = (_coefficient(importer, plugin, name, 0.0) for name in pairs[0])
        sigma_t = triple(s + a for s, a in zip(sigma_s, sigma_a, strict=True))
        albedo = triple(s / t if t > 0.0 else 0.0 for s, t in zip(sigma_s, sigma_t, strict=True))
    else:
        sigma_t = _coefficient(importer, plugin, "sigma_t", DEFAULT_SIGMA_T)
        albedo = _coefficient(importer, plugin, "albedo", DEFAULT_ALBEDO, REFLECTANCE)
    if not plugin.boolean("has_spectral_extinction", default=True) and len(set(sigma_t)) > 1:
        raise plugin.refuse_property("has_spectral_extinction", "must be true where sigma_t is a colour")
    sigma_t = product(sigma_t, scale)
    if max(sigma_t) > LARGEST_NUMBER:
        raise plugin.refuse(f"the extinction, times scale, must be at most {LARGEST_NUMBER:g}")
    if not plugin.boolean("sample_emitters", default=True):
        importer.notes.add("sample_emitters of a medium: lights are always sampled", plugin.values["sample_emitters"])
    g = _asymmetry(importer, plugin)
    importer.finish(plugin)
    return HomogeneousMedium(plugin.label, sigma_t, albedo, g)


def _coefficient(importer: Importer, plugin: Plugin, name: str, default: float, role: str = INDEX) -> Triple:
    """A colour or a number, or the constant volume of one."""
    nested = importer.named(plugin, name)
    if nested is not None:
        if nested.type != "constvolume":
            raise nested.refuse("volumes that vary in space are not supported: give one colour, or leave the medium out")
        plugin, name, default = nested, "value", 1.0
    element = plugin.spectrum(name)
    if nested is not None:
        importer.finish(nested)
    return (default, default, default) if element is None else color(element, role)


def _asymmetry(importer: Importer, plugin: Plugin) -> float:
    """g of the phase function, which is isotropic where none is given."""
    phases: list[Any] = importer.taken(plugin, "phase")
    if not phases:
        return 0.0
    if len(phases) > 1:
        raise phases[1].refuse("a second phase function: a medium may have one")
    phase, g = phases[0], 0.0
    if phase.type == "hg":
        g = phase.number("g", default=DEFAULT_G)
        if not -1.0 < g < 1.0:
            raise phase.refuse_property("g", "must lie between -1 and 1, without these")
    elif phase.type != "isotropic":
        raise phase.refuse("phase functions of media may be isotropic or hg: others are not supported")
    importer.finish(phase)
    return g
