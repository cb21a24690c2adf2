"""Metals: reflection alone, by a smooth surface or by microfacets, of a complex index of refraction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.facets import Roughness
from engines.numpy_reference.bsdf.fresnel import fresnel_conductor
from engines.numpy_reference.bsdf.interface import BSDF, BSDFSample, Lobes, mirrored, reflects
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, columns, dot, unit
from engines.scene import Conductor


class ConductorBSDF(BSDF):
    """All conductors of a scene: microfacets, and mirrors where the roughness is 0.

    A facet with normal m = unit(wo + wi) is a mirror of reflectance F(wo . m); D(m) says how many there are, and
    G1(wo) G1(wi) how many of them are seen and lit. They reflect on both sides of the surface.
    """

    def __init__(self, leaves: Sequence[Conductor]) -> None:
        self._eta, self._k = columns(leaves, "eta"), columns(leaves, "k")
        self._reflectance = ColorParameter([leaf.reflectance for leaf in leaves])
        self._roughness = Roughness(leaves)
        self._smooth = self._roughness.smooth
        self.lobes = np.where(self._smooth, Lobes.SPECULAR_REFLECTION.value, Lobes.GLOSSY_REFLECTION.value)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """The mirror direction of the surface, or of a facet among those that are seen from `wo`."""
        found = BSDFSample.empty(member.size)
        # smooth
        lanes = np.flatnonzero(self.lobes[member] & lobes & Lobes.SPECULAR_REFLECTION)
        which, here = member[lanes], at.take(lanes)
        wi = mirrored(here)
        weight = np.where(here.reflects(wi), self._reflected(which, here, dot(here.wo, here.normal)), 0.0)
        found.put(lanes, wi, weight, np.full(lanes.size, np.inf))
        # rough
        lanes = np.flatnonzero(self.lobes[member] & lobes & Lobes.GLOSSY_REFLECTION)
        which, here = member[lanes], at.take(lanes)
        facets = self._roughness.at(which, here)
        m = facets.sample_visible(u0[lanes], u1[lanes])
        towards = facets.mirrored(m)
        wi = facets.frame.to_world(towards)
        weight = self._reflected(which, here, dot(facets.wo, m)) * facets.weight(towards)
        found.put(lanes, wi, np.where(reflects(here, wi), weight, 0.0), self.pdf(which, here, wi))
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """F D G1(wo) G1(wi) / (4 cos cos), after Torrance and Sparrow."""
        lanes = np.flatnonzero(~self._smooth[member] & reflects(at, wi))
        member, at = member[lanes], at.take(lanes)
        facets = self._roughness.at(member, at)
        towards = facets.frame.to_local(wi.take(lanes, axis=1))
        m = unit(facets.wo + towards)
        value = np.zeros(wi.shape)
        value[:, lanes] = facets.reflected(self._reflected(member, at, dot(facets.wo, m)), towards, m)
        return value

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """The density of visible normals, times the Jacobian of the reflection in them."""
        lanes = np.flatnonzero(~self._smooth[member] & reflects(at, wi))
        facets = self._roughness.at(member[lanes], at.take(lanes))
        density = np.zeros(member.size)
        density[lanes] = facets.pdf_reflected(unit(facets.wo + facets.frame.to_local(wi.take(lanes, axis=1))))
        return density

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        """The reflectance at normal incidence."""
        eta, k = (table.take(member, axis=1) for table in (self._eta, self._k))
        return self._reflectance(member, at) * ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)

    def _reflected(self, member: Indices, at: SurfaceInteraction, cosine: Array) -> Array:
        """(3, n) reflectance of a mirror that is seen under this cosine."""
        eta, k = (table.take(member, axis=1) for table in (self._eta, self._k))
        return self._reflectance(member, at) * fresnel_conductor(cosine, eta, k)


BSDFS = {Conductor: ConductorBSDF}
