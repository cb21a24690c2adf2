"""Metals: reflection alone, by a smooth surface or by microfacets, of a complex index of refraction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf import ggx
from engines.numpy_reference.bsdf.fresnel import fresnel_conductor
from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, mirrored
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Frame, Indices, Mask, dot, unit
from engines.scene import Conductor


class ConductorBSDF:
    """All conductors of a scene: GGX microfacets, and mirrors where the roughness is 0.

    A facet with normal m = unit(wo + wi) is a mirror of reflectance F(wo . m); D(m) says how many there are, and
    G1(wo) G1(wi) how many of them are seen and lit. They reflect on both sides of the surface.
    """

    def __init__(self, leaves: Sequence[Conductor]) -> None:
        self._eta, self._k, self._reflectance = (
            ColorParameter([getattr(leaf, name) for leaf in leaves], high)
            for name, high in (("eta", np.inf), ("k", np.inf), ("reflectance", 1.0))
        )
        self._alpha = np.array([leaf.alpha for leaf in leaves], np.float64).reshape(-1, 2).T.copy()
        self._smooth: Mask = (self._alpha == 0.0).all(axis=0)
        self.lobes = np.where(self._smooth, Lobes.SPECULAR_REFLECTION.value, Lobes.GLOSSY_REFLECTION.value)

    def diffuse(self, material: Indices, at: SurfaceInteraction) -> Array:
        return np.zeros(at.wo.shape)

    def albedo(self, material: Indices, at: SurfaceInteraction) -> Array:
        """The reflectance of a smooth surface at normal incidence."""
        eta, k, scale = (parameter(material, at) for parameter in (self._eta, self._k, self._reflectance))
        return scale * ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)

    def sample(
        self, material: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """The mirror direction of the surface, or of a facet among those that are seen from `wo`."""
        found = BSDFSample.empty(material.size)
        # smooth
        lanes = np.flatnonzero(self.lobes[material] & lobes & Lobes.SPECULAR_REFLECTION)
        which, here = material[lanes], at.take(lanes)
        wi = mirrored(here)
        weight = np.where(here.reflects(wi), self._reflected(which, here, dot(here.wo, here.normal)), 0.0)
        found.put(lanes, wi, weight, np.full(lanes.size, np.inf))
        # rough
        lanes = np.flatnonzero(self.lobes[material] & lobes & Lobes.GLOSSY_REFLECTION)
        which, here = material[lanes], at.take(lanes)
        frame, alpha = Frame.along(here.normal, here.dp_du), self._alpha.take(which, axis=1)
        wo = frame.to_local(here.wo)
        m = ggx.sample_visible_normals(wo, alpha, u0[lanes], u1[lanes])
        local = 2.0 * dot(wo, m) * m - wo
        wi = frame.to_world(local)
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = self._reflected(which, here, dot(wo, m)) * ggx.masking(local, alpha)
        found.put(lanes, wi, np.where(_reflects(here, wi), weight, 0.0), self.pdf(which, here, wi))
        return found

    def evaluate(self, material: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """F D G1(wo) G1(wi) / (4 cos cos), after Torrance and Sparrow."""
        frame, alpha = Frame.along(at.normal, at.dp_du), self._alpha.take(material, axis=1)
        wo, wi_local = frame.to_local(at.wo), frame.to_local(wi)
        with np.errstate(divide="ignore", invalid="ignore"):
            m = unit(wo + wi_local)
            facets = ggx.distribution(m, alpha) * ggx.masking(wo, alpha) * ggx.masking(wi_local, alpha)
            value = self._reflected(material, at, dot(wo, m)) * facets / (4.0 * wo[2] * wi_local[2])
        return np.where(~self._smooth[material] & _reflects(at, wi), value, 0.0)

    def pdf(self, material: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """The density of visible normals, times the Jacobian of the reflection in them."""
        frame, alpha = Frame.along(at.normal, at.dp_du), self._alpha.take(material, axis=1)
        wo = frame.to_local(at.wo)
        with np.errstate(divide="ignore", invalid="ignore"):
            m = unit(wo + frame.to_local(wi))
            density = ggx.pdf_visible_normals(wo, m, alpha) / (4.0 * dot(wo, m))
        return np.where(~self._smooth[material] & _reflects(at, wi), density, 0.0)

    def _reflected(self, material: Indices, at: SurfaceInteraction, cosine: Array) -> Array:
        """(3, n) reflectance of a mirror that is seen under this cosine."""
        eta, k, scale = (parameter(material, at) for parameter in (self._eta, self._k, self._reflectance))
        return scale * fresnel_conductor(cosine, eta, k)


BSDFS = {Conductor: ConductorBSDF}


def _reflects(at: SurfaceInteraction, wi: Array) -> Mask:
    return at.reflects(wi) & (dot(at.wo, at.normal) > 0.0)
