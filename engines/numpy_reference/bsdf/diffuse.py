"""Lambert's law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, cosine_hemisphere, dot
from engines.scene import Diffuse


class DiffuseBSDF:
    """All diffuse leaves of a scene: f = reflectance / pi, on both sides."""

    def __init__(self, leaves: Sequence[Diffuse]) -> None:
        self._reflectance = ColorParameter([leaf.reflectance for leaf in leaves])
        lit = (self._reflectance.largest > 0.0).any(axis=0)
        self.lobes = np.where(lit, Lobes.DIFFUSE_REFLECTION.value, 0)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """Directions by the cosine rule."""
        found = BSDFSample.empty(member.size)
        lanes = np.flatnonzero(self.lobes[member] & lobes)
        here = at.take(lanes)
        wi = cosine_hemisphere(here.normal, u0[lanes], u1[lanes])
        found.put(lanes, wi, self._weight(member[lanes], here, wi), self.pdf(member[lanes], here, wi))
        return found

    def _weight(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """(3, n) f cos / pdf of sampled directions."""
        return np.where(at.reflects(wi), self._reflectance(member, at), 0.0)

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        return np.where(at.reflects(wi), self._reflectance(member, at) / np.pi, 0.0)

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        return np.where(at.reflects(wi), dot(at.normal, wi) / np.pi, 0.0)

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._reflectance(member, at)

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._reflectance(member, at)


BSDFS = {Diffuse: DiffuseBSDF}
