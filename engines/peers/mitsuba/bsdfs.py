"""BSDFs in Mitsuba's terms. What differs is the order of wrappers.

Opaque models are one-sided there, and `twosided` makes them ours; but it holds nothing that transmits. So masks and blends
come first, then the two sides, then bumps and normal maps, then the models: wrappers commute, as they do here. Bumps and
normal maps of what transmits tilt the front, there and here; opaque models beside it are inside of them, with both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from engines.peers.adapters.colors import largest, mirror_share, scaled
from engines.peers.adapters.lacks import OUT_OF_RANGE, mixture_lacks, out_of_range
from engines.peers.mitsuba.nodes import Node, rgb
from engines.peers.mitsuba.textures import Textures
from engines.scene import (
    BLACK,
    Blend,
    Bsdf,
    Bump,
    Checkerboard,
    Dielectric,
    Diffuse,
    Mask,
    Material,
    MeshAttribute,
    Mixture,
    NormalMap,
    Plastic,
    Principled,
    Sheen,
    Sides,
    Texture,
)
from engines.scene.bsdf import Wrapper, with_children
from engines.scene.bsdf_tree import attributes, is_opaque, leaves, members, own_textures, uses_uvs
from engines.scene.leaf_fields import LEAF_PLUGINS, Kind, LeafField, is_rough

MODELS = (Mixture, *LEAF_PLUGINS)
WRAPPERS = (Mask, Blend, Bump, NormalMap, Sides)
TILTS = (Bump, NormalMap)
DARK = Diffuse(BLACK)


# ---- what is lacking -------------------------------------------------------------------------------------------------


def material_lacks(material: Material) -> str | None:
    """What Mitsuba does not support of a material, or None."""
    bsdf = material.as_bsdf
    lacking = next(filter(None, map(_lacks, members(bsdf))), None)
    if lacking is None and material.emits and material.two_sided:
        lacking = _two_surfaces_lack(bsdf)
    return lacking


def _lacks(part: Bsdf) -> str | None:
    """What one of its `members` lacks."""
    if out_of_range(part):
        return OUT_OF_RANGE
    if isinstance(part, Mixture):
        return mixture_lacks(part)
    if isinstance(part, Dielectric) and is_rough(part) and part.ior == 1.0:
        return "a rough dielectric of index 1"
    if isinstance(part, Sheen) and (isinstance(part.color, Texture) or len(set(part.color)) > 1):
        return "a sheen with a colour"
    if isinstance(part, Plastic) and any(isinstance(texture, MeshAttribute) for texture in own_textures(part)):
        return "a plastic with a colour from attributes of meshes"
    if isinstance(part, Sides) and not all(side is None or is_opaque(side) for side in (part.front, part.back)):
        return "sides that transmit"
    return _tilt_lacks(part) if isinstance(part, TILTS) else None


def _tilt_lacks(part: Bump | NormalMap) -> str | None:
    if any(isinstance(inner, TILTS) for inner in members(part.of)):
        return "a bump or normal map inside of another"
    blends = (inner for inner in members(part.of) if isinstance(inner, Blend) and _is_mixed(inner))
    if any(isinstance(inner, Mask) for blend in blends for inner in members(blend)):
        return "masks beside what transmits inside of a bump or normal map"
    if isinstance(part, Bump) and part.height.to_uv[1] != part.height.to_uv[3]:
        return "bumps whose texture coordinates are turned"
    if isinstance(part, NormalMap) and isinstance(part.map, Checkerboard):
        return "normals from a checkerboard"
    return None


def _two_surfaces_lack(bsdf: Bsdf) -> str | None:
    """What emits on both sides is two surfaces there."""
    if isinstance(bsdf, Mixture) and largest(bsdf.kt) > 0.0:
        return "glass that emits on both sides"
    if not is_opaque(bsdf):
        return "transmission through a surface that emits on both sides"
    if uses_uvs(bsdf) or attributes(bsdf) or any(isinstance(part, Sides) for part in members(bsdf)):
        return "textures, anisotropy and sides of a surface that emits on both"
    return None


# ---- wrappers --------------------------------------------------------------------------------------------------------


def bsdf_node(bsdf: Bsdf, textures: Textures) -> Node:
    """The BSDF of a material that `material_lacks` nothing."""
    if is_opaque(bsdf):
        front, back = _seen(bsdf, "front"), _seen(bsdf, "back")
        if any(isinstance(part, Sides) for part in members(bsdf)):
            return _of_two_sides(front, back, textures)
        return {"type": "twosided", "bsdf": _one_sided(bsdf, textures)}
    if isinstance(bsdf, Mask):
        return {"type": "mask", "opacity": textures.number(bsdf.opacity), "bsdf": bsdf_node(bsdf.of, textures)}
    if isinstance(bsdf, Blend):
        return _blend(bsdf, textures, bsdf_node)
    if isinstance(bsdf, TILTS):
        outer = _outwards(bsdf)
        return _tilt(bsdf, textures, bsdf_node) if outer is bsdf else bsdf_node(outer, textures)
    return _one_sided(bsdf, textures)


def _outwards(bsdf: Any) -> Any:
    """A bump or normal map of a mask or blend as a mask or blend of bumps or normal maps; of a mixed blend as it is."""
    if isinstance(bsdf.of, Mask) or (isinstance(bsdf.of, Blend) and not _is_mixed(bsdf.of)):
        return with_children(bsdf.of, lambda child: replace(bsdf, of=child))
    return bsdf


def _is_mixed(blend: Blend) -> bool:
    """Whether light passes one of its models and another one is opaque."""
    return len({is_opaque(leaf) for leaf in leaves(blend) if leaf is not None}) == 2


def _seen(bsdf: Bsdf, side: str) -> Bsdf:
    """The BSDF from one side: `Sides` are gone."""
    if isinstance(bsdf, Sides):
        chosen = getattr(bsdf, side)
        return DARK if chosen is None else _seen(chosen, side)
    return with_children(bsdf, lambda child: _seen(child, side)) if isinstance(bsdf, Wrapper) else bsdf


def _of_two_sides(front: Bsdf, back: Bsdf, textures: Textures) -> Node:
    if back == DARK:
        return _one_sided(front, textures)
    return {"type": "twosided", "bsdf_0": _one_sided(front, textures), "bsdf_1": _one_sided(back, textures)}


def _blend(bsdf: Blend, textures: Textures, inner: Callable[[Bsdf, Textures], Node]) -> Node:
    return {
        "type": "blendbsdf",
        "weight": textures.number(bsdf.weight),
        "bsdf_0": inner(bsdf.a, textures),
        "bsdf_1": inner(bsdf.b, textures),
    }


def _one_sided(bsdf: Bsdf, textures: Textures) -> Node:
    """As Mitsuba has it without `twosided`; what transmits has both sides anyway."""
    if isinstance(bsdf, Blend):
        return _blend(bsdf, textures, _one_sided)
    if isinstance(bsdf, TILTS):
        return _tilt(bsdf, textures, _one_sided)
    if isinstance(bsdf, Sheen):  # a black principled of index 1 has nothing but its sheen
        bsdf = Principled(BLACK, eta=1.0, sheen=bsdf.color[0])  # type: ignore[index]
    return _mixture(bsdf, textures) if isinstance(bsdf, Mixture) else _leaf(bsdf, textures)


def _tilt(bsdf: Bump | NormalMap, textures: Textures, inner: Callable[[Bsdf, Textures], Node]) -> Node:
    of = inner(bsdf.of, textures)
    if isinstance(bsdf, Bump):
        return {"type": "bumpmap", "texture": textures.number(bsdf.height), "scale": float(bsdf.scale), "bsdf": of}
    return {"type": "normalmap", "normalmap": textures.vector(bsdf.map), "bsdf": of}  # type: ignore[arg-type]


# ---- models ----------------------------------------------------------------------------------------------------------


def _mixture(part: Mixture, textures: Textures) -> Node:
    if largest(part.kt) > 0.0:
        return _leaf(Dielectric(part.ior, reflectance=part.ks, transmittance=part.kt), textures)
    share = mirror_share(part)
    if share == 0.0:
        return _leaf(Diffuse(part.kd), textures)
    if share == 1.0:
        return _mirror(part.ks, textures)
    kd, ks = scaled(part.kd, 1.0 / (1.0 - share)), scaled(part.ks, 1.0 / share)
    return {"type": "blendbsdf", "weight": share, "bsdf_0": _leaf(Diffuse(kd), textures), "bsdf_1": _mirror(ks, textures)}


def _mirror(reflectance: Any, textures: Textures) -> Node:
    return {"type": "conductor", "material": "none", "specular_reflectance": textures.color(reflectance)}


def _leaf(part: Bsdf, textures: Textures) -> Node:
    plugin = LEAF_PLUGINS[type(part)]
    kind = plugin.plugin_of(part)
    assert kind is not None
    node: Node = {"type": kind}
    for item in plugin.fields_of(kind):
        node |= _parameters(item, getattr(part, item.name), textures)
    return node


def _parameters(item: LeafField, value: Any, textures: Textures) -> Node:
    """What a field is in Mitsuba's terms."""
    match item.kind:
        case Kind.COLOR:
            return {item.parameter: textures.color(value)}
        case Kind.NUMBER:
            return {item.parameter: textures.number(value)}
        case Kind.SPECTRUM:
            return {item.parameter: rgb(value)}
        case Kind.IOR:
            return {item.parameter: float(value), "ext_ior": 1.0}
        case Kind.ROUGHNESSES:
            alpha_u, alpha_v = map(textures.number, value)
            return {"alpha_u": alpha_u, "alpha_v": alpha_v}
        case Kind.ETA | Kind.ROUGHNESS:
            return {item.parameter: float(value)}
        case Kind.FLAG | Kind.DISTRIBUTION:
            return {item.parameter: value}
