"""The fields of each model, as scene files and as Mitsuba call them: one table for all that write or read either.

`engines.scene.write` goes by keys, Mitsuba's adapter and the reader of its files by parameters, in both directions. `Mixture`
is no model of Mitsuba's: its lobes are, each by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from engines.scene.models import IORS, PLASTIC_IORS, Conductor, Dielectric, Diffuse, Null, Plastic, Principled, ThinDielectric
from engines.scene.textures import Texture
from engines.scene.triple import WHITE

BK7, ACRYLIC = 1.5046, 1.49
_GREY = (0.5, 0.5, 0.5)


class Kind(Enum):
    """How the value of a field is written in Mitsuba's terms, and read."""

    COLOR = auto()
    """A colour, or a texture of colours."""
    NUMBER = auto()
    """A number in [0, 1], or a texture of numbers."""
    FLAG = auto()
    SPECTRUM = auto()
    """A colour of any size, never a texture: `eta` or `k` of a metal, which a file may name instead."""
    IOR = auto()
    """An index of the inside over that of the outside: two parameters, `int_ior` and `ext_ior`."""
    ETA = auto()
    """An index, in place of which a file may have Disney's `specular`."""
    ROUGHNESS = auto()
    """A number, never a texture."""
    ROUGHNESSES = auto()
    """Two numbers or textures, along the tangents: the parameters `alpha_u` and `alpha_v`, or `alpha` for both."""
    DISTRIBUTION = auto()


@dataclass(frozen=True, slots=True)
class LeafField:
    """One field: its `name`, its `key` in a scene file, and the `parameter` of Mitsuba's plugin, with its `older` names.

    `default` is what Mitsuba takes where a file is silent, None where that depends on more. `of_rough` says that only the
    plugin with microfacets has it. `harmless` are parameters that change how it is sampled, and not what is seen. `limits`
    are those of an index.
    """

    name: str
    kind: Kind
    parameter: str
    default: Any = None
    key: str = ""
    older: tuple[str, ...] = ()
    of_rough: bool = False
    harmless: tuple[str, ...] = ()
    limits: tuple[float, float] = IORS


@dataclass(frozen=True, slots=True)
class LeafPlugin:
    """A model: its `key` in a scene file, Mitsuba's `plugin`, and `rough` where another one has microfacets.

    `fields` stand in the order in which Mitsuba's parameters are written.
    """

    key: str
    plugin: str
    fields: tuple[LeafField, ...] = ()
    rough: str | None = None

    @property
    def plugins(self) -> tuple[str, ...]:
        """The names of Mitsuba's plugins: `plugin`, and `rough` where there is one."""
        return (self.plugin,) if self.rough is None else (self.plugin, self.rough)

    def key_of(self, name: str) -> str:
        """The key of a field in a scene file."""
        return next(item.key or name for item in self.fields if item.name == name)

    def fields_of(self, plugin: str) -> tuple[LeafField, ...]:
        """Those that a plugin of Mitsuba's has: one of `plugin` and `rough`."""
        return tuple(item for item in self.fields if plugin == self.rough or not item.of_rough)

    def plugin_of(self, leaf: Any) -> str:
        """The plugin of Mitsuba's for a leaf: `rough` where it has any roughness."""
        return self.rough if self.rough is not None and is_rough(leaf) else self.plugin


def is_rough(leaf: Any) -> bool:
    """Whether a model has microfacets: any roughness but 0."""
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
    Null: LeafPlugin("null", "null"),
}
