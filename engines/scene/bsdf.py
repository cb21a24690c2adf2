"""BSDF models of materials: what engines get of each, and beside it the keys of a scene file. One is an entry of `MODELS`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from dataclasses import fields as fields_of
from typing import Any

from engines.scene.metals import METALS
from engines.scene.plugins import PluginKind, all_options
from engines.scene.textures import (
    NAMED,
    Color,
    ImageTexture,
    Number,
    Texture,
    named_texture,
    textured_color,
    textured_number,
)
from engines.scene.triple import BLACK, WHITE, Triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, NUMBER, Kind, color, one_of, within
from engines.schema.yaml_file import Located

__all__ = [
    "Blend", "Bsdf", "Bump", "Conductor", "CustomBSDF", "Dielectric", "Diffuse", "Mask", "Mixture", "NormalMap", "Null",
    "Plastic", "Principled", "Sides", "ThinDielectric", "Wrapper",
]  # fmt: skip

SMOOTHEST = 1e-4
"""The least roughness above 0, as in Mitsuba."""
INDICES = (1e-6, 1e6)
"""Between which the larger of eta and k lies. At normal incidence Fresnel's equations have their fourth powers as terms, which
leave float32 beyond these limits; where both are 0, they are 0/0."""
IORS = (0.01, 100.0)
LEAST_CONTRAST = 1e-3
"""Least distance of a rough interface's ior from 1, where refracted light has no half vector."""
PLASTIC_IORS = (1.0, 3.0)
"""Where the diffuse reflectance of the inside, a fit, lies below 1."""
MAX_PARTS = 256
"""Wrappers and models of a material, one that is named twice counted twice."""
MAX_DEPTH = 32
"""Wrappers around each other."""


class AlphaKind:
    """A number or a texture, or two of them, [along the first tangent, along the second]: numbers are both 0, or none is less
    than SMOOTHEST."""

    def read(self, node: Located, context: Any = None) -> tuple[Number, Number]:
        items = node.value if isinstance(node.value, list) else [node]
        if isinstance(node.value, list) and len(items) != 2:
            raise node.refuse("must be a number, or two")
        found = [named_texture(item, context) if isinstance(item.value, str) else fields.number(item) for item in items]
        for item, value in zip(items, found, strict=True):
            if any(found) and not isinstance(value, Texture) and not SMOOTHEST <= value <= 1.0:
                raise item.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
        return found[0], found[-1]

    def schema(self) -> dict[str, Any]:
        one = _ROUGHNESS.schema()["anyOf"]
        return {"anyOf": [*one, {"type": "array", "items": {"anyOf": one}, "minItems": 2, "maxItems": 2}]}


def _plain_alpha(node: Located) -> float:
    alpha = fields.number(node)
    if alpha != 0.0 and not SMOOTHEST <= alpha <= 1.0:
        raise node.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
    return alpha


_ROUGHNESS = textured_number(0, 1)
_SHARE = textured_color(1)
ALPHA = Key(
    AlphaKind(), f"Roughness of the microfacets, or two along the tangents; 0 is smooth, else at least {SMOOTHEST:g}.", 0
)
DISTRIBUTION = Key(one_of(("ggx", "beckmann"), "distribution"), "Distribution of the microfacets' normals.", "ggx")
_REFLECTED = Key(_SHARE, "Factor of what is reflected by the interface.", 1)
_TRANSMITTED = Key(_SHARE, "Factor of what passes the interface.", 1)
IOR = Key(within(*IORS), "Index of refraction of the inside, relative to the outside.", 1.5)


