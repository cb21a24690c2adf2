"""`LEAF_PLUGINS`: the names that the fields of each BSDF model have in scene files and in Mitsuba.

`engines.scene.write` writes the keys of scene files by it, `engines.peers.mitsuba` writes Mitsuba's parameters, and
`engines.scene.mitsuba_xml` reads them. `Mixture` is not in it: Mitsuba has its lobes as several BSDFs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from engines.scene.models import (
    IORS,
    PLASTIC_IORS,
    Conductor,
    Dielectric,
    Diffuse,
    Null,
    Plastic,
    Principled,
    Sheen,
    ThinDielectric,
)
from engines.scene.textures import Texture
from engines.scene.triple import WHITE

BK7, ACRYLIC = 1.5046, 1.49
_GREY = (0.5, 0.5, 0.5)


class Kind(Enum):
    """What a field holds, and how Mitsuba's parameters say it."""

    COLOR = auto()
    """A reflectance in [0, 1] for each channel, or a texture."""
    NUMBER = auto()
    """A number in [0, 1], or a texture."""
    FLAG = auto()
    """True or false."""
    SPECTRUM = auto()
    """Three numbers of at least 0: `eta` or `k` of a metal. A file may give the metal's name (`material`) instead."""
    IOR = auto()
    """The index of refraction of the inside over that of the outside. Mitsuba has both: `int_ior` and `ext_ior`."""
    ETA = auto()
    """An index of refraction. A file may give Disney's `specular` instead."""
    ROUGHNESS = auto()
    """A number: 0 for a smooth surface, or alpha of the microfacets."""
    ROUGHNESSES = auto()
    """Two numbers or textures, alpha along each tangent. Mitsuba has `alpha_u` and `alpha_v`, or `alpha` for both."""
    DISTRIBUTION = auto()
    """Of the microfacets: "ggx" or "beckmann"."""


@dataclass(frozen=True, slots=True)
class LeafField:
    """One field of a model: its name in Python, in scene files and in Mitsuba, and how its value is read."""

    name: str
    """Of the field of the dataclass in `engines.scene.models`."""
    kind: Kind
    parameter: str = ""
    """Its name in Mitsuba. `IOR` and `ROUGHNESSES` have other parameters besides."""
    default: Any = None
    """The value that Mitsuba takes if a file does not give the parameter. None if that depends on other parameters."""
    key: str = ""
    """Its name in scene files; empty if that is `name`."""
    older: tuple[str, ...] = ()
    """Names of the parameter in files of Mitsuba 0.x."""
    of_rough: bool = False
    """Whether only the plugin with microfacets has the parameter."""
    harmless: tuple[str, ...] = ()
    """Parameters beside it that the importer accepts and ignores: they change how Mitsuba samples, but not the image."""
    limits: tuple[float, float] = IORS
    """The lowest and the highest value of an `IOR`."""


@dataclass(frozen=True, slots=True)
class LeafPlugin:
    """One model: its `key` in scene files and its `plugin` in Mitsuba, or the plugins for smooth and for `rough` surfaces. None
    where Mitsuba has no such plugin.

    `fields` are in the order in which Mitsuba's parameters are written.
    """

    key: str
    plugin: str | None
    fields: tuple[LeafField, ...] = ()
    rough: str | None = None

    @property
    def plugins(self) -> tuple[str, ...]:
        """The names of Mitsuba's plugins: `plugin` and `rough`, where there are any."""
        return tuple(name for name in (self.plugin, self.rough) if name is not None)

    def key_of(self, name: str) -> str:
        """The key that a field has in scene files. Raises StopIteration for fields that the model does not have."""
        return next(item.key or name for item in self.fields if item.name == name)

    def fields_of(self, plugin: str | None) -> tuple[LeafField, ...]:
        """The fields that `plugin`, one of `plugins`, has as parameters."""
        return tuple(item for item in self.fields if plugin == self.rough or not item.of_rough)

    def plugin_of(self, leaf: Any) -> str | None:
        """The name of Mitsuba's plugin for a leaf: `rough` if the leaf has microfacets."""
        return self.rough if self.rough is not None and is_rough(leaf) else self.plugin


