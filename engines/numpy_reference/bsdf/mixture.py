"""The model kd, ks, kt: a mixture of a diffuse lobe and two delta lobes, mirror and refraction.

With `fresnel` the mirror is weighted by the reflectance F of a dielectric, and the refraction by 1 - F.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, mirrored
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, Mask, cosine_hemisphere, dot
from engines.scene import Mixture

LOBES = (Lobes.DIFFUSE_REFLECTION, Lobes.SPECULAR_REFLECTION, Lobes.SPECULAR_TRANSMISSION)


class MixtureBSDF:
    """All of a scene that is given by kd, ks and kt."""

    def __init__(self, leaves: Sequence[Mixture]) -> None:
        self._kd, self._ks, self._kt = (
            ColorParameter([getattr(leaf, name) for leaf in leaves]) for name in ("kd", "ks", "kt")
        )
        self._ior = np.array([leaf.ior for leaf in leaves], np.float64)
        self._fresnel = np.array([leaf.fresnel for leaf in leaves], bool)
        diffuse, mirror, refraction = ((k.largest > 0.0).any(axis=0) for k in (self._kd, self._ks, self._kt))
        self.lobes = diffuse * LOBES[0].value + mirror * LOBES[1].value + refraction * LOBES[2].value

    def diffuse(self, material: Indices, at: SurfaceInteraction) -> Array:
        return self._kd(material, at)

    def albedo(self, material: Indices, at: SurfaceInteraction) -> Array:
        """The first of kd, ks and kt that is positive in any channel."""
        kd, ks, kt = self._kd(material, at), self._ks(material, at), self._kt(material, at)
        return np.where((kd > 0.0).any(axis=0), kd, np.where((ks > 0.0).any(axis=0), ks, kt))

    def sample(
        self, material: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """One lobe, chosen in proportion to the sums of the weights over red, green and blue."""
        weights = self._weights(material, at, lobes)
        d, r, t = (weight.sum(axis=0) for weight in weights)
        q = d + r + t
        u = uc * q
        found = BSDFSample.empty(material.size)
        # diffuse
        lanes = np.flatnonzero(u < d)
        here, share = at.take(lanes), d[lanes] / q[lanes]
        wi = cosine_hemisphere(here.normal, u0[lanes], u1[lanes])
        weight = np.where(dot(here.geometric, wi) > 0.0, weights.diffuse[:, lanes] * (q[lanes] / d[lanes]), 0.0)
        found.put(lanes, wi, weight, share * dot(here.normal, wi) / np.pi)
        # mirror
        lanes = np.flatnonzero((u >= d) & (u < d + r))
        here = at.take(lanes)
        wi = mirrored(here)
        weight = np.where(dot(here.geometric, wi) > 0.0, weights.mirror[:, lanes] * (q[lanes] / r[lanes]), 0.0)
        found.put(lanes, wi, weight, np.full(lanes.size, np.inf))
        # refraction
        lanes = np.flatnonzero((u >= d + r) & (t > 0.0))
        here = at.take(lanes)
        through = refracted(here, self._index_ratio(material[lanes], here))
        side = dot(here.geometric, through.wi)
        good = np.where(through.total, side, -side) > 0.0
        weight = np.where(good, weights.refraction[:, lanes] * (q[lanes] / t[lanes] * through.scale), 0.0)
        found.put(lanes, through.wi, weight, np.full(lanes.size, np.inf))
        return found

    def evaluate(self, material: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """Lambert's law."""
        return np.where(at.reflects(wi), self._kd(material, at) / np.pi, 0.0)

    def pdf(self, material: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        d, r, t = (weight.sum(axis=0) for weight in self._weights(material, at, Lobes.ALL))
        with np.errstate(invalid="ignore"):
            return np.where((d > 0.0) & at.reflects(wi), d / (d + r + t) * dot(at.normal, wi) / np.pi, 0.0)

    def _weights(self, material: Indices, at: SurfaceInteraction, lobes: Lobes) -> _Weights:
        kd, ks, kt = (k(material, at) for k in (self._kd, self._ks, self._kt))
        coated = self._fresnel[material]
        if coated.any():
            reflectance, _ = fresnel_dielectric(np.abs(dot(at.wo, at.normal)), self._index_ratio(material, at))
            ks = np.where(coated, ks * reflectance, ks)
            kt = np.where(coated, kt * (1.0 - reflectance), kt)
        weights = zip((kd, ks, kt), LOBES, strict=True)
        return _Weights(*(weight if lobe in lobes else np.zeros_like(weight) for weight, lobe in weights))

    def _index_ratio(self, material: Indices, at: SurfaceInteraction) -> Array:
        """(n,) the index behind the surface over the one before it, as the viewer sees it."""
        ior = self._ior[material]
        return np.where(at.front, ior, 1.0 / ior)


BSDFS = {Mixture: MixtureBSDF}


class _Weights(NamedTuple):
    """(3, n) each, Fresnel terms included."""

    diffuse: Array
    mirror: Array
    refraction: Array


class Refraction(NamedTuple):
    """Unit directions (3, n) of light that passes a surface, and the factor `scale` (n,) on its radiance, 1/eta^2.

    Under `total` reflection (n,) the direction is that of the mirror and the scale is 1."""

    wi: Array
    scale: Array
    total: Mask


def refracted(at: SurfaceInteraction, eta: Array) -> Refraction:
    """What is seen at `wo` through the surface; `eta` (n,) is the index behind it over the one before it."""
    c1 = np.abs(dot(at.wo, at.normal))
    _, c2 = fresnel_dielectric(c1, eta)
    total = c2 == 0.0
    behind = (c1 / eta - c2) * at.normal - at.wo / eta
    return Refraction(np.where(total, mirrored(at), behind), np.where(total, 1.0, 1.0 / (eta * eta)), total)
