"""What a model of reflection can do: three verbs on n points, in world directions. Both `wo` and `wi` lead away from them.

A new model is a module with a class that has these verbs, and a table: `BSDFS = {Mixture: MixtureBSDF}`.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntFlag
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, Mask, dot


class Lobes(IntFlag):
    """Parts of a BSDF, by where and how sharply they send light (BxDFFlags in pbrt)."""

    DIFFUSE_REFLECTION = 1
    GLOSSY_REFLECTION = 2
    SPECULAR_REFLECTION = 4
    SPECULAR_TRANSMISSION = 8
    """Light that goes straight on, too."""
    GLOSSY_TRANSMISSION = 16
    NON_SPECULAR = DIFFUSE_REFLECTION | GLOSSY_REFLECTION | GLOSSY_TRANSMISSION
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
    """All leaves of a scene with the same model, m of them. `member` (n,) are places among them; the points `at` and
    their `wo` are in the `SurfaceInteraction`.

    Verbs with a body here are inherited by models without such lobes.
    """

    lobes: NDArray[np.int64]
    """(m,) the `Lobes` that each leaf has."""

    def __init__(self, leaves: Sequence[Any]) -> None:
        """The scene's leaves with this model."""

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """A direction each, in proportion to some density, as if the BSDF had only `lobes`: a lobe by `uc`, which is not
        used where there is one, and the direction by `u0` and `u1`, which delta lobes do not use. Lobes of one material
        that are no deltas are asked for together."""
        ...

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """(3, n) the value f(wo, wi) of the lobes that are no deltas, without the cosine."""
        return np.zeros(wi.shape)

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """(n,) per solid angle, with which `sample` finds `wi` through a lobe that is no delta."""
        return np.zeros(member.size)

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        """(3, n) the albedo of the diffuse lobe, which ambient light multiplies."""
        return np.zeros((3, member.size))

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        """(3, n) the colour that the shader `albedo` shows; 0 for what only emits."""
        ...


@runtime_checkable
class NullLobes(Protocol):
    """A `BSDF` whose transmission goes straight on, as if nothing were there."""

    def transmittance(self, member: Indices, at: SurfaceInteraction) -> Array:
        """(3, n) the mean weight of what goes straight on."""
        ...


@runtime_checkable
class Refracts(Protocol):
    """A BSDF that bends what it transmits."""

    def eta(self, member: Indices, at: SurfaceInteraction) -> Array:
        """(n,) index of refraction behind the surface over the one before it, as the viewer sees it."""
        ...


def mirrored(at: SurfaceInteraction) -> Array:
    """(3, n) directions that a mirror shows at `wo`."""
    return 2.0 * dot(at.wo, at.normal) * at.normal - at.wo


def reflects(at: SurfaceInteraction, wi: Array) -> Mask:
    """(n,) whether `wi` lies above the surface, and `wo` too."""
    return at.reflects(wi) & (dot(at.wo, at.normal) > 0.0)


def transmits(at: SurfaceInteraction, wi: Array) -> Mask:
    """(n,) whether `wi` lies below the surface by both normals, and `wo` above."""
    return (dot(at.normal, wi) < 0.0) & (dot(at.geometric, wi) < 0.0) & (dot(at.wo, at.normal) > 0.0)


def refracted(wo: Array, m: Array, c2: Array, eta: Array) -> Array:
    """(3, n) directions that are seen at `wo` through interfaces of normal `m`; `c2` (n,) are the cosines behind them, `eta`
    the index behind over the one before."""
    return (dot(wo, m) / eta - c2) * m - wo / eta


def index_ratio(at: SurfaceInteraction, ior: Array) -> Array:
    """(n,) the index behind the surface over the one before it, as the viewer sees it."""
    return np.where(at.front, ior, 1.0 / ior)


def has(lobes: Lobes, sought: Lobes) -> float:
    """1 where the lobe is among them, else 0."""
    return 1.0 if lobes & sought else 0.0
