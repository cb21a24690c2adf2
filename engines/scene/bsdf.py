"""BSDFs of materials: the models of `engines.scene.models`, and wrappers around them. One is an entry of `MODELS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from engines.scene.models import LEAVES, ROUGHNESS, Leaf
from engines.scene.textures import NAMED, Checkerboard, ImageTexture, MeshAttribute, Number, Texture, named_texture
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import NUMBER, ContextKind
from engines.schema.yaml_file import Located

__all__ = ["Blend", "Bsdf", "Bump", "Mask", "NormalMap", "Sides", "Wrapper"]

MAX_PARTS = 256
"""Wrappers and models of a material, one that is named twice counted twice."""
MAX_DEPTH = 32
"""Wrappers around each other."""


_A_NAME = {"type": "string", "title": "name of a material"}
_A_MATERIAL = {"$ref": "#/properties/materials/additionalProperties", "title": "a material"}
INNER_MATERIAL = ContextKind(lambda node, context: context.table.bsdf(node, context), {"anyOf": [_A_NAME, _A_MATERIAL]})
"""The BSDF of a material that is named or written there."""
_OF = Key(INNER_MATERIAL, "The material that is wrapped: its name, or its keys. It does not emit.")


def _wrapper(make: Callable[..., Wrapper]) -> Callable[[Given, Any], Wrapper]:
    def wrap(given: Given, context: Any) -> Wrapper:
        made = make(**given.values)
        parts, depth = extent(made)
        if parts > MAX_PARTS or depth > MAX_DEPTH:
            limits = f"at most {MAX_PARTS}, and {MAX_DEPTH} around each other"
            raise given.node.refuse(f"holds {parts} wrappers and models, {depth} around each other: {limits} are possible")
        return made

    return wrap


def extent(bsdf: Bsdf | None) -> tuple[int, int]:
    """How many wrappers and models a BSDF holds, and how many wrappers are around each other."""
    inner = [extent(child) for child in children(bsdf)]
    return (bsdf is not None) + sum(parts for parts, _ in inner), 1 + max((depth for _, depth in inner), default=-1)


def children(bsdf: Bsdf | None) -> tuple[Bsdf | None, ...]:
    """What a wrapper wraps, from left to right, None for a side without a BSDF; nothing of a BSDF that is no wrapper."""
    return tuple(getattr(bsdf, name) for name in INNER.get(type(bsdf), ()))


def with_children(wrapper: Wrapper, function: Callable[[Any], Bsdf | None]) -> Any:
    """The wrapper around `function(child)` in place of each child; a side without a BSDF is None."""
    return replace(wrapper, **{name: function(getattr(wrapper, name)) for name in INNER[type(wrapper)]})


@dataclass(frozen=True, slots=True)
class Mask:
    """`of`, where a share `opacity` of it is there; the rest lets rays pass straight on. Emission is not scaled."""

    opacity: Number
    of: Bsdf


_MASK = Record(
    "A material with holes.",
    {"opacity": Key(ROUGHNESS, "Share of the material that is there; the rest lets rays pass straight on."), "of": _OF},
    _wrapper(Mask),
)


@dataclass(frozen=True, slots=True)
class Blend:
    """A share `weight` of `b` and the rest of `a`."""

    weight: Number
    a: Bsdf
    b: Bsdf


_BLEND = Record(
    "A mixture of two materials.", {"weight": Key(ROUGHNESS, "Share of b; the rest is a."), "a": _OF, "b": _OF}, _wrapper(Blend)
)


@dataclass(frozen=True, slots=True)
class Bump:
    """`of` with the normal of the surface displaced by `scale` times `height`, in scene units."""

    height: ImageTexture
    scale: float
    of: Bsdf


NO_SLOPE = {Checkerboard: "a checkerboard", MeshAttribute: "an attribute of meshes"}


def _height(node: Located, context: Any) -> ImageTexture:
    texture = named_texture(node, context)
    if not isinstance(texture, ImageTexture):
        raise node.refuse(f"must be an image: {NO_SLOPE[type(texture)]} has no slope")
    return texture


_BUMP = Record(
    "A material whose normal is that of a displaced surface.",
    {
        "height": Key(ContextKind(_height, NAMED), "Height of the surface, an image."),
        "scale": Key(NUMBER, "Factor of the height.", 1, unit="metres"),
        "of": _OF,
    },
    _wrapper(Bump),
)


@dataclass(frozen=True, slots=True)
class NormalMap:
    """`of` with the normal 2 c - 1, c a raw texel of `map`, in the frame of the surface."""

    map: Texture
    of: Bsdf


def _map(node: Located, context: Any) -> Texture:
    texture = named_texture(node, context)
    if isinstance(texture, MeshAttribute):
        raise node.refuse("must be an image or a checkerboard: attributes of meshes give no normals")
    if node.value in context.images.srgb:
        raise node.refuse("its texels are sRGB-encoded, and those of a normal map are not: give it color_space: raw")
    return texture


_NORMAL_MAP = Record(
    "A material whose normal an image gives.",
    {
        "map": Key(
            ContextKind(_map, NAMED),
            "Texture, of color_space raw, with texels c of the normals 2 c - 1, z along the surface's.",
        ),
        "of": _OF,
    },
    _wrapper(NormalMap),
)


@dataclass(frozen=True, slots=True)
class Sides:
    """`front` where the surface is met from the side of its normal, else `back`; None is black."""

    front: Bsdf | None
    back: Bsdf | None


_SIDED = Key(INNER_MATERIAL, "A material, as in of, or nothing for a black side.", None)
_BY_SIDE = Record("One material on each side.", {"front": _SIDED, "back": _SIDED}, _wrapper(Sides))


Wrapper = Mask | Blend | Bump | NormalMap | Sides
Bsdf = Leaf | Wrapper
INNER: Mapping[type, tuple[str, ...]] = {
    Mask: ("of",),
    Blend: ("a", "b"),
    Bump: ("of",),
    NormalMap: ("of",),
    Sides: ("front", "back"),
}
"""The fields of each wrapper that hold BSDFs."""


MODELS = {**LEAVES, "mask": _MASK, "blend": _BLEND, "bump": _BUMP, "normal_map": _NORMAL_MAP, "by_side": _BY_SIDE}
