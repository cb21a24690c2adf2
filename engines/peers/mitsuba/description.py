"""A scene in Mitsuba's terms: nested dictionaries that `mitsuba.load_dict` takes and that `raybench convert` writes as XML.

Transforms are 4 x 4 float64 arrays; meshes and images lie where the caller places them. What differs:
planes are disks, so large that nothing tells; a surface that emits on both sides is two surfaces a hair apart,
as Mitsuba's area lights have one side.
"""

from __future__ import annotations

from dataclasses import dataclass

from engines.peers.adapters.lacks import environments_lack, point_lights_lack
from engines.peers.mitsuba.bsdfs import MODELS, WRAPPERS, bsdf_node, material_lacks
from engines.peers.mitsuba.cameras import CAMERAS, camera_lacks
from engines.peers.mitsuba.lights import LIGHTS, light_node, lights_lack
from engines.peers.mitsuba.media import media_lack, medium_node
from engines.peers.mitsuba.nodes import Node, Placing
from engines.peers.mitsuba.shapes import SHAPES, Part, emission_lacks, parts, planes_lack
from engines.peers.mitsuba.textures import Textures
from engines.scene import Checkerboard, HomogeneousMedium, ImageTexture, MeshAttribute, Scene
from engines.scene.scene import attributes_lack
from engines.scene.support import foreign

__all__ = ["KNOWN", "Description", "described", "scene_lacks"]


@dataclass(frozen=True, slots=True)
class Description:
    """`parts` in the order in which they stand in `nodes` ("shape_0", ...)."""

    nodes: Node
    parts: tuple[Part, ...]


def described(scene: Scene, placing: Placing, robust: bool = True) -> Description:
    """Materials, media, shapes and lights; the caller adds the sensor and the integrator. `scene_lacks` must have agreed."""
    textures = Textures(placing)
    materials = {f"material_{index}": bsdf_node(material.as_bsdf, textures) for index, material in enumerate(scene.materials)}
    all_parts = tuple(parts(scene, placing, textures))
    media = {f"medium_{index}": medium_node(medium) for index, medium in enumerate(scene.media)}
    lights = {f"light_{index}": light_node(light, placing, textures) for index, light in enumerate(scene.lights)}
    nodes: Node = {"type": "scene", "embree_use_robust_intersections": robust, **textures.nodes, **materials, **media}
    for index, part in enumerate(all_parts):
        nodes[f"shape_{index}"] = part.node
    return Description(nodes | lights, all_parts)


KNOWN: frozenset[type] = frozenset(
    {*CAMERAS, *SHAPES, *LIGHTS, *MODELS, *WRAPPERS, ImageTexture, Checkerboard, MeshAttribute, HomogeneousMedium}
)
"""The types of scenes that are described."""


def scene_lacks(scene: Scene) -> str | None:
    """One sentence on what Mitsuba does not support of the scene, or None."""
    if lacks := foreign(scene, KNOWN, "Mitsuba"):
        return lacks
    if lacks := attributes_lack(scene.materials, scene.shapes):
        return lacks
    if lacks := camera_lacks(scene.camera):
        return f"Mitsuba does not support {lacks}"
    for material in scene.materials:
        if lacks := material_lacks(material):
            return f"material {material.name!r}: Mitsuba does not support {lacks}"
    return (
        media_lack(scene)
        or planes_lack(scene)
        or emission_lacks(scene)
        or environments_lack(scene, "Mitsuba")
        or point_lights_lack(scene, "Mitsuba")
        or lights_lack(scene)
    )
