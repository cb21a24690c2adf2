"""Materials as rows: the parameters of each one's BSDF model, and its emission."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.features import SceneFeatures
from engines.kernels.lane.bsdf import mixture
from engines.kernels.layout import MaterialRow
from engines.scene.model import Material

MIXTURE = 0


class BSDFModel(NamedTuple):
    """A BSDF model in kernels."""

    parameters: Callable[[Material], list[float]]
    """Its numbers, at most BSDF_PARAMETERS."""
    features: Callable[[Material], dict[str, bool]]
    """Which features of a scene a material of this model brings."""
    columns: Callable[[SceneFeatures], tuple[int, ...]]
    """Which of the numbers are read, where a scene holds these features."""
    lane: Callable[[SceneFeatures], Any]
    """Its lane functions (`engines.kernels.lane.bsdf.interface.BSDF`), for a scene of these features."""


def _mixture_parameters(material: Material) -> list[float]:
    return [*material.kd, *material.ks, *material.kt, material.ior, float(material.fresnel)]


def _mixture_features(material: Material) -> dict[str, bool]:
    return {
        "diffuse": max(material.kd) > 0,
        "specular_reflection": max(material.ks) > 0,
        "specular_transmission": max(material.kt) > 0,
    }


MODELS: dict[int, BSDFModel] = {
    MIXTURE: BSDFModel(_mixture_parameters, _mixture_features, mixture.columns, mixture.make),
}


def model_of(material: Material) -> int:
    """The kind of a material's BSDF model."""
    return MIXTURE


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
