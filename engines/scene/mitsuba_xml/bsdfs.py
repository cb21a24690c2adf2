"""BSDFs: each of `BSDFS` makes a model of the scene from a plugin; `REFUSED` says why others are not supported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from engines.errors import suggestion
from engines.scene.bsdf import MAX_PARTS, Blend, Bsdf, Bump, Mask, NormalMap, Sides, Wrapper, extent, with_children
from engines.scene.bsdf_tree import has_null_lobes, transmits
from engines.scene.leaf_fields import ACRYLIC, BK7, LEAF_PLUGINS, Kind, LeafField
from engines.scene.metals import METALS
from engines.scene.mitsuba_xml.colors import INDEX, color
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.textures import color_or_texture, image_texture, number_or_texture
from engines.scene.models import (
    IORS,
    LEAST_CONTRAST,
    SMOOTHEST,
    TOO_LITTLE_CONTRAST,
    Dielectric,
    Diffuse,
    Principled,
    indices_lack,
    principled_eta,
)
from engines.scene.textures import Color, ImageTexture, Number
from engines.scene.triple import BLACK, WHITE, Triple, triple

AIR = 1.000277
INDICES_BY_NAME = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": AIR,
    "carbon dioxide": 1.00045,
    "water": 1.333,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "water ice": 1.31,
    "fused quartz": 1.458,
    "pyrex": 1.47,
    "acrylic glass": ACRYLIC,
    "polypropylene": 1.49,
    "bk7": BK7,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.575,
    "diamond": 2.419,
}
"""Indices of refraction that a file may name."""


def bsdf(importer: Importer, plugin: Plugin, two_sided: bool = False) -> Bsdf:
    """The BSDF of a plugin; opaque models are black from behind unless `two_sided`. Raises `SceneError`."""
    key = (id(plugin), "bsdf", two_sided)
    if key not in importer.built:
        make = BSDFS.get(plugin.type)
        if make is None:
            raise plugin.refuse(REFUSED.get(plugin.type, f"unknown BSDF: {suggestion(plugin.type, BSDFS)}"))
        importer.enter(plugin)
        plugin.read.add("type")
        made = make(importer, plugin, two_sided)
        if extent(made)[0] > MAX_PARTS:
            raise plugin.refuse(f"more than {MAX_PARTS} BSDFs within each other")
        importer.leave(plugin)
        importer.built[key] = made
    return importer.built[key]


def turned(bsdf: Bsdf) -> Bsdf:
    """The BSDF for a surface whose sides are exchanged."""
    if isinstance(bsdf, Sides):
        return Sides(bsdf.back, bsdf.front)
    if isinstance(bsdf, Dielectric):
        return replace(bsdf, ior=1.0 / bsdf.ior)
    if isinstance(bsdf, Principled) and bsdf.spec_trans != 0.0:
        return replace(bsdf, eta=1.0 / bsdf.eta)
    if isinstance(bsdf, Bump) and transmits(bsdf):
        bsdf = replace(bsdf, scale=-bsdf.scale)
    return with_children(bsdf, turned) if isinstance(bsdf, Wrapper) else bsdf


# ---- parameters ------------------------------------------------------------------------------------------------------


def _index(plugin: Plugin, name: str, default: float) -> float:
    """An index of refraction: a number, or the name of a substance."""
    element = plugin.values.get(name)
    if element is None or element.tag != "string":
        return plugin.positive(name, default=default)
    named = (plugin.text(name) or "").lower()
    if named not in INDICES_BY_NAME:
        raise element.refuse_value(f"unknown substance: {suggestion(named, INDICES_BY_NAME)}")
    return INDICES_BY_NAME[named]


def _ior(plugin: Plugin, inside: float, limits: tuple[float, float]) -> float:
    """The index of the inside over that of the outside."""
    ratio = _index(plugin, "int_ior", inside) / _index(plugin, "ext_ior", AIR)
    if not limits[0] <= ratio <= limits[1]:
        raise plugin.refuse(f"int_ior / ext_ior is {ratio:g}: must lie in [{limits[0]:g}, {limits[1]:g}]")
    return ratio


def _distribution(plugin: Plugin, default: str) -> str:
    name = plugin.text("distribution", default=default) or default
    if name not in ("beckmann", "ggx"):
        raise plugin.refuse_property("distribution", "must be beckmann or ggx")
    return name


def _alphas(importer: Importer, plugin: Plugin, default: float) -> tuple[Number, Number]:
    """Roughnesses along the two tangents, at least `SMOOTHEST`."""
    along = "alpha_u", "alpha_v"
    if plugin.has(*along) and plugin.has("alpha"):
        raise plugin.refuse("either alpha, or alpha_u and alpha_v")
    u, v = (
        number_or_texture(importer, plugin, name, "alpha", default=default)
        if plugin.has(name) or not plugin.has("alpha")
        else number_or_texture(importer, plugin, "alpha", default=default)
        for name in along
    )
    return _rough(u), _rough(v)


def _alpha(plugin: Plugin, default: float) -> float:
    """The roughness of a plastic, at least `SMOOTHEST`."""
    if plugin.find("alpha") is not None:
        raise plugin.refuse("alpha: the roughness of a plastic is a number, not a texture")
    return max(SMOOTHEST, plugin.number("alpha", default=default, low=0.0, high=1.0))


def _rough(alpha: Number) -> Number:
    return max(SMOOTHEST, alpha) if isinstance(alpha, float) else alpha


class Indices(NamedTuple):
    """The complex index of refraction of a metal, relative to the outside."""

    eta: Triple
    k: Triple


def _metal(plugin: Plugin) -> Indices:
    eta, k = _given_metal(plugin)
    outside = _index(plugin, "ext_eta", 1.0)
    eta, k = (triple(x / outside for x in values) for values in (eta, k))
    if lacks := indices_lack(eta, k):
        raise plugin.refuse(lacks)
    return Indices(eta, k)


def _given_metal(plugin: Plugin) -> tuple[Triple, Triple]:
    """eta and k by name or as given; those of a perfect mirror where a new file gives none, of copper where an old one does."""
    name = plugin.text("material")
    if name is not None:
        if plugin.has("eta") or plugin.has("k"):
            raise plugin.refuse("either material, or eta and k")
        if name.lower() == "none":
            return BLACK, WHITE
        if name not in METALS:
            raise plugin.refuse_property("material", f"{suggestion(name, METALS)}, none; or give eta and k")
        return METALS[name]
    for name in ("eta", "k"):
        if plugin.find(name) is not None:
            raise plugin.refuse(f"{name}: a colour is expected, not a texture")
    eta, k = plugin.spectrum("eta"), plugin.spectrum("k")
    if eta is None and k is None:
        return METALS["Cu"] if plugin.element.source.old else (BLACK, WHITE)
    if eta is None or k is None:
        raise plugin.refuse("eta and k are expected, or neither")
    return color(eta, INDEX), color(k, INDEX)


def _eta(importer: Importer, plugin: Plugin) -> float:
    """The index of Disney's BSDF: `eta`, or what follows from `specular`."""
    if plugin.has("eta") and plugin.has("specular"):
        raise plugin.refuse("either eta or specular")
    for name in ("eta", "specular"):
        if plugin.find(name) is not None:
            raise plugin.refuse(f"{name}: a number is expected, not a texture")
    spec_trans = number_or_texture(importer, plugin, "spec_trans", default=0.0)
    if plugin.has("eta"):
        eta = plugin.positive("eta", default=1.5)
    else:
        eta = principled_eta(plugin.number("specular", default=0.5, low=0.0, high=1.0), spec_trans)
    if not 1.0 <= eta <= IORS[1]:
        raise plugin.refuse_property("eta", f"must lie in [1, {IORS[1]:g}]")
    return eta if spec_trans == 0.0 else max(eta, 1.0 + LEAST_CONTRAST)


