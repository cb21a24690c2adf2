"""BSDF models in kernels: the parameters of each leaf, and the features that it brings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.lookups import Parameter, Table, color_parameters, number_parameter
from engines.kernels.flatten.plugins import bsdf_functions, kind_of
from engines.kernels.flatten.rough_coats import diffuse_reflectance, rough_coat
from engines.kernels.lane.bsdf import conductor, dielectric, mixture, null, plastic, principled, sheen
from engines.kernels.lane.bsdf.interface import LaneBSDF
from engines.kernels.lane.microfacet import BECKMANN, GGX
from engines.scene import (
    Checkerboard,
    Color,
    Conductor,
    CustomBSDF,
    Dielectric,
    Diffuse,
    ImageTexture,
    MeshAttribute,
    Mixture,
    Null,
    Number,
    Plastic,
    Principled,
    Sheen,
    ThinDielectric,
)
from engines.scene.bsdf_tree import anisotropic
from engines.scene.support import option_numbers

(
    MIXTURE,
    CONDUCTOR,
    BECKMANN_CONDUCTOR,
    SMOOTH_DIELECTRIC,
    GGX_DIELECTRIC,
    BECKMANN_DIELECTRIC,
    THIN_DIELECTRIC,
    SMOOTH_PLASTIC,
    GGX_PLASTIC,
    BECKMANN_PLASTIC,
    PRINCIPLED,
    SHEEN,
    NULL,
) = range(13)
SMOOTHEST = 1e-4
"""The least roughness that a texture gives."""


class BSDFModel(NamedTuple):
    """A BSDF model in kernels. A *leaf* is a dataclass of `engines.scene` that is a model itself, and no wrapper."""

    parameters: Callable[[Any], list[Parameter]]
    """The numbers of a leaf, at most BSDF_PARAMETERS."""
    features: Callable[[Any], dict[str, bool]]
    """Which features of a scene a leaf of this model brings."""
    columns: Callable[[SceneFeatures], tuple[int, ...]]
    """Which of the numbers are read, where a scene holds these features."""
    lane: Callable[[SceneFeatures], Any]
    """Its lane functions (`engines.kernels.lane.bsdf.interface.LaneBSDF`), for a scene of these features."""


def _fixed(
    parameters: Callable[[Any], list[Parameter]],
    features: Callable[[Any], dict[str, bool]],
    read: Iterable[int],
    lane: LaneBSDF | Callable[[SceneFeatures], LaneBSDF],
) -> BSDFModel:
    """A model that reads the same numbers in every scene."""
    columns = tuple(read)
    of_scene = (lambda features: lane) if isinstance(lane, LaneBSDF) else lane
    return BSDFModel(parameters, features, lambda features: columns, of_scene)


def _is_constant(value: Color | Number, wanted: float) -> bool:
    """Whether it is this number, or this in every channel, and no texture."""
    values = value if isinstance(value, tuple) else (value,)
    return all(isinstance(x, int | float) and x == wanted for x in values)


def _roughnesses(alpha: tuple[Number, Number]) -> list[Parameter]:
    return [number_parameter(a, SMOOTHEST, 1.0) for a in alpha]


def _colors(*colors: Color) -> list[Parameter]:
    return [parameter for color in colors for parameter in color_parameters(color)]


# ---- kd, ks, kt --------------------------------------------------------------------------------------------------------


def _mixture_parameters(leaf: Mixture | Diffuse) -> list[Parameter]:
    if isinstance(leaf, Diffuse):
        leaf = Mixture(leaf.reflectance)
    return [*_colors(leaf.kd, leaf.ks, leaf.kt), leaf.ior, float(leaf.fresnel)]


def _mixture_features(leaf: Mixture | Diffuse) -> dict[str, bool]:
    if isinstance(leaf, Diffuse):
        leaf = Mixture(leaf.reflectance)
    ks, kt = not _is_constant(leaf.ks, 0), not _is_constant(leaf.kt, 0)
    return {
        "diffuse": not _is_constant(leaf.kd, 0),
        "mirror": ks,
        "refraction": kt,
        "specular_reflection": ks,
        "specular_transmission": kt,
    }


# ---- metal and glass ---------------------------------------------------------------------------------------------------


def _conductor_parameters(leaf: Conductor) -> list[Parameter]:
    return [*leaf.eta, *leaf.k, *_colors(leaf.reflectance), *_roughnesses(leaf.alpha)]


def _conductor_features(leaf: Conductor) -> dict[str, bool]:
    return {"specular_reflection": _is_constant(leaf.alpha, 0), "tangents": anisotropic(leaf)}


def _dielectric_parameters(leaf: Dielectric | ThinDielectric) -> list[Parameter]:
    alpha = leaf.alpha if isinstance(leaf, Dielectric) else (0.0, 0.0)
    return [leaf.ior, *_roughnesses(alpha), *_colors(leaf.reflectance, leaf.transmittance)]


def _smooth_dielectric_features(leaf: Dielectric | ThinDielectric) -> dict[str, bool]:
    return {"specular_reflection": True, "specular_transmission": True}


def _rough_dielectric_features(leaf: Dielectric) -> dict[str, bool]:
    return {"lobes": True, "transmission": True, "tangents": anisotropic(leaf)}


# ---- plastic -----------------------------------------------------------------------------------------------------------


def _mean(color: Color) -> float:
    """Over the channels; of an image also over its texels, as they are read; of an attribute half its scale."""
    if isinstance(color, MeshAttribute):
        return min(0.5 * color.scale, 1.0)
    if isinstance(color, ImageTexture):
        return float(np.clip(color.pixels, 0.0, 1.0).mean(dtype=np.float64))
    return float(np.clip([color.a, color.b], 0.0, 1.0).mean() if isinstance(color, Checkerboard) else np.mean(color))


def _plastic_parameters(leaf: Plastic) -> list[Parameter]:
    specular, diffuse = _mean(leaf.reflectance), _mean(leaf.diffuse)
    share = specular / (specular + diffuse) if specular + diffuse > 0 else 0.0
    colors = _colors(leaf.diffuse, leaf.reflectance)
    if leaf.alpha == 0:
        return [*colors, leaf.ior, 0.0, diffuse_reflectance(leaf.ior), share, float(leaf.nonlinear)]
    coat = rough_coat(leaf.ior, leaf.alpha, leaf.distribution)
    table = Table(coat.transmittance)
    return [*colors, leaf.ior, leaf.alpha, coat.reflected_inside, share, float(leaf.nonlinear), table]


def _plastic_features(leaf: Plastic) -> dict[str, bool]:
    return {"specular_reflection": leaf.alpha == 0, "lobes": True}


# ---- principled --------------------------------------------------------------------------------------------------------


def _principled_parameters(leaf: Principled) -> list[Parameter]:
    opaque = _is_constant(leaf.spec_trans, 0)
    eta = 1.001 if leaf.eta == 1 and not opaque else leaf.eta
    before = (leaf.roughness, leaf.anisotropic, leaf.metallic)
    after = (leaf.spec_tint, leaf.sheen, leaf.sheen_tint, leaf.clearcoat, leaf.clearcoat_gloss, leaf.flatness)
    return [
        *_colors(leaf.base_color),
        *map(number_parameter, before),
        eta,
        *map(number_parameter, after),
        -1.0 if opaque else number_parameter(leaf.spec_trans),
    ]


def _principled_features(leaf: Principled) -> dict[str, bool]:
    transmits = not _is_constant(leaf.spec_trans, 0)
    return {
        "lobes": True,
        "transmission": transmits,
        "spec_trans": transmits,
        "clearcoat": not _is_constant(leaf.clearcoat, 0),
        "tangents": anisotropic(leaf),
    }


# ---- the registry ------------------------------------------------------------------------------------------------------


def _metal(kind: Any) -> BSDFModel:
    return _fixed(_conductor_parameters, _conductor_features, range(conductor.PARAMETERS), conductor.maker(kind))


def _clear(lane: LaneBSDF) -> BSDFModel:
    return _fixed(_dielectric_parameters, _smooth_dielectric_features, (0, *range(3, dielectric.PARAMETERS)), lane)


def _frosted(kind: Any) -> BSDFModel:
    read = range(dielectric.PARAMETERS)
    return _fixed(_dielectric_parameters, _rough_dielectric_features, read, dielectric.maker(kind))


def _matt_plastic(kind: Any) -> BSDFModel:
    return _fixed(_plastic_parameters, _plastic_features, range(plastic.PARAMETERS), plastic.maker(kind))


MODELS: dict[int, BSDFModel] = {
    MIXTURE: BSDFModel(_mixture_parameters, _mixture_features, mixture.columns, mixture.make),
    CONDUCTOR: _metal(GGX),
    BECKMANN_CONDUCTOR: _metal(BECKMANN),
    SMOOTH_DIELECTRIC: _clear(dielectric.SMOOTH),
    GGX_DIELECTRIC: _frosted(GGX),
    BECKMANN_DIELECTRIC: _frosted(BECKMANN),
    THIN_DIELECTRIC: _clear(dielectric.THIN),
    SMOOTH_PLASTIC: _fixed(_plastic_parameters, _plastic_features, range(plastic.PARAMETERS - 1), plastic.SMOOTH),
    GGX_PLASTIC: _matt_plastic(GGX),
    BECKMANN_PLASTIC: _matt_plastic(BECKMANN),
    PRINCIPLED: _fixed(_principled_parameters, _principled_features, range(principled.PARAMETERS), principled.make),
    SHEEN: _fixed(lambda leaf: _colors(leaf.color), lambda leaf: {}, range(sheen.PARAMETERS), sheen.SHEEN),
    NULL: _fixed(lambda leaf: [], lambda leaf: {"specular_transmission": True}, (), null.NULL),
}
"""By kind; those of plugins are added where a scene has them."""


@cache
def _plugin_model(
    functions: Any, n: int, specular_reflection: bool, specular_transmission: bool, transmission: bool, tangents: bool
) -> BSDFModel:
    columns = tuple(range(n))
    features = {
        "specular_reflection": specular_reflection,
        "specular_transmission": specular_transmission,
        "transmission": transmission,
        "tangents": tangents,
        "lobes": True,
    }

    def parameters(leaf: CustomBSDF) -> list[Parameter]:
        return [*option_numbers(leaf.options)]

    def lane(features: SceneFeatures) -> LaneBSDF:
        above = features.transmission and not transmission
        return bsdf_functions(LaneBSDF(*functions), specular_reflection, specular_transmission, above)

    return BSDFModel(parameters, lambda leaf: features, lambda features: columns, lane)


PLUGIN_FLAGS = "specular_reflection", "specular_transmission", "transmission", "tangents"


def _plugin_kind(leaf: CustomBSDF) -> int:
    plugin, n = leaf.plugin, len(option_numbers(leaf.options))
    flags = (bool(getattr(plugin, name, False)) for name in PLUGIN_FLAGS)
    return kind_of(MODELS, plugin.name, _plugin_model(plugin.jitted, n, *flags))


def _by_distribution(leaf: Any, ggx: int, beckmann: int) -> int:
    return {"ggx": ggx, "beckmann": beckmann}[leaf.distribution]


def _conductor_kind(leaf: Conductor) -> int:
    if _is_constant(leaf.alpha, 0):
        return CONDUCTOR
    return _by_distribution(leaf, CONDUCTOR, BECKMANN_CONDUCTOR)


def _dielectric_kind(leaf: Dielectric) -> int:
    if _is_constant(leaf.alpha, 0):
        return SMOOTH_DIELECTRIC
    return _by_distribution(leaf, GGX_DIELECTRIC, BECKMANN_DIELECTRIC)


def _plastic_kind(leaf: Plastic) -> int:
    if leaf.alpha == 0:
        return SMOOTH_PLASTIC
    return _by_distribution(leaf, GGX_PLASTIC, BECKMANN_PLASTIC)


KINDS: dict[type, Callable[[Any], int]] = {
    Mixture: lambda leaf: MIXTURE,
    Diffuse: lambda leaf: MIXTURE,
    Conductor: _conductor_kind,
    Dielectric: _dielectric_kind,
    ThinDielectric: lambda leaf: THIN_DIELECTRIC,
    Plastic: _plastic_kind,
    Principled: lambda leaf: PRINCIPLED,
    Sheen: lambda leaf: SHEEN,
    Null: lambda leaf: NULL,
    CustomBSDF: _plugin_kind,
}
"""The model of each type of leaf."""


def transmittance_of(kind: int) -> Any:
    """The lane function of a model whose transmission is a null lobe, None of the others."""
    return MODELS[kind].lane(SceneFeatures()).transmittance


def model_of(leaf: Any) -> int:
    """The kind of a leaf's model."""
    return KINDS[type(leaf)](leaf)


def parameters_of(leaf: Any) -> list[Parameter]:
    """The numbers of a leaf, as its model reads them."""
    return MODELS[model_of(leaf)].parameters(leaf)


def leaf_features(leaves: Iterable[Any]) -> dict[str, Any]:
    """The features that these leaves bring."""
    leaves = list(leaves)
    found: dict[str, Any] = {"bsdfs": tuple(sorted({model_of(leaf) for leaf in leaves}))}
    for leaf in leaves:
        for name, held in MODELS[model_of(leaf)].features(leaf).items():
            found[name] = found.get(name, False) or held
    return found
