"""Glass: reflection and refraction by Fresnel's equations, by a smooth interface or by microfacets (Walter et al. 2007)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.facets import Roughness
from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, has, index_ratio, mirrored, reflects, refracted, transmits
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, dot
from engines.scene import Dielectric

SMOOTH = Lobes.SPECULAR_REFLECTION | Lobes.SPECULAR_TRANSMISSION
ROUGH = Lobes.GLOSSY_REFLECTION | Lobes.GLOSSY_TRANSMISSION


class DielectricBSDF:
    """All interfaces of a scene between two dielectrics, smooth where the roughness is 0."""

    def __init__(self, leaves: Sequence[Dielectric]) -> None:
        self._ior = np.array([leaf.ior for leaf in leaves], np.float64)
        self._reflectance = ColorParameter([leaf.reflectance for leaf in leaves])
        self._transmittance = ColorParameter([leaf.transmittance for leaf in leaves])
        self._roughness = Roughness(leaves)
        self.lobes = np.where(self._roughness.smooth, SMOOTH.value, ROUGH.value)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """Reflection with the probability F, else refraction; the normal of a rough interface is chosen first."""
        found = BSDFSample.empty(member.size)
        lanes = np.flatnonzero(self.lobes[member] & lobes & SMOOTH)
        found.put(lanes, *self._sample_smooth(member[lanes], at.take(lanes), uc[lanes], lobes))
        lanes = np.flatnonzero(self.lobes[member] & lobes & ROUGH)
        found.put(lanes, *self._sample_rough(member[lanes], at.take(lanes), uc[lanes], u0[lanes], u1[lanes]))
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """F D G1 G1 / (4 cos cos) above; below with 1 - F and the Jacobian of refraction in the facets."""
        value = np.zeros(wi.shape)
        lanes = np.flatnonzero(~self._roughness.smooth[member] & (reflects(at, wi) | transmits(at, wi)))
        member, at = member[lanes], at.take(lanes)
        facets, eta = self._roughness.at(member, at), self.eta(member, at)
        towards = facets.frame.to_local(wi.take(lanes, axis=1))
        m, possible = facets.halfway(towards, eta)
        reflectance, _ = fresnel_dielectric(dot(facets.wo, m), eta)
        above = facets.reflected(self._reflectance(member, at) * reflectance, towards, m)
        below = facets.transmitted(self._transmittance(member, at) * (1.0 - reflectance), towards, m, eta)
        value[:, lanes] = np.where(possible, np.where(towards[2] > 0.0, above, below), 0.0)
        return value

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """That of the facets that send `wi` to `wo`, times F above, 1 - F below, and the Jacobian."""
        density = np.zeros(member.size)
        lanes = np.flatnonzero(~self._roughness.smooth[member] & (reflects(at, wi) | transmits(at, wi)))
        member, at = member[lanes], at.take(lanes)
        facets, eta = self._roughness.at(member, at), self.eta(member, at)
        towards = facets.frame.to_local(wi.take(lanes, axis=1))
        m, possible = facets.halfway(towards, eta)
        reflectance, _ = fresnel_dielectric(dot(facets.wo, m), eta)
        below = (1.0 - reflectance) * facets.pdf_transmitted(towards, m, eta)
        chosen = np.where(towards[2] > 0.0, reflectance * facets.pdf_reflected(m), below)
        density[lanes] = np.where(possible, chosen, 0.0)
        return density

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return np.zeros((3, member.size))

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._transmittance(member, at)

    def eta(self, member: Indices, at: SurfaceInteraction) -> Array:
        return index_ratio(at, self._ior[member])

    def _sample_smooth(self, member: Indices, at: SurfaceInteraction, uc: Array, lobes: Lobes) -> BSDFSample:
        eta = self.eta(member, at)
        reflectance, c2 = fresnel_dielectric(dot(at.wo, at.normal), eta)
        r = reflectance * has(lobes, Lobes.SPECULAR_REFLECTION)
        t = (1.0 - reflectance) * has(lobes, Lobes.SPECULAR_TRANSMISSION)
        mirror = uc * (r + t) < r
        wi = np.where(mirror, mirrored(at), refracted(at.wo, at.normal, c2, eta))
        weight = np.where(mirror, self._reflectance(member, at), self._transmittance(member, at) / eta**2) * (r + t)
        good = np.where(mirror, at.reflects(wi), (t > 0.0) & transmits(at, wi))
        return BSDFSample(wi, np.where(good, weight, 0.0), np.full(member.size, np.inf))

    def _sample_rough(self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array) -> BSDFSample:
        facets, eta = self._roughness.at(member, at), self.eta(member, at)
        m = facets.sample_visible(u0, u1)
        reflectance, c2 = fresnel_dielectric(dot(facets.wo, m), eta)
        mirror = uc < reflectance
        towards = np.where(mirror, facets.mirrored(m), refracted(facets.wo, m, c2, eta))
        wi = facets.frame.to_world(towards)
        weight = np.where(mirror, self._reflectance(member, at), self._transmittance(member, at) / eta**2)
        good = np.where(mirror, reflects(at, wi), transmits(at, wi))
        return BSDFSample(wi, np.where(good, weight * facets.weight(towards), 0.0), self.pdf(member, at, wi))


BSDFS = {Dielectric: DielectricBSDF}
