"""BSDF models in kernels: the parameters of each leaf, and the features that it brings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.lookups import Lookup, color_parameters, number_parameter
from engines.kernels.flatten.plugins import bsdf_functions, kind_of
from engines.kernels.lane.bsdf import conductor, mixture
from engines.kernels.lane.bsdf.interface import LaneBSDF
from engines.scene import Color, Conductor, CustomBSDF, Material, Mixture
from engines.scene.support import option_numbers

MIXTURE, CONDUCTOR = range(2)
SMOOTHEST = 1e-4
"""The least roughness that a texture gives."""


class BSDFModel(NamedTuple):
    """A BSDF model in kernels. A *leaf* is a dataclass of `engines.scene` that is a model itself, and no wrapper."""

    parameters: Callable[[Any], list[float | Lookup]]
    """The numbers of a leaf, at most BSDF_PARAMETERS."""
    features: Callable[[Any], dict[str, bool]]
    """Which features of a scene a leaf of this model brings."""
    columns: Callable[[SceneFeatures], tuple[int, ...]]
    """Which of the numbers are read, where a scene holds these features."""
    lane: Callable[[SceneFeatures], Any]
    """Its lane functions (`engines.kernels.lane.bsdf.interface.LaneBSDF`), for a scene of these features."""


def _positive(color: Color) -> bool:
    """Whether a colour may be above 0 in some channel."""
    return not isinstance(color, tuple) or max(color) > 0


def _mixture_parameters(leaf: Mixture) -> list[float | Lookup]:
    colors = (parameter for color in (leaf.kd, leaf.ks, leaf.kt) for parameter in color_parameters(color))
    return [*colors, leaf.ior, float(leaf.fresnel)]


def _mixture_features(leaf: Mixture) -> dict[str, bool]:
    return {
        "diffuse": _positive(leaf.kd),
        "specular_reflection": _positive(leaf.ks),
        "specular_transmission": _positive(leaf.kt),
    }


def _conductor_parameters(leaf: Conductor) -> list[float | Lookup]:
    return [*leaf.eta, *leaf.k, *color_parameters(leaf.reflectance), *_roughnesses(leaf.alpha)]


def _conductor_features(leaf: Conductor) -> dict[str, bool]:
    return {"specular_reflection": _smooth(leaf.alpha), "tangents": _anisotropic(leaf.alpha)}


def _smooth(alpha: tuple[Any, Any]) -> bool:
    return all(isinstance(a, int | float) and a == 0 for a in alpha)


def _anisotropic(alpha: tuple[Any, Any]) -> bool:
    along, across = alpha
    return along is not across and along != across


def _roughnesses(alpha: tuple[Any, Any]) -> list[float | Lookup]:
    return [number_parameter(a, SMOOTHEST, 1.0) for a in alpha]


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
    Mixture: lambda leaf: MIXTURE,
    Conductor: lambda leaf: CONDUCTOR,
    CustomBSDF: _plugin_kind,
}
"""The model of each type of leaf."""


def leaf_of(material: Material) -> Any:
    """A material's BSDF; the `Mixture` of its lobes where it has none."""
    if material.bsdf is not None:
        return material.bsdf
    return Mixture(material.kd, material.ks, material.kt, material.ior, material.fresnel)


def model_of(leaf: Any) -> int:
    """The kind of a leaf's model."""
    return KINDS[type(leaf)](leaf)


def parameters_of(leaf: Any) -> list[float | Lookup]:
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
