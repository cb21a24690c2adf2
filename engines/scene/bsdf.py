"""BSDF models of materials: what engines get of each, and beside it the keys of a scene file. One is an entry of `MODELS`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from dataclasses import fields as fields_of
from typing import Any

from engines.scene.metals import METALS
from engines.scene.plugins import PluginKind, all_options
from engines.scene.textures import Color, ImageTexture, Number, Texture
from engines.scene.triple import BLACK, WHITE, Triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import Kind, color, one_of, within
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


def _alpha(node: Located) -> tuple[float, float]:
    """A number, or [along the first tangent, along the second]: both 0, or both in [SMOOTHEST, 1]."""
    items = node.value if isinstance(node.value, list) else [node]
    if isinstance(node.value, list) and len(items) != 2:
        raise node.refuse("must be a number, or two")
    found = [fields.number(item) for item in items]
    for item in items if any(found) else ():
        if not SMOOTHEST <= item.value <= 1.0:
            raise item.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
    return found[0], found[-1]


_ROUGHNESS = within(0, 1).json
ALPHA = Key(
    Kind(_alpha, {"anyOf": [_ROUGHNESS, {"type": "array", "items": _ROUGHNESS, "minItems": 2, "maxItems": 2}]}),
    f"GGX roughness, or two along the tangents; 0 is smooth, else at least {SMOOTHEST:g}.", 0,
)  # fmt: skip
DISTRIBUTION = Key(one_of(("ggx",), "distribution"), "Distribution of the microfacets' normals.", "ggx")


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
        return Conductor(BLACK, WHITE, given["alpha"], given["reflectance"])  # Fresnel's equations give 1
    eta, k = METALS[given["metal"]] if given["metal"] else (given["eta"], given["k"])
    for channel, larger in zip(("red", "green", "blue"), map(max, eta, k), strict=True):
        if not INDICES[0] <= larger <= INDICES[1]:
            limits = f"[{INDICES[0]:g}, {INDICES[1]:g}]"
            raise given.node.refuse(f"the larger of eta and k is {larger:g} in {channel}: must lie in {limits}")
    return Conductor(eta, k, given["alpha"], given["specular_reflectance"])


_CONDUCTOR = Record("A metal with GGX microfacets: its name, or eta and k, or its reflectance alone.", {
    "metal": Key(one_of(METALS, "metal"), "Chemical symbol of the metal, for its eta and k.", None),
    "eta": Key(color(), "Real part of the complex index of refraction.", None),
    "k": Key(color(), "Imaginary part of the complex index of refraction.", None),
    "reflectance": Key(color(1), "Reflectance at every angle, instead of Fresnel's equations.", None),
    "alpha": ALPHA,
    "distribution": DISTRIBUTION,
    "specular_reflectance": Key(color(1), "Factor of the reflectance that follows from metal, or from eta and k.", 1),
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


@dataclass(frozen=True, slots=True)
class ThinDielectric:
    """A pane without thickness: what passes goes straight on, reflections between its faces included."""

    ior: float = 1.5
    reflectance: Color = WHITE
    transmittance: Color = WHITE


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


@dataclass(frozen=True, slots=True)
class Null:
    """Nothing: every ray goes straight on."""


@dataclass(frozen=True, slots=True)
class Mask:
    """`of`, where a share `opacity` of it is there; the rest lets rays pass straight on. Emission is not scaled."""

    opacity: Number
    of: Bsdf


@dataclass(frozen=True, slots=True)
class Blend:
    """A share `weight` of `b` and the rest of `a`."""

    weight: Number
    a: Bsdf
    b: Bsdf


@dataclass(frozen=True, slots=True)
class Bump:
    """`of` with the normal of the surface displaced by `scale` times `height`, in scene units."""

    height: ImageTexture
    scale: float
    of: Bsdf


@dataclass(frozen=True, slots=True)
class NormalMap:
    """`of` with the normal 2 c - 1, c a raw texel of `map`, in the frame of the surface."""

    map: Texture
    of: Bsdf


@dataclass(frozen=True, slots=True)
class Sides:
    """`front` where the surface is met from the side of its normal, else `back`; None is black."""

    front: Bsdf | None
    back: Bsdf | None


Wrapper = Mask | Blend | Bump | NormalMap | Sides
Bsdf = (
    Mixture | Diffuse | Conductor | Dielectric | ThinDielectric | Plastic | Principled | Null | CustomBSDF
    | Mask | Blend | Bump | NormalMap | Sides
)  # fmt: skip


def leaves(bsdf: Bsdf | None) -> Iterator[Bsdf]:
    """The models of a BSDF below its wrappers, from left to right."""
    if isinstance(bsdf, Blend):
        yield from leaves(bsdf.a)
        yield from leaves(bsdf.b)
    elif isinstance(bsdf, Sides):
        yield from leaves(bsdf.front)
        yield from leaves(bsdf.back)
    elif isinstance(bsdf, Mask | Bump | NormalMap):
        yield from leaves(bsdf.of)
    elif bsdf is not None:
        yield bsdf


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
    "conductor": _CONDUCTOR,
    "plugin": PluginKind("BSDF", "A BSDF of one's own; loaded with --allow-imports alone.", CustomBSDF),
}