@dataclass(frozen=True, slots=True)
class Conductor:
    """A metal: reflection alone, weighted by the unpolarised Fresnel reflectance of the complex index `eta` + i `k`.

    `alpha` are the GGX (Trowbridge-Reitz) roughnesses along the two tangents of the surface: both 0 for a smooth surface,
    a mirror, else both in [1e-4, 1]. `reflectance` in [0, 1] scales the reflection. Both sides of the surface reflect.

    The first tangent is dp/du, made perpendicular to the shading normal: of a sphere along phi, counter-clockwise about +z;
    of a disk away from its center; of a triangle from its first corner to its second; of a plane t1 of the local frame of its
    normal, turned to the viewer (docs/transport.md). The second is normal x first.
    """

    eta: Triple
    k: Triple
    alpha: tuple[Number, Number] = (0.0, 0.0)
    reflectance: Color = WHITE
    distribution: str = "ggx"

    @property
    def albedo(self) -> Triple:
        """The share of light that a smooth surface reflects at normal incidence; the shader `albedo` shows it."""
        r, g, b = (
            scale * ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)
            for eta, k, scale in zip(self.eta, self.k, self.reflectance, strict=True)
        )
        return r, g, b


def _conductor(given: Given, context: Any) -> Conductor:
    if given["reflectance"] is not None:
        if given.has("specular_reflectance"):
            raise given.node.refuse_key("specular_reflectance", "a factor of metal, or eta and k: reflectance is all there is")
        return Conductor(BLACK, WHITE, given["alpha"], given["reflectance"], given["distribution"])  # Fresnel gives 1
    eta, k = METALS[given["metal"]] if given["metal"] else (given["eta"], given["k"])
    for channel, larger in zip(("red", "green", "blue"), map(max, eta, k), strict=True):
        if not INDICES[0] <= larger <= INDICES[1]:
            limits = f"[{INDICES[0]:g}, {INDICES[1]:g}]"
            raise given.node.refuse(f"the larger of eta and k is {larger:g} in {channel}: must lie in {limits}")
    return Conductor(eta, k, given["alpha"], given["specular_reflectance"], given["distribution"])


_CONDUCTOR = Record("A metal, smooth or with microfacets: its name, or eta and k, or its reflectance alone.", {
    "metal": Key(one_of(METALS, "metal"), "Chemical symbol of the metal, for its eta and k.", None),
    "eta": Key(color(), "Real part of the complex index of refraction.", None),
    "k": Key(color(), "Imaginary part of the complex index of refraction.", None),
    "reflectance": Key(_SHARE, "Reflectance at every angle, instead of Fresnel's equations.", None),
    "alpha": ALPHA,
    "distribution": DISTRIBUTION,
    "specular_reflectance": Key(_SHARE, "Factor of the reflectance that follows from metal, or from eta and k.", 1),
}, _conductor, either=(("metal",), ("eta", "k"), ("reflectance",)))  # fmt: skip


@dataclass(frozen=True, slots=True)
class CustomBSDF:
    """A BSDF plugin (see `engines.plugin.BSDF`). `options` has a number, or three, for every option of the plugin, in
    the plugin's order: those that are not given have their defaults. Raises `UnknownName`."""

    plugin: Any
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", all_options("BSDF", self.plugin, self.options))


@dataclass(frozen=True, slots=True)
class Mixture:
    """kd, ks and kt as in `Material`, where they stand inside another BSDF or `kd`, `ks` or `kt` is a texture."""

    kd: Color = BLACK
    ks: Color = BLACK
    kt: Color = BLACK
    ior: float = 1.0
    fresnel: bool = False


@dataclass(frozen=True, slots=True)
class Diffuse:
    """Lambertian: f = reflectance / pi, on both sides."""

    reflectance: Color = (0.5, 0.5, 0.5)


_DIFFUSE = Record("A Lambertian surface.", {
    "reflectance": Key(_SHARE, "Share of light that it returns.", 0.5),
}, lambda given, context: Diffuse(**given.values))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Dielectric:
    """Glass: reflection and refraction by Fresnel's equations. `ior` is that of the inside over that of the outside.

    `alpha` are the roughnesses along the tangents, both 0 for a smooth interface; `distribution` is "ggx" or "beckmann".
    """

    ior: float = 1.5
    alpha: tuple[Number, Number] = (0.0, 0.0)
    reflectance: Color = WHITE
    transmittance: Color = WHITE
    distribution: str = "ggx"


def _dielectric(given: Given, context: Any) -> Dielectric:
    rough = given["alpha"] != (0.0, 0.0)
    if rough and abs(given["ior"] - 1.0) < LEAST_CONTRAST:
        raise given.at("ior").refuse(f"a rough interface wants an index at least {LEAST_CONTRAST:g} away from 1")
    return Dielectric(
        given["ior"], given["alpha"], given["specular_reflectance"], given["specular_transmittance"], given["distribution"]
    )


