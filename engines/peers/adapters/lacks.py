"""What several renderers do not support, in the same words."""

from __future__ import annotations

from engines.peers.adapters.colors import largest, least
from engines.scene import (
    BLACK,
    Bump,
    Diffuse,
    EnvironmentLight,
    Instance,
    Mesh,
    Mixture,
    NormalMap,
    PointLight,
    Scene,
    Triangle,
)
from engines.scene.bsdf import Bsdf
from engines.scene.bsdf_tree import is_textured, own_textures

OUT_OF_RANGE = "textures that leave the range in which raybench holds them"


def point_lights_lack(scene: Scene, who: str) -> str | None:
    """One sentence where a point light does not fall off, which `who` does not support, or None."""
    forever = any(isinstance(light, PointLight) and not light.falloff for light in scene.lights)
    return f"{who}'s point lights fall off with the square of the distance" if forever else None


def environments_lack(scene: Scene, who: str) -> str | None:
    """One sentence where the scene has several environments, of which `who` renders one, or None."""
    several = sum(isinstance(light, EnvironmentLight) for light in scene.lights) > 1
    return f"the scene has several environments, of which {who} renders one" if several else None


def textures_lack(scene: Scene) -> str | None:
    """One sentence where a shape other than triangles has a texture, which renderers have on meshes alone, or None."""
    for shape in scene.shapes:
        if isinstance(shape, Triangle | Mesh | Instance):
            continue
        if is_textured((material := scene.materials[shape.material]).as_bsdf):
            return f"material {material.name!r}: textures are translated on meshes, not on a {type(shape).__name__}"
    return None


def is_diffuse(bsdf: Bsdf) -> bool:
    """Whether a BSDF is nothing but diffuse."""
    return isinstance(bsdf, Diffuse) or (isinstance(bsdf, Mixture) and (bsdf.ks, bsdf.kt) == (BLACK, BLACK))


def mixture_lacks(part: Mixture) -> str | None:
    """Why a renderer cannot represent a mixture that has only glass, diffuse, mirrors and blends of the two; else None."""
    diffuse, mirror, glass = (largest(weights) > 0.0 for weights in (part.kd, part.ks, part.kt))
    if glass and not (part.fresnel and not diffuse):
        return "refraction without Fresnel's equations, or beside a diffuse lobe"
    if mirror and not glass and part.fresnel:
        return "a mirror weighted by Fresnel's equations without refraction"
    if diffuse and mirror and largest(part.kd) + largest(part.ks) > 1.0:
        return "a blend of a diffuse and a mirror lobe whose largest components add up to more than 1"
    return None


def out_of_range(part: Bsdf) -> bool:
    """Whether a texture of a model leaves [0, 1], to which raybench holds it, and others do not."""
    if isinstance(part, Bump | NormalMap):
        return False
    return any(not 0.0 <= least(texture) <= largest(texture) <= 1.0 for texture in own_textures(part))
