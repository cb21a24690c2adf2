"""BSDF models that scatter light by themselves: what engines get of each, and beside it the keys of a scene file.

`transmission` of each is the factor of what passes it: BLACK, or 0, where the model never transmits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from engines.scene.metals import METALS
from engines.scene.plugins import PluginKind, all_options
from engines.scene.textures import Color, Number, Texture, named_texture, textured_color, textured_number
from engines.scene.triple import BLACK, WHITE, Triple, triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, ContextKind, Kind, array_of, color, one_of, within
from engines.schema.yaml_file import Located

__all__ = [
    "Conductor",
    "CustomBSDF",
    "Dielectric",
    "Diffuse",
    "Mixture",
    "Null",
    "Plastic",
    "Principled",
    "Sheen",
    "ThinDielectric",
]

SMOOTHEST = 1e-4
"""The least roughness above 0, as in Mitsuba."""
INDICES = (1e-6, 1e6)
"""Between which the larger of eta and k lies. At normal incidence Fresnel's equations have their fourth powers as terms, which
leave float32 beyond these limits; where both are 0, they are 0/0."""
IORS = (0.01, 100.0)
LEAST_CONTRAST = 1e-3
"""Least distance of a rough interface's ior from 1, where refracted light has no half vector."""
TOO_LITTLE_CONTRAST = f"a rough interface needs an index at least {LEAST_CONTRAST:g} away from 1"
PLASTIC_IORS = (1.0, 3.0)
"""Where the diffuse reflectance of the inside, a fit, lies below 1."""


def _alpha(node: Located, context: Any) -> tuple[Number, Number]:
    """A number or a texture, or two of them, [along the first tangent, along the second]: numbers are both 0, or none is less
    than SMOOTHEST."""
    items = node.value if isinstance(node.value, list) else [node]
    if isinstance(node.value, list) and len(items) != 2:
        raise node.refuse("must be a number, or two")
    alphas = [named_texture(item, context) if isinstance(item.value, str) else fields.number(item) for item in items]
    for item, alpha in zip(items, alphas, strict=True):
        if any(alphas) and not isinstance(alpha, Texture) and not SMOOTHEST <= alpha <= 1.0:
            raise item.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
    return alphas[0], alphas[-1]


def _plain_alpha(node: Located) -> float:
    alpha = fields.number(node)
    if alpha != 0.0 and not SMOOTHEST <= alpha <= 1.0:
        raise node.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
    return alpha


ROUGHNESS = textured_number(0, 1)
SHARE = textured_color(1)
_ONE = ROUGHNESS.json["anyOf"]
ALPHA = Key(
    ContextKind(_alpha, {"anyOf": [*_ONE, array_of({"anyOf": _ONE}, 2)]}),
    f"Roughness of the microfacets, or two along the tangents; 0 is smooth, else at least {SMOOTHEST:g}.",
    0,
)
DISTRIBUTION = Key(one_of(("ggx", "beckmann"), "distribution"), "Distribution of the microfacets' normals.", "ggx")
_REFLECTED = Key(SHARE, "Factor of what is reflected by the interface.", 1)
_TRANSMITTED = Key(SHARE, "Factor of what passes the interface.", 1)
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
    transmission = BLACK

    @property
    def albedo(self) -> Triple:
        """The share of light that a smooth surface of constant reflectance reflects at normal incidence."""
        assert isinstance(self.reflectance, tuple)
        return triple(
            scale * ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)
            for eta, k, scale in zip(self.eta, self.k, self.reflectance, strict=True)
        )


def _conductor(given: Given, context: Any) -> Conductor:
    if given["reflectance"] is not None:
        if given.has("specular_reflectance"):
            raise given.node.refuse_key("specular_reflectance", "a factor of metal, or eta and k: reflectance is all there is")
        return Conductor(BLACK, WHITE, given["alpha"], given["reflectance"], given["distribution"])  # Fresnel gives 1
    eta, k = METALS[given["metal"]] if given["metal"] else (given["eta"], given["k"])
    if lacks := indices_lack(eta, k):
        raise given.node.refuse(lacks)
    return Conductor(eta, k, given["alpha"], given["specular_reflectance"], given["distribution"])


