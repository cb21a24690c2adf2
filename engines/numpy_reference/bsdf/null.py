"""Nothing: light goes straight on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.interface import BSDF, BSDFSample, Lobes
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices
from engines.scene import Null


class NullBSDF(BSDF):
    """All leaves of a scene that are not there."""

    def __init__(self, leaves: Sequence[Null]) -> None:
        self.lobes = np.full(len(leaves), Lobes.SPECULAR_TRANSMISSION.value)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """Straight on, with all of the light."""
        n = member.size
        passes = 1.0 if lobes & Lobes.SPECULAR_TRANSMISSION else 0.0
        return BSDFSample(-at.wo, np.full((3, n), passes), np.full(n, np.inf))

    def transmittance(self, member: Indices, at: SurfaceInteraction) -> Array:
        return np.ones((3, member.size))

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return np.ones((3, member.size))


BSDFS = {Null: NullBSDF}
