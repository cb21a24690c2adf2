"""What the shader albedo shows, as a scene of diffuse surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from engines.peers.adapters.colors import largest, scaled
from engines.scene import (
    BLACK,
    WHITE,
    Blend,
    Bsdf,
    Bump,
    Color,
    Conductor,
    Dielectric,
    Diffuse,
    Mask,
    Material,
    MeshAttribute,
    Mixture,
    NormalMap,
    Null,
    Plastic,
    Principled,
    Scene,
    Sheen,
    Sides,
    Texture,
    ThinDielectric,
)
from engines.scene.bsdf import Wrapper, with_children
from engines.scene.bsdf_tree import members


def painted(scene: Scene) -> tuple[Scene, float]:
    """The scene in the dark with all surfaces diffuse, of the colours that the shader albedo shows, and what to multiply by.

    Shapes are not identified by `shape_index` of the scalar variant: its values were wrong for all shapes of one scene.
    """
    shown = [_shown(material.as_bsdf, material) for material in scene.materials]
    scale = max([1.0, *(largest(part.reflectance) for bsdf in shown for part in members(bsdf) if isinstance(part, Diffuse))])
    materials = tuple(
        Material(material.name, bsdf=_divided(bsdf, scale)) for material, bsdf in zip(scene.materials, shown, strict=True)
    )
    return replace(scene, materials=materials, lights=()), scale


def albedo_lacks(scene: Scene) -> str | None:
    """One sentence on what Mitsuba cannot show of the scene, or None."""
    for material in scene.materials:
        parts = [*members(material.as_bsdf)]
        if any(isinstance(part, Conductor) and isinstance(part.reflectance, MeshAttribute) for part in parts):
            return f"material {material.name!r}: Mitsuba's albedo has no metal with an attribute"
        of_textures = (isinstance(color, Texture) for part in parts for color in _colors(part))
        if material.emits and any(of_textures):
            return f"material {material.name!r}: Mitsuba's albedo has no emission where a texture is black"
    return None


def _shown(bsdf: Bsdf, material: Material) -> Bsdf:
    if isinstance(bsdf, (Mask, Bump, NormalMap)):
        return _shown(bsdf.of, material)
    if isinstance(bsdf, (Blend, Sides)):
        return with_children(bsdf, lambda child: Diffuse(material.emission) if child is None else _shown(child, material))
    colors = (*_colors(bsdf), material.emission)
    return Diffuse(next((color for color in colors if largest(color) > 0.0), BLACK))


def _colors(part: Bsdf) -> tuple[Color, ...]:
    """The colours of a model, of which the first that is not black counts."""
    if isinstance(part, Conductor):
        eta, k = np.array(part.eta), np.array(part.k)
        return (scaled(part.reflectance, ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)),)
    if isinstance(part, Null):
        return (WHITE,)
    return tuple(getattr(part, name) for name in COLORS.get(type(part), ()))


COLORS: Mapping[type, tuple[str, ...]] = {
    Mixture: ("kd", "ks", "kt"),
    Diffuse: ("reflectance",),
    Dielectric: ("transmittance",),
    ThinDielectric: ("transmittance",),
    Plastic: ("diffuse",),
    Principled: ("base_color",),
    Sheen: ("color",),
}
"""The fields of a leaf that hold colours of its albedo; of others none has one that counts."""


def _divided(bsdf: Bsdf, scale: float) -> Bsdf:
    if isinstance(bsdf, Wrapper):
        return with_children(bsdf, lambda child: _divided(child, scale))
    assert isinstance(bsdf, Diffuse)
    return bsdf if scale == 1.0 else Diffuse(scaled(bsdf.reflectance, 1.0 / scale))
