"""BSDF models in kernels: the parameters of each leaf of a material, and the features that it brings."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.lookups import Lookup, color_parameters, number_parameter
from engines.kernels.flatten.plugins import bsdf_functions, kind_of
from engines.kernels.lane.bsdf import conductor, mixture
from engines.kernels.lane.bsdf.interface import LaneBSDF
from engines.scene import Color, Conductor, CustomBSDF, Diffuse, Material, Mixture
from engines.scene.support import option_numbers

MIXTURE, CONDUCTOR = range(2)


class BSDFModel(NamedTuple):
    """A BSDF model in kernels."""

    parameters: Callable[[Any], list[float | Lookup]]
    """Of a leaf, which is a BSDF of the scene: its numbers, at most BSDF_PARAMETERS."""
    features: Callable[[Any], dict[str, bool]]
    """Which features of a scene a leaf of this model brings."""
    columns: Callable[[SceneFeatures], tuple[int, ...]]
    """Which of the numbers are read, where a scene holds these features."""
    lane: Callable[[SceneFeatures], Any]
    """Its lane functions (`engines.kernels.lane.bsdf.interface.LaneBSDF`), for a scene of these features."""


def _present(color: Color) -> bool:
    """Whether some channel may be above 0."""
    return not isinstance(color, tuple) or max(color) > 0


def _mixture_parameters(leaf: Mixture | Diffuse) -> list[float | Lookup]:
    if isinstance(leaf, Diffuse):
        leaf = Mixture(leaf.reflectance)
    colors = (color_parameters(color) for color in (leaf.kd, leaf.ks, leaf.kt))
    return [*(number for color in colors for number in color), leaf.ior, float(leaf.fresnel)]


def _mixture_features(leaf: Mixture | Diffuse) -> dict[str, bool]:
    if isinstance(leaf, Diffuse):
        leaf = Mixture(leaf.reflectance)
    return {
        "diffuse": _present(leaf.kd),
        "specular_reflection": _present(leaf.ks),
        "specular_transmission": _present(leaf.kt),
    }


def _conductor_parameters(leaf: Conductor) -> list[float | Lookup]:
    alpha = (number_parameter(value, 1e-4) if not isinstance(value, int | float) else float(value) for value in leaf.alpha)
    return [*leaf.eta, *leaf.k, *color_parameters(leaf.reflectance), *alpha]


def _conductor_features(leaf: Conductor) -> dict[str, bool]:
    along, across = leaf.alpha
    return {"specular_reflection": along == 0, "tangents": along is not across and along != across}


MODELS: dict[int, BSDFModel] = {
    MIXTURE: BSDFModel(_mixture_parameters, _mixture_features, mixture.columns, mixture.make),
    CONDUCTOR: BSDFModel(_conductor_parameters, _conductor_features, conductor.columns, conductor.make),
}
"""By kind; those of plugins are added where a scene has them."""


@cache
def _plugin_model(functions: Any, n: int, reflection: bool, transmission: bool, tangents: bool) -> BSDFModel:
    lane, columns = bsdf_functions(LaneBSDF(*functions), reflection, transmission), tuple(range(n))
    features = {
        "specular_reflection": reflection, "specular_transmission": transmission, "tangents": tangents, "lobes": True,
    }  # fmt: skip

    def parameters(leaf: CustomBSDF) -> list[float | Lookup]:
        return [*option_numbers(leaf.options)]

    return BSDFModel(parameters, lambda leaf: features, lambda features: columns, lambda features: lane)


def _plugin_kind(bsdf: CustomBSDF) -> int:
    plugin, n = bsdf.plugin, len(option_numbers(bsdf.options))
    flags = (getattr(plugin, name, False) for name in ("specular_reflection", "specular_transmission", "tangents"))
    return kind_of(MODELS, plugin.name, _plugin_model(plugin.jitted, n, *map(bool, flags)))


KINDS: dict[type, Callable[[Any], int]] = {
    Mixture: lambda bsdf: MIXTURE,
    Diffuse: lambda bsdf: MIXTURE,
    Conductor: lambda bsdf: CONDUCTOR,
    CustomBSDF: _plugin_kind,
}
"""The model of each type of leaf."""


def leaf_of(material: Material) -> Any:
    """The material's BSDF; of one that has kd, ks and kt these."""
    if material.bsdf is not None:
        return material.bsdf
    return Mixture(material.kd, material.ks, material.kt, material.ior, material.fresnel)


def model_of(leaf: Any) -> int:
    """The kind of a leaf's model."""
    return KINDS[type(leaf)](leaf)