def is_rough(leaf: Any) -> bool:
    """Whether a BSDF has microfacets: an alpha that is a texture, or above 0."""
    alpha = getattr(leaf, "alpha", 0.0)
    return any(isinstance(value, Texture) or value > 0.0 for value in (alpha if isinstance(alpha, tuple) else (alpha,)))


def _factor(name: str) -> LeafField:
    specular = f"specular_{name}"
    weights = (f"{specular}_sampling_weight", "specular_sampling_weight", "sampling_weight")
    return LeafField(name, Kind.COLOR, specular, WHITE, specular, harmless=weights)


def _ior(glass: float, limits: tuple[float, float] = IORS) -> LeafField:
    return LeafField("ior", Kind.IOR, "int_ior", glass, limits=limits)


def _share(name: str, default: float = 0.0) -> LeafField:
    return LeafField(name, Kind.NUMBER, name, default)


_REFLECTANCE, _TRANSMITTANCE = _factor("reflectance"), _factor("transmittance")
_DISTRIBUTION = LeafField(
    "distribution", Kind.DISTRIBUTION, "distribution", "beckmann", of_rough=True, harmless=("sample_visible",)
)
_ALPHAS = LeafField("alpha", Kind.ROUGHNESSES, "alpha", 0.1, of_rough=True)
_RATES = ("diffuse_reflectance", "main_specular", "clearcoat", "spec_trans")

LEAF_PLUGINS: Mapping[type, LeafPlugin] = {
    Diffuse: LeafPlugin(
        "diffuse", "diffuse", (LeafField("reflectance", Kind.COLOR, "reflectance", _GREY, older=("diffuse_reflectance",)),)
    ),
    Conductor: LeafPlugin(
        "conductor",
        "conductor",
        (LeafField("eta", Kind.SPECTRUM, "eta"), LeafField("k", Kind.SPECTRUM, "k"), _REFLECTANCE, _DISTRIBUTION, _ALPHAS),
        "roughconductor",
    ),
    Dielectric: LeafPlugin(
        "dielectric", "dielectric", (_ior(BK7), _REFLECTANCE, _TRANSMITTANCE, _DISTRIBUTION, _ALPHAS), "roughdielectric"
    ),
    ThinDielectric: LeafPlugin("thin_dielectric", "thindielectric", (_ior(BK7), _REFLECTANCE, _TRANSMITTANCE)),
    Plastic: LeafPlugin(
        "plastic",
        "plastic",
        (
            LeafField("diffuse", Kind.COLOR, "diffuse_reflectance", _GREY, older=("reflectance",)),
            _ior(ACRYLIC, PLASTIC_IORS),
            LeafField("nonlinear", Kind.FLAG, "nonlinear", False),
            _REFLECTANCE,
            LeafField("alpha", Kind.ROUGHNESS, "alpha", 0.1, of_rough=True),
            _DISTRIBUTION,
        ),
        "roughplastic",
    ),
    Principled: LeafPlugin(
        "principled",
        "principled",
        (
            LeafField(
                "base_color", Kind.COLOR, "base_color", _GREY, harmless=tuple(f"{rate}_sampling_rate" for rate in _RATES)
            ),
            LeafField("eta", Kind.ETA, "eta"),
            _share("roughness", 0.5),
            _share("anisotropic"),
            _share("metallic"),
            _share("spec_tint"),
            _share("sheen"),
            _share("sheen_tint"),
            _share("clearcoat"),
            _share("clearcoat_gloss"),
            _share("flatness"),
            _share("spec_trans"),
        ),
    ),
    Sheen: LeafPlugin("sheen", None, (LeafField("color", Kind.COLOR),)),
    Null: LeafPlugin("null", "null"),
}
