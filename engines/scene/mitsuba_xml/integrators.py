"""Integrators: the shader that a file suggests."""

from __future__ import annotations

from typing import Any

from engines.scene.bsdf_tree import has_null_lobes, tilts_null_lobes
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin

UNLIMITED = 100_000
"""Segments that stand for a path without an end: the roulette ends it long before."""
SUGGESTED = {
    "path": "",
    "direct": "",
    "volpath": "",
    "volpathmis": "",
    "volpath_simple": "the same light by another way",
    "ptracer": "light paths are not followed",
    "bdpt": "light paths are not followed",
    "pssmlt": "the same light by another way",
    "mlt": "the same light by another way",
    "erpt": "the same light by another way",
    "prb": "the same light by another way",
    "prbvolpath": "the same light by another way",
    "prb_basic": "the same light by another way",
    "direct_projective": "the same light by another way",
    "prb_projective": "the same light by another way",
}
"""Integrators that a path tracer stands for, and why it is another one. Any other one estimates something else, or holds
another integrator."""
VOLUMETRIC = ("volpath", "volpathmis", "volpath_simple", "prbvolpath")
"""Those that render media. Light samples pass null lobes, and roulette begins one vertex later than that of `path`."""


def shader(importer: Importer, plugin: Plugin) -> dict[str, Any]:
    """The shader that an integrator suggests, once materials are read. Raises `SceneError` for what changes the image and is
    not supported."""
    inner = importer.taken(plugin, "integrator")
    if plugin.type not in SUGGESTED and inner:
        importer.notes.add(f"integrator {plugin.type}: the one within it is taken", plugin.element)
        return shader(importer, inner[0]) if inner[0] is not plugin else {"name": "path_tracer"}
    suggested: dict[str, Any] = {"name": "path_tracer"}
    volumetric = plugin.type in VOLUMETRIC
    in_media = volumetric and bool(importer.media)
    if in_media:
        suggested["name"] = "volumetric_path_tracer"
    if plugin.boolean("hide_emitters", default=False):
        suggested["hide_emitters"] = True
        if plugin.type == "direct":
            importer.notes.add("integrator direct: environments are hidden behind null surfaces as well", plugin.element)
    if plugin.type == "direct":
        suggested["max_depth"] = 2
        plugin.read.update(("shading_samples", "emitter_samples", "bsdf_samples"))
    else:
        depth = plugin.integer("max_depth", default=-1, low=-1, high=2**31 - 1)
        suggested["max_depth"] = UNLIMITED if depth < 0 else min(max(depth, 1), UNLIMITED)
        rr_depth = max(plugin.integer("rr_depth", default=5, low=-1, high=2**31 - 1), 1)
        suggested["rr_depth"] = min(rr_depth + (volumetric and not in_media), 1_000_000)
    bsdfs = [material.as_bsdf for material in importer.reader.table.materials]
    if volumetric and any(map(has_null_lobes, bsdfs)):
        if not in_media:
            suggested["transparent_shadows"] = True
        if any(map(tilts_null_lobes, bsdfs)):
            said = "light samples pass null surfaces and masks inside of bump and normal maps, where Mitsuba's are blocked"
            importer.notes.add(f"integrator {plugin.type}: {said}", plugin.element)
    if why := SUGGESTED.get(plugin.type, "it estimates something else"):
        importer.notes.add(f"integrator {plugin.type}: {suggested['name']} is suggested ({why})", plugin.element)
    if plugin.boolean("strict_normals", default=False):
        importer.notes.add("strict_normals: raybench always tests the geometric normal", plugin.element)
    for name, element in plugin.unread():
        plugin.read.add(name)
        importer.notes.drop(f"{element.attributes['name']} of integrator {plugin.type}")
    return suggested