_DIELECTRIC = Record("The interface of a transparent solid, smooth (glass) or with microfacets (frosted glass).", {
    "ior": IOR, "alpha": ALPHA, "distribution": DISTRIBUTION, "specular_reflectance": _REFLECTED,
    "specular_transmittance": _TRANSMITTED,
}, _dielectric)  # fmt: skip


@dataclass(frozen=True, slots=True)
class ThinDielectric:
    """A pane without thickness: what passes goes straight on, reflections between its faces included."""

    ior: float = 1.5
    reflectance: Color = WHITE
    transmittance: Color = WHITE


_THIN_DIELECTRIC = Record("A pane without thickness, as of a window: what passes goes straight on.", {
    "ior": IOR, "specular_reflectance": _REFLECTED, "specular_transmittance": _TRANSMITTED,
}, lambda given, context: ThinDielectric(*given.values.values()))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Plastic:
    """A diffuse base under a dielectric coat of index `ior`, smooth where `alpha` is 0.

    `reflectance` scales the specular reflection. With `nonlinear`, light that is reflected inside takes the colour of the
    base each time.
    """

    diffuse: Color = (0.5, 0.5, 0.5)
    ior: float = 1.49
    alpha: float = 0.0
    nonlinear: bool = False
    reflectance: Color = WHITE
    distribution: str = "ggx"


_PLASTIC = Record("A diffuse base under a clear coat, smooth or with microfacets.", {
    "diffuse": Key(_SHARE, "Reflectance of the base.", 0.5),
    "ior": Key(within(*PLASTIC_IORS), "Index of refraction of the coat, relative to the outside.", 1.49),
    "alpha": Key(
        Kind(_plain_alpha, within(0, 1).json), f"Roughness of the coat; 0 is smooth, else at least {SMOOTHEST:g}.", 0
    ),
    "nonlinear": Key(BOOLEAN, "Whether light that is reflected inside takes the base's colour each time.", False),
    "specular_reflectance": _REFLECTED,
    "distribution": DISTRIBUTION,
}, lambda given, context: Plastic(*given.values.values()))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Principled:
    """Disney's BSDF (Burley 2012, 2015) with Mitsuba's parameters. `eta` is the index of refraction that follows from
    `specular` where that is given."""

    base_color: Color = (0.5, 0.5, 0.5)
    roughness: Number = 0.5
    anisotropic: Number = 0.0
    metallic: Number = 0.0
    eta: float = 1.5
    spec_tint: Number = 0.0
    sheen: Number = 0.0
    sheen_tint: Number = 0.0
    clearcoat: Number = 0.0
    clearcoat_gloss: Number = 0.0
    flatness: Number = 0.0
    spec_trans: Number = 0.0


def principled_eta(specular: float) -> float:
    """The index of refraction of which Disney's `specular` is the reflectance at normal incidence / 0.08; as in Mitsuba, 0
    stands for 0.001."""
    return 2.0 / (1.0 - math.sqrt(0.08 * (specular or 1e-3))) - 1.0


def _principled(given: Given, context: Any) -> Principled:
    values = {key: value for key, value in given.values.items() if key != "specular"}
    if values["eta"] is None:
        values["eta"] = principled_eta(given["specular"])
    elif given.has("specular"):
        raise given.node.refuse_key("specular", "either specular or eta")
    return Principled(**values)