def indices_lack(eta: Triple, k: Triple) -> str | None:
    """What is wrong with the complex index of a metal, or None."""
    for channel, larger in zip(("red", "green", "blue"), map(max, eta, k), strict=True):
        if not INDICES[0] <= larger <= INDICES[1]:
            return f"the larger of eta and k is {larger:g} in {channel}: must lie in [{INDICES[0]:g}, {INDICES[1]:g}]"
    return None


CONDUCTOR = Record(
    "A metal, smooth or with microfacets: its name, or eta and k, or its reflectance alone.",
    {
        "metal": Key(one_of(METALS, "metal"), "Name of the metal, such as Au, for its eta and k.", None),
        "eta": Key(color(), "Real part of the complex index of refraction.", None),
        "k": Key(color(), "Imaginary part of the complex index of refraction.", None),
        "reflectance": Key(SHARE, "Reflectance at every angle, instead of Fresnel's equations.", None),
        "alpha": ALPHA,
        "distribution": DISTRIBUTION,
        "specular_reflectance": Key(SHARE, "Factor of the reflectance that follows from metal, or from eta and k.", 1),
    },
    _conductor,
    either=(("metal",), ("eta", "k"), ("reflectance",)),
)


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

    @property
    def transmission(self) -> Color:
        """The factor of what passes the surface."""
        return self.kt


@dataclass(frozen=True, slots=True)
class Diffuse:
    """Lambertian: f = reflectance / pi, on both sides."""

    reflectance: Color = (0.5, 0.5, 0.5)
    transmission = BLACK


DIFFUSE = Record(
    "A Lambertian surface.",
    {"reflectance": Key(SHARE, "Share of light that it returns.", 0.5)},
    lambda given, context: Diffuse(**given.values),
)


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
    transmission = WHITE


def _dielectric(given: Given, context: Any) -> Dielectric:
    rough = given["alpha"] != (0.0, 0.0)
    if rough and abs(given["ior"] - 1.0) < LEAST_CONTRAST:
        raise given.at("ior").refuse(TOO_LITTLE_CONTRAST)
    return Dielectric(
        given["ior"], given["alpha"], given["specular_reflectance"], given["specular_transmittance"], given["distribution"]
    )


DIELECTRIC = Record(
    "The interface of a transparent solid, smooth (glass) or with microfacets (frosted glass).",
    {
        "ior": IOR,
        "alpha": ALPHA,
        "distribution": DISTRIBUTION,
        "specular_reflectance": _REFLECTED,
        "specular_transmittance": _TRANSMITTED,
    },
    _dielectric,
)


@dataclass(frozen=True, slots=True)
class ThinDielectric:
    """A pane without thickness: what passes goes straight on, reflections between its faces included."""

    ior: float = 1.5
    reflectance: Color = WHITE
    transmittance: Color = WHITE
    transmission = WHITE


THIN_DIELECTRIC = Record(
    "A pane without thickness, as of a window: what passes goes straight on.",
    {"ior": IOR, "specular_reflectance": _REFLECTED, "specular_transmittance": _TRANSMITTED},
    lambda given, context: ThinDielectric(*given.values.values()),
)


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
    transmission = BLACK


PLASTIC = Record(
    "A diffuse base under a clear coat, smooth or with microfacets.",
    {
        "diffuse": Key(SHARE, "Reflectance of the base.", 0.5),
        "ior": Key(within(*PLASTIC_IORS), "Index of refraction of the coat, relative to the outside.", 1.49),
        "alpha": Key(
            Kind(_plain_alpha, within(0, 1).json), f"Roughness of the coat; 0 is smooth, else at least {SMOOTHEST:g}.", 0
        ),
        "nonlinear": Key(BOOLEAN, "Whether light that is reflected inside takes the base's colour each time.", False),
        "specular_reflectance": _REFLECTED,
        "distribution": DISTRIBUTION,
    },
    lambda given, context: Plastic(*given.values.values()),
)


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

    @property
    def transmission(self) -> Number:
        """The factor of what passes the surface."""
        return self.spec_trans