# ---- models ----------------------------------------------------------------------------------------------------------


def _color(importer: Importer, plugin: Plugin, item: LeafField) -> Color:
    return color_or_texture(importer, plugin, item.parameter, *item.older, default=item.default)


_READERS: dict[Kind, Callable[[Importer, Plugin, LeafField], Any]] = {
    Kind.COLOR: _color,
    Kind.NUMBER: lambda importer, plugin, item: number_or_texture(importer, plugin, item.parameter, default=item.default),
    Kind.FLAG: lambda importer, plugin, item: plugin.boolean(item.parameter, default=item.default),
    Kind.SPECTRUM: lambda importer, plugin, item: getattr(_metal(plugin), item.name),
    Kind.IOR: lambda importer, plugin, item: _ior(plugin, item.default, item.limits),
    Kind.ETA: lambda importer, plugin, item: _eta(importer, plugin),
    Kind.ROUGHNESS: lambda importer, plugin, item: _alpha(plugin, item.default),
    Kind.ROUGHNESSES: lambda importer, plugin, item: _alphas(importer, plugin, item.default),
    Kind.DISTRIBUTION: lambda importer, plugin, item: _distribution(plugin, item.default),
}
"""How a plugin's parameters become the value of a field of ours."""


def _leaf(importer: Importer, plugin: Plugin, two_sided: bool, taken_as: str = "") -> Bsdf:
    """The model of a plugin, or of the plugin that it is `taken_as`; an opaque one has its front alone unless `two_sided`."""
    name = taken_as or plugin.type
    kind, described = next((kind, leaf) for kind, leaf in LEAF_PLUGINS.items() if name in leaf.plugins)
    items = described.fields_of(name)
    plugin.read.update(harmless for item in items for harmless in item.harmless)
    model = kind(**{item.name: _READERS[item.kind](importer, plugin, item) for item in items})
    if isinstance(model, Dielectric) and name == described.rough and abs(model.ior - 1.0) < LEAST_CONTRAST:
        raise plugin.refuse(TOO_LITTLE_CONTRAST)
    if two_sided or model == Diffuse(BLACK) or transmits(model):
        return model
    importer.one_sided[plugin.label] = None
    return Sides(model, None)