_PRINCIPLED = Record("Disney's BSDF (Burley 2012, 2015), as Mitsuba parameterises it.", {
    "base_color": Key(_SHARE, "Colour of the surface.", 0.5),
    "roughness": Key(_ROUGHNESS, "Roughness; alpha is about its square.", 0.5),
    "anisotropic": Key(_ROUGHNESS, "How much longer highlights are along the first tangent.", 0),
    "metallic": Key(_ROUGHNESS, "Share of a metal.", 0),
    "specular": Key(within(0, 1), "Strength of reflection at normal incidence; 1 is 0.08.", 0.5),
    "eta": Key(within(1.001, 100), "Index of refraction, instead of specular.", None),
    "spec_tint": Key(_ROUGHNESS, "How much base_color tints the reflection.", 0),
    "sheen": Key(_ROUGHNESS, "Strength of the sheen of cloth at grazing angles.", 0),
    "sheen_tint": Key(_ROUGHNESS, "How much base_color tints the sheen.", 0),
    "clearcoat": Key(_ROUGHNESS, "Strength of a clear coat on top.", 0),
    "clearcoat_gloss": Key(_ROUGHNESS, "Gloss of the clear coat.", 0),
    "flatness": Key(_ROUGHNESS, "Share of an approximation of subsurface scattering in the diffuse part.", 0),
    "spec_trans": Key(_ROUGHNESS, "Share of a transparent solid.", 0),
}, _principled)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Null:
    """Nothing: every ray goes straight on."""


_NULL = Record("Nothing: every ray goes straight on.", {}, lambda given, context: Null())


class InnerKind:
    """The BSDF of a material that is named or written here."""

    def read(self, node: Located, context: Any = None) -> Bsdf:
        return context.table.bsdf(node, context)

    def schema(self) -> dict[str, Any]:
        named = {"type": "string", "title": "name of a material"}
        return {"anyOf": [named, {"$ref": "#/properties/materials/additionalProperties", "title": "a material"}]}


_OF = Key(InnerKind(), "The material that is wrapped: its name, or its keys. It does not emit.")


def _wrapper(make: Callable[..., Wrapper]) -> Callable[[Given, Any], Wrapper]:
    def wrap(given: Given, context: Any) -> Wrapper:
        made = make(**given.values)
        parts, depth = _extent(made)
        if parts > MAX_PARTS or depth > MAX_DEPTH:
            limits = f"at most {MAX_PARTS}, and {MAX_DEPTH} around each other"
            raise given.node.refuse(f"holds {parts} wrappers and models, {depth} around each other: {limits} are possible")
        return made

    return wrap


def _extent(bsdf: Bsdf | None) -> tuple[int, int]:
    """How many wrappers and models a BSDF holds, and how many are around each other."""
    inner = [_extent(each) for each in _inside(bsdf)]
    return 1 + sum(parts for parts, _ in inner), 1 + max((depth for _, depth in inner), default=-1)


def _inside(bsdf: Bsdf | None) -> tuple[Bsdf | None, ...]:
    if isinstance(bsdf, Blend):
        return bsdf.a, bsdf.b
    if isinstance(bsdf, Sides):
        return bsdf.front, bsdf.back
    return (bsdf.of,) if isinstance(bsdf, Mask | Bump | NormalMap) else ()


@dataclass(frozen=True, slots=True)
class Mask:
    """`of`, where a share `opacity` of it is there; the rest lets rays pass straight on. Emission is not scaled."""

    opacity: Number
    of: Bsdf


_MASK = Record("A material with holes.", {
    "opacity": Key(_ROUGHNESS, "Share of the material that is there; the rest lets rays pass straight on."), "of": _OF,
}, _wrapper(Mask))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Blend:
    """A share `weight` of `b` and the rest of `a`."""

    weight: Number
    a: Bsdf
    b: Bsdf


_BLEND = Record("A mixture of two materials.", {
    "weight": Key(_ROUGHNESS, "Share of b; the rest is a."), "a": _OF, "b": _OF,
}, _wrapper(Blend))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Bump:
    """`of` with the normal of the surface displaced by `scale` times `height`, in scene units."""

    height: ImageTexture
    scale: float
    of: Bsdf


class HeightKind:
    """The name of an image texture."""

    def read(self, node: Located, context: Any = None) -> ImageTexture:
        texture = named_texture(node, context)
        if not isinstance(texture, ImageTexture):
            raise node.refuse("must be an image: a checkerboard has no slope")
        return texture

    def schema(self) -> dict[str, Any]:
        return NAMED


_BUMP = Record("A material whose normal is that of a displaced surface.", {
    "height": Key(HeightKind(), "Height of the surface, an image."),
    "scale": Key(NUMBER, "Factor of the height.", 1, unit="metres"),
    "of": _OF,
}, _wrapper(Bump))  # fmt: skip


