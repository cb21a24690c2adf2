"""Materials as rows: the parameters of each one's BSDF model, and its emission."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.plugins import bsdf_functions, kind_of
from engines.kernels.lane.bsdf import conductor, mixture
from engines.kernels.lane.bsdf.interface import LaneBSDF
from engines.kernels.layout import MaterialRow
from engines.scene import Conductor, CustomBSDF, Material
from engines.scene.support import option_numbers

MIXTURE, CONDUCTOR = range(2)


class BSDFModel(NamedTuple):
    """A BSDF model in kernels."""

    parameters: Callable[[Material], list[float]]
    """Its numbers, at most BSDF_PARAMETERS."""
    features: Callable[[Material], dict[str, bool]]
    """Which features of a scene a material of this model brings."""
    columns: Callable[[SceneFeatures], tuple[int, ...]]
    """Which of the numbers are read, where a scene holds these features."""
    lane: Callable[[SceneFeatures], Any]
    """Its lane functions (`engines.kernels.lane.bsdf.interface.LaneBSDF`), for a scene of these features."""


def _mixture_parameters(material: Material) -> list[float]:
    return [*material.kd, *material.ks, *material.kt, material.ior, float(material.fresnel)]


def _mixture_features(material: Material) -> dict[str, bool]:
    return {
        "diffuse": max(material.kd) > 0,
        "specular_reflection": max(material.ks) > 0,
        "specular_transmission": max(material.kt) > 0,
    }


def _conductor_parameters(material: Material) -> list[float]:
    metal = material.bsdf
    assert isinstance(metal, Conductor)
    return [*metal.eta, *metal.k, *metal.reflectance, *metal.alpha]


def _conductor_features(material: Material) -> dict[str, bool]:
    assert isinstance(material.bsdf, Conductor)
    along, across = material.bsdf.alpha
    return {"specular_reflection": along == 0, "tangents": along != across}


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

    def parameters(material: Material) -> list[float]:
        assert isinstance(material.bsdf, CustomBSDF)
        return option_numbers(material.bsdf.options)

    return BSDFModel(parameters, lambda material: features, lambda features: columns, lambda features: lane)


def _plugin_kind(bsdf: CustomBSDF) -> int:
    plugin, n = bsdf.plugin, len(option_numbers(bsdf.options))
    flags = (getattr(plugin, name, False) for name in ("specular_reflection", "specular_transmission", "tangents"))
    return kind_of(MODELS, plugin.name, _plugin_model(plugin.jitted, n, *map(bool, flags)))


KINDS: dict[type, Callable[[Any], int]] = {
    type(None): lambda bsdf: MIXTURE,
    Conductor: lambda bsdf: CONDUCTOR,
    CustomBSDF: _plugin_kind,
}
"""The model of each type of `Material.bsdf`."""


def model_of(material: Material) -> int:
    """The kind of a material's BSDF model."""
    return KINDS[type(material.bsdf)](material.bsdf)


def material_rows(materials: Iterable[Material]) -> NDArray[np.float64]:
    """(n, numbers of a row), at least one row."""
    rows = [
        MaterialRow.packed(
            bsdf=MODELS[model_of(m)].parameters(m), emission=m.emission, two_sided=m.two_sided, model=model_of(m)
        )
        for m in materials
    ]
    return np.array(rows or np.zeros((1, MaterialRow.size)))


def material_features(used: Iterable[Material]) -> dict[str, Any]:
    """The features that these materials bring."""
    used = list(used)
    found: dict[str, Any] = {
        "bsdfs": tuple(sorted({model_of(m) for m in used})),
        "emission": any(m.emits for m in used),
    }
    for material in used:
        for name, held in MODELS[model_of(material)].features(material).items():
            found[name] = found.get(name, False) or held
    return found