def principled_eta(specular: float, spec_trans: Number) -> float:
    """The index of refraction of which Disney's `specular` is the reflectance at normal incidence / 0.08. As in Mitsuba, 0
    stands for 0.001 where light is transmitted, and is no reflection elsewhere."""
    least = 1e-3 if spec_trans != 0.0 else 0.0
    return 2.0 / (1.0 - math.sqrt(0.08 * (specular or least))) - 1.0


def _principled(given: Given, context: Any) -> Principled:
    values = {key: value for key, value in given.values.items() if key != "specular"}
    if values["eta"] is None:
        values["eta"] = principled_eta(given["specular"], values["spec_trans"])
    elif given.has("specular"):
        raise given.node.refuse_key("specular", "either specular or eta")
    elif values["spec_trans"] != 0.0:
        values["eta"] = max(values["eta"], 1.001)
    return Principled(**values)


PRINCIPLED = Record(
    "Disney's BSDF (Burley 2012, 2015), as Mitsuba parameterises it.",
    {
        "base_color": Key(SHARE, "Colour of the surface.", 0.5),
        "roughness": Key(ROUGHNESS, "Roughness; alpha is about its square.", 0.5),
        "anisotropic": Key(ROUGHNESS, "How much longer highlights are along the first tangent.", 0),
        "metallic": Key(ROUGHNESS, "Share of a metal.", 0),
        "specular": Key(within(0, 1), "Strength of reflection at normal incidence; 1 is 0.08.", 0.5),
        "eta": Key(
            within(1, 100), "Index of refraction, instead of specular; at least 1.001 where light is transmitted.", None
        ),
        "spec_tint": Key(ROUGHNESS, "How much base_color tints the reflection.", 0),
        "sheen": Key(ROUGHNESS, "Strength of the sheen of cloth at grazing angles.", 0),
        "sheen_tint": Key(ROUGHNESS, "How much base_color tints the sheen.", 0),
        "clearcoat": Key(ROUGHNESS, "Strength of a clear coat on top.", 0),
        "clearcoat_gloss": Key(ROUGHNESS, "Gloss of the clear coat.", 0),
        "flatness": Key(ROUGHNESS, "Share of an approximation of subsurface scattering in the diffuse part.", 0),
        "spec_trans": Key(ROUGHNESS, "Share of a transparent solid.", 0),
    },
    _principled,
)


@dataclass(frozen=True, slots=True)
class Sheen:
    """The sheen of cloth at grazing angles (Burley 2012): f = color (1 - cos_d)^5 on both sides, cos_d the cosine between the
    light's direction and the half vector."""

    color: Color = WHITE
    transmission = BLACK


SHEEN = Record(
    "The sheen of cloth at grazing angles, as principled has it, by itself: strongest where light grazes towards the viewer.",
    {"color": Key(SHARE, "Colour of the sheen.", 1)},
    lambda given, context: Sheen(**given.values),
)


@dataclass(frozen=True, slots=True)
class Null:
    """Nothing: every ray goes straight on."""

    transmission = WHITE


NULL = Record("Nothing: every ray goes straight on.", {}, lambda given, context: Null())


Leaf = Mixture | Diffuse | Conductor | Dielectric | ThinDielectric | Plastic | Principled | Sheen | Null | CustomBSDF
LEAVES = {
    "diffuse": DIFFUSE,
    "conductor": CONDUCTOR,
    "dielectric": DIELECTRIC,
    "thin_dielectric": THIN_DIELECTRIC,
    "plastic": PLASTIC,
    "principled": PRINCIPLED,
    "sheen": SHEEN,
    "null": NULL,
    "plugin": PluginKind("BSDF", "Your own BSDF; loaded only with --allow-imports.", CustomBSDF),
}