def _rough_diffuse(importer: Importer, plugin: Plugin, two_sided: bool) -> Bsdf:
    alpha = number_or_texture(importer, plugin, "alpha", default=0.2, high=1e6)
    plugin.read.add("use_fast_approx")
    if alpha != 0.0:
        importer.notes.add("roughdiffuse is taken as diffuse", plugin.element)
    return _leaf(importer, plugin, two_sided, "diffuse")


# ---- wrappers --------------------------------------------------------------------------------------------------------


def _inner(importer: Importer, plugin: Plugin, counts: tuple[int, ...], two_sided: bool) -> list[Bsdf]:
    nested = importer.taken(plugin, "bsdf")
    if len(nested) not in counts:
        expected = "1 nested BSDF is" if counts == (1,) else f"{' or '.join(map(str, counts))} nested BSDFs are"
        raise plugin.refuse(f"{expected} expected, not {len(nested)}")
    return [bsdf(importer, inner, two_sided) for inner in nested]


def _two_sided(importer: Importer, plugin: Plugin, two_sided: bool) -> Bsdf:
    inner = _inner(importer, plugin, (1, 2), True)
    if any(transmits(side) or has_null_lobes(side) for side in inner):
        raise plugin.refuse("holds a BSDF that lets light through, which Mitsuba does not allow: leave twosided out")
    return inner[0] if len(inner) == 1 else Sides(*inner)


def _mask(importer: Importer, plugin: Plugin, two_sided: bool) -> Bsdf:
    opacity = number_or_texture(importer, plugin, "opacity", default=0.5)
    return Mask(opacity, *_inner(importer, plugin, (1,), two_sided))


def _blend(importer: Importer, plugin: Plugin, two_sided: bool) -> Bsdf:
    if not plugin.has("weight"):
        raise plugin.refuse("the property 'weight' is missing")
    weight = number_or_texture(importer, plugin, "weight", default=0.5)
    return Blend(weight, *_inner(importer, plugin, (2,), two_sided))


def _nested_image(importer: Importer, plugin: Plugin) -> tuple[Plugin, ImageTexture]:
    nested = importer.taken(plugin, "texture")
    if len(nested) != 1:
        raise plugin.refuse(f"one nested texture is expected, not {len(nested)}")
    return nested[0], image_texture(importer, nested[0])


def _bump(importer: Importer, plugin: Plugin, two_sided: bool) -> Bsdf:
    _, height = _nested_image(importer, plugin)
    scale = plugin.number("scale", default=1.0)
    return Bump(height, scale, *_inner(importer, plugin, (1,), two_sided))


def _normal_map(importer: Importer, plugin: Plugin, two_sided: bool) -> Bsdf:
    texture, normals = _nested_image(importer, plugin)
    if normals.pixels.shape[2] != 3:
        raise texture.refuse("an image with three channels is expected")
    return NormalMap(normals, *_inner(importer, plugin, (1,), two_sided))


BSDFS: dict[str, Callable[[Importer, Plugin, bool], Bsdf]] = {
    **{name: _leaf for leaf in LEAF_PLUGINS.values() for name in leaf.plugins},
    "roughdiffuse": _rough_diffuse,
    "twosided": _two_sided,
    "mask": _mask,
    "blendbsdf": _blend,
    "bumpmap": _bump,
    "normalmap": _normal_map,
}
REFUSED = {
    "phong": "is not supported: use roughplastic or roughconductor",
    "ward": "is not supported: use roughconductor",
    "coating": "is not supported: use plastic or principled",
    "roughcoating": "is not supported: use roughplastic or principled",
    "difftrans": "diffuse transmission is not supported: use diffuse",
    "hk": "scattering below the surface is not supported: use diffuse",
    "mixturebsdf": "is not supported: use blendbsdf",
    "irawan": "woven cloth is not supported: use principled, with sheen",
    "principledthin": "is not supported: use principled",
    "measured": "measured BSDFs are not supported: use roughconductor or principled",
    "measured_polarized": "measured BSDFs are not supported: use roughconductor or principled",
    "hair": "the scattering of hair is not supported: use roughconductor or principled",
    "pplastic": "polarisation is not supported: use plastic or roughplastic",
    "polarizer": "polarisation is not supported: use mask, of opacity 0.5, of a black diffuse",
    "retarder": "polarisation is not supported: use null",
    "circular": "polarisation is not supported: use mask, of opacity 0.5, of a black diffuse",
}
