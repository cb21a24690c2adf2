"""The sheen of cloth at grazing angles (Burley 2012)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.diffuse import DiffuseBSDF
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, dot
from engines.scene import Diffuse, Sheen


class SheenBSDF(DiffuseBSDF):
    """All sheens of a scene: f = color (1 - cos_d)^5 on both sides, cos_d the cosine between wi and the half vector. Directions
    are sampled as those of a diffuse surface."""

    def __init__(self, leaves: Sequence[Sheen]) -> None:
        super().__init__([Diffuse(leaf.color) for leaf in leaves])

    def _weight(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        return np.pi * self.evaluate(member, at, wi)

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        cos_d = np.sqrt(np.maximum(0.0, 0.5 + 0.5 * dot(at.wo, wi)))
        return np.where(at.reflects(wi), self._reflectance(member, at) * (1.0 - cos_d) ** 5, 0.0)

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return np.zeros((3, member.size))


BSDFS = {Sheen: SheenBSDF}
