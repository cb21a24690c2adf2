"""The sheen of cloth at grazing angles (Burley 2012)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, cosine_hemisphere, dot
from engines.scene import Sheen


class SheenBSDF:
    """All sheens of a scene: f = color (1 - cos_d)^5 on both sides, cos_d the cosine between wi and the half vector."""

    def __init__(self, leaves: Sequence[Sheen]) -> None:
        self._color = ColorParameter([leaf.color for leaf in leaves])
        lit = (self._color.largest > 0.0).any(axis=0)
        self.lobes = np.where(lit, Lobes.DIFFUSE_REFLECTION.value, 0)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """Directions by the cosine rule."""
        found = BSDFSample.empty(member.size)
        lanes = np.flatnonzero(self.lobes[member] & lobes)
        here = at.take(lanes)
        wi = cosine_hemisphere(here.normal, u0[lanes], u1[lanes])
        found.put(lanes, wi, np.pi * self.evaluate(member[lanes], here, wi), self.pdf(member[lanes], here, wi))
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        cos_d = np.sqrt(np.maximum(0.0, 0.5 + 0.5 * dot(at.wo, wi)))
        return np.where(at.reflects(wi), self._color(member, at) * (1.0 - cos_d) ** 5, 0.0)

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        return np.where(at.reflects(wi), dot(at.normal, wi) / np.pi, 0.0)

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return np.zeros((3, member.size))

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._color(member, at)


BSDFS = {Sheen: SheenBSDF}
