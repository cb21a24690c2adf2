"""What a BSDF is made of, and what follows for the whole of it: a tree of wrappers whose leaves are models.

Of a type that is none of ours nothing is claimed: it may transmit, and it has no parts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from engines.scene.bsdf import INNER, Bsdf, Bump, Mask, NormalMap, Wrapper, children
from engines.scene.models import Conductor, CustomBSDF, Dielectric, Null, Principled, ThinDielectric
from engines.scene.textures import Color, MeshAttribute, Number, Texture, UVTexture, largest
from engines.scene.triple import BLACK


def members(bsdf: Bsdf | None) -> Iterator[Bsdf]:
    """A BSDF and all that it is made of, from the outside in and from left to right; a side without one is left out."""
    if bsdf is not None:
        yield bsdf
    for inner in children(bsdf):
        yield from members(inner)


def leaves(bsdf: Bsdf | None) -> list[Bsdf | None]:
    """Where wrappers lead, each BSDF once: a BSDF that is no wrapper leads to itself, a side without one to None."""
    ends: dict[int, Bsdf | None] = {}
    waiting, seen = [bsdf], set[int]()
    while waiting:
        part = waiting.pop()
        if id(part) not in seen:
            seen.add(id(part))
            if isinstance(part, Wrapper):
                waiting += reversed(children(part))
            else:
                ends[id(part)] = part
    return list(ends.values())


# ---- what passes a surface -------------------------------------------------------------------------------------------


def transmission(leaf: Bsdf) -> Color | Number | None:
    """The factor of what a model lets through, a colour or a number; None where it is not known."""
    return getattr(leaf, "transmission", None)


def is_opaque(bsdf: Bsdf) -> bool:
    """Whether no light passes a BSDF anywhere, as far as is known: not so of a mask, a plugin or an unknown type."""
    factors = (transmission(leaf) for leaf in leaves(bsdf) if leaf is not None)
    return not any(isinstance(part, Mask) for part in members(bsdf)) and all(map(_is_nothing, factors))


def _is_nothing(factor: Color | Number | None) -> bool:
    return max(largest(factor)) == 0.0 if isinstance(factor, Texture) else factor in (BLACK, 0.0)


def transmits(bsdf: Bsdf) -> bool:
    """Whether any leaf of the tree can transmit light, whatever the values of its textures. Masks do not count."""
    return any(leaf is not None and _transmits(leaf) for leaf in leaves(bsdf))


def _transmits(leaf: Bsdf) -> bool:
    if isinstance(leaf, CustomBSDF):
        return any(getattr(leaf.plugin, name, False) for name in ("transmission", "specular_transmission"))
    return transmission(leaf) not in (BLACK, 0.0)


def has_null_lobes(bsdf: Bsdf) -> bool:
    """Whether rays may pass a BSDF as if it were not there: by null, a mask or a thin dielectric (docs/transport.md)."""
    return any(isinstance(part, Mask | Null | ThinDielectric) for part in members(bsdf))


def tilts_null_lobes(bsdf: Bsdf) -> bool:
    """Whether a bump or normal map lies around a null, a mask or a thin dielectric."""
    return any(has_null_lobes(part.of) for part in members(bsdf) if isinstance(part, Bump | NormalMap))


# ---- what light depends on -------------------------------------------------------------------------------------------


def own_values(part: Any) -> Iterator[Any]:
    """The numbers, words and textures of a BSDF itself, and not of what it wraps. Those of a plugin are not known."""
    for item in fields(part) if is_dataclass(part) and not isinstance(part, CustomBSDF) else ():
        if item.name not in INNER.get(type(part), ()):
            value = getattr(part, item.name)
            yield from value if isinstance(value, tuple) else (value,)


def own_textures(part: Any) -> Iterator[Texture]:
    """The textures of a BSDF itself, and not of what it wraps."""
    return (value for value in own_values(part) if isinstance(value, Texture))


def textures(bsdf: Bsdf | None) -> Iterator[Texture]:
    """The textures of a BSDF and of all that it is made of, each as often as it stands there."""
    for part in members(bsdf):
        yield from own_textures(part)


def is_textured(bsdf: Bsdf | None) -> bool:
    """Whether any texture is in it that looks at texture coordinates; attributes of meshes do not."""
    return any(isinstance(texture, UVTexture) for texture in textures(bsdf))


def attributes(bsdf: Bsdf | None) -> set[str]:
    """The names of the mesh attributes that are in it."""
    return {texture.name for texture in textures(bsdf) if isinstance(texture, MeshAttribute)}


def anisotropic(leaf: Bsdf | None) -> bool:
    """Whether a model depends on the direction of the first tangent of its surface."""
    if isinstance(leaf, Conductor | Dielectric):
        return leaf.alpha[0] != leaf.alpha[1]
    return isinstance(leaf, Principled) and leaf.anisotropic != 0.0


def uses_uvs(bsdf: Bsdf | None) -> bool:
    """Whether light depends on texture coordinates: by a texture, or by an anisotropic model, whose tangent follows them."""
    return is_textured(bsdf) or any(map(anisotropic, leaves(bsdf)))
