"""What a model of reflection can do: three verbs on n points, in world directions. Both `wo` and `wi` lead away from them.

A new model is a module with a class that has these verbs, and a table: `BSDFS = {Mixture: MixtureBSDF}`.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntFlag
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, dot


class Lobes(IntFlag):
    """Parts of a BSDF, by where and how sharply they send light (BxDFFlags in pbrt)."""

    DIFFUSE_REFLECTION = 1
    GLOSSY_REFLECTION = 2
    SPECULAR_REFLECTION = 4
    SPECULAR_TRANSMISSION = 8
    NON_SPECULAR = DIFFUSE_REFLECTION | GLOSSY_REFLECTION
    """Lobes with a value and a density. The others are deltas, that only `sample` finds."""
    ALL = NON_SPECULAR | SPECULAR_REFLECTION | SPECULAR_TRANSMISSION


class BSDFSample(NamedTuple):
    """n scattered directions, one a point. No sample: `weight` is 0, whatever the rest says."""

    wi: Array
    """(3, n) unit."""
    weight: Array
    """(3, n) f |cos| / pdf, in the limit for a delta lobe. Where light is refracted, 1 / eta^2 is in it."""
    pdf: Array
    """(n,) per solid angle, inf for a delta lobe."""

    @classmethod
    def empty(cls, n: int) -> BSDFSample:
        """Samples that hold nothing yet."""
        return cls(np.zeros((3, n)), np.zeros((3, n)), np.zeros(n))

    def put(self, lanes: Indices | slice, wi: Array, weight: Array, pdf: Array) -> None:
        """Overwrites some of the samples."""
        self.wi[:, lanes], self.weight[:, lanes], self.pdf[lanes] = wi, weight, pdf


class BSDF(Protocol):
    """All BSDFs of a scene with the same model, m of them. `material` (n,) are places among them; the points `at` and
    their `wo` are in the `SurfaceInteraction`."""

    lobes: NDArray[np.int64]
    """(m,) the `Lobes` that each one has."""

    def __init__(self, leaves: Sequence[Any]) -> None:
        """The scene's dataclasses of this model."""

    def diffuse(self, material: Indices, at: SurfaceInteraction) -> Array:
        """(3, n) the albedo of the diffuse lobe, which ambient light multiplies."""
        ...

    def albedo(self, material: Indices, at: SurfaceInteraction) -> Array:
        """(3, n) the colour that the shader `albedo` shows; 0 for what only emits."""
        ...

    def sample(
        self, material: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """A direction each, in proportion to some density, as if the BSDF had only `lobes`: a lobe by `uc`, which is not
        used where there is one, and the direction by `u0` and `u1`, which delta lobes do not use."""
        ...

    def evaluate(self, material: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """(3, n) the value f(wo, wi) of the lobes that are no deltas, without the cosine."""
        ...

    def pdf(self, material: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """(n,) per solid angle, with which `sample` finds `wi` through a lobe that is no delta."""
        ...


def mirrored(at: SurfaceInteraction) -> Array:
    """(3, n) directions that a mirror shows at `wo`."""
    return 2.0 * dot(at.wo, at.normal) * at.normal - at.wo
