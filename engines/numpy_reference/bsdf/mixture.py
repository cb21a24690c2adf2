"""The model kd, ks, kt: a mixture of a diffuse lobe and two delta lobes, mirror and refraction.

With `fresnel` the mirror is weighted by the reflectance F of a dielectric, and the refraction by 1 - F.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, index_ratio, mirrored
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, Mask, cosine_hemisphere, dot
from engines.scene import Mixture

LOBES = (Lobes.DIFFUSE_REFLECTION, Lobes.SPECULAR_REFLECTION, Lobes.SPECULAR_TRANSMISSION)


class MixtureBSDF:
    """All leaves of a scene that are given by kd, ks and kt."""

    def __init__(self, leaves: Sequence[Mixture]) -> None:
        self._colors = [ColorParameter([getattr(leaf, name) for leaf in leaves]) for name in ("kd", "ks", "kt")]
        self._ior = np.array([leaf.ior for leaf in leaves], np.float64)
        self._fresnel = np.array([leaf.fresnel for leaf in leaves], bool)
        self.lobes = np.zeros(len(leaves), np.int64)
        for color, lobe in zip(self._colors, LOBES, strict=True):
            self.lobes += (color.largest > 0.0).any(axis=0) * lobe.value

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """One lobe, chosen in proportion to the sums of the weights over red, green and blue."""
        weights = self._weights(member, at, lobes)
        d, r, t = (weight.sum(axis=0) for weight in weights)
        q = d + r + t
        u = uc * q
        found = BSDFSample.empty(member.size)
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
        through = refracted(here, self.eta(member[lanes], here))
        side = dot(here.geometric, through.wi)
        good = np.where(through.total, side, -side) > 0.0
        weight = np.where(good, weights.refraction[:, lanes] * (q[lanes] / t[lanes] * through.scale), 0.0)
        found.put(lanes, through.wi, weight, np.full(lanes.size, np.inf))
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """Lambert's law."""
        return np.where(at.reflects(wi), self._colors[0](member, at) / np.pi, 0.0)

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        d, r, t = (weight.sum(axis=0) for weight in self._weights(member, at, Lobes.ALL))
        with np.errstate(invalid="ignore"):
            return np.where((d > 0.0) & at.reflects(wi), d / (d + r + t) * dot(at.normal, wi) / np.pi, 0.0)

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._colors[0](member, at)

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        """The first of kd, ks, kt that is not black."""
        kd, ks, kt = (color(member, at) for color in self._colors)
        return np.where((kd > 0.0).any(axis=0), kd, np.where((ks > 0.0).any(axis=0), ks, kt))

    def _weights(self, member: Indices, at: SurfaceInteraction, lobes: Lobes) -> _Weights:
        kd, ks, kt = (color(member, at) for color in self._colors)
        coated = self._fresnel[member]
        if coated.any():
            reflectance, _ = fresnel_dielectric(np.abs(dot(at.wo, at.normal)), self.eta(member, at))
            ks = np.where(coated, ks * reflectance, ks)
            kt = np.where(coated, kt * (1.0 - reflectance), kt)
        weights = zip((kd, ks, kt), LOBES, strict=True)
        return _Weights(*(weight if lobe in lobes else np.zeros_like(weight) for weight, lobe in weights))

    def eta(self, member: Indices, at: SurfaceInteraction) -> Array:
        return index_ratio(at, self._ior[member])


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