@dataclass(frozen=True, slots=True)
class NormalMap:
    """`of` with the normal 2 c - 1, c a raw texel of `map`, in the frame of the surface."""

    map: Texture
    of: Bsdf


class MapKind:
    """The name of a texture of which the texels are normals."""

    def read(self, node: Located, context: Any = None) -> Texture:
        texture = named_texture(node, context)
        if node.value in context.images.srgb:
            raise node.refuse("its texels are sRGB-encoded, and those of a normal map are not: give it color_space: raw")
        return texture

    def schema(self) -> dict[str, Any]:
        return NAMED


_NORMAL_MAP = Record("A material whose normal an image gives.", {
    "map": Key(MapKind(), "Texture, of color_space raw, with texels c of the normals 2 c - 1, z along the surface's."),
    "of": _OF,
}, _wrapper(NormalMap))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Sides:
    """`front` where the surface is met from the side of its normal, else `back`; None is black."""

    front: Bsdf | None
    back: Bsdf | None


_SIDED = Key(InnerKind(), "A material, as in of, or nothing for a black side.", None)
_BY_SIDE = Record("One material on each side.", {"front": _SIDED, "back": _SIDED}, _wrapper(Sides))


Wrapper = Mask | Blend | Bump | NormalMap | Sides
Bsdf = (
    Mixture | Diffuse | Conductor | Dielectric | ThinDielectric | Plastic | Principled | Null | CustomBSDF
    | Mask | Blend | Bump | NormalMap | Sides
)  # fmt: skip


def leaves(bsdf: Bsdf | None) -> Iterator[Bsdf]:
    """The models of a BSDF below its wrappers, from left to right."""
    if bsdf is not None and not isinstance(bsdf, Wrapper):
        yield bsdf
    for inner in _inside(bsdf):
        yield from leaves(inner)


def is_opaque(bsdf: Bsdf) -> bool:
    """Whether no light passes a BSDF; of a plugin that is not known."""
    if isinstance(bsdf, Mask):
        return False
    if isinstance(bsdf, Wrapper):
        return all(inner is None or is_opaque(inner) for inner in _inside(bsdf))
    if isinstance(bsdf, Mixture):
        return bsdf.kt == BLACK
    if isinstance(bsdf, Principled):
        return bsdf.spec_trans == 0.0
    return not isinstance(bsdf, Dielectric | ThinDielectric | Null)


def textures(bsdf: Any) -> Iterator[Texture]:
    """The textures of a BSDF and of its wrappers, each as often as it stands there."""
    if isinstance(bsdf, Texture):
        yield bsdf
    elif isinstance(bsdf, tuple):
        for part in bsdf:
            yield from textures(part)
    elif is_dataclass(bsdf) and not isinstance(bsdf, CustomBSDF):
        for item in fields_of(bsdf):
            yield from textures(getattr(bsdf, item.name))


def uses_uvs(bsdf: Bsdf | None) -> bool:
    """Whether light depends on texture coordinates: by a texture, or by an anisotropic model, whose tangent follows them."""
    return any(True for _ in textures(bsdf)) or any(map(_anisotropic, leaves(bsdf)))


def _anisotropic(leaf: Bsdf) -> bool:
    if isinstance(leaf, Conductor | Dielectric):
        return leaf.alpha[0] != leaf.alpha[1]
    return isinstance(leaf, Principled) and leaf.anisotropic != 0.0


MODELS = {
    "diffuse": _DIFFUSE,
    "conductor": _CONDUCTOR,
    "dielectric": _DIELECTRIC,
    "thin_dielectric": _THIN_DIELECTRIC,
    "plastic": _PLASTIC,
    "principled": _PRINCIPLED,
    "null": _NULL,
    "mask": _MASK,
    "blend": _BLEND,
    "bump": _BUMP,
    "normal_map": _NORMAL_MAP,
    "by_side": _BY_SIDE,
    "plugin": PluginKind("BSDF", "A BSDF of one's own; loaded with --allow-imports alone.", CustomBSDF),
}
