"""A pane without thickness: mirror, or straight on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.interface import BSDF, BSDFSample, Lobes, has, mirrored
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Indices, dot
from engines.scene import ThinDielectric


class ThinDielectricBSDF(BSDF):
    """All panes of a scene. Light goes to and fro between both faces: R = F + (1 - F)^2 F / (1 - F^2) = 2 F / (1 + F)."""

    def __init__(self, leaves: Sequence[ThinDielectric]) -> None:
        self._ior = np.array([leaf.ior for leaf in leaves], np.float64)
        self._reflectance = ColorParameter([leaf.reflectance for leaf in leaves])
        self._transmittance = ColorParameter([leaf.transmittance for leaf in leaves])
        self.lobes = np.full(len(leaves), (Lobes.SPECULAR_REFLECTION | Lobes.SPECULAR_TRANSMISSION).value)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """The mirror direction with the probability R, else straight on."""
        reflectance = self._mirrored_share(member, at)
        r = reflectance * has(lobes, Lobes.SPECULAR_REFLECTION)
        t = (1.0 - reflectance) * has(lobes, Lobes.SPECULAR_TRANSMISSION)
        mirror = uc * (r + t) < r
        wi = np.where(mirror, mirrored(at), -at.wo)
        weight = np.where(mirror, self._reflectance(member, at), self._transmittance(member, at)) * (r + t)
        good = ~mirror | at.reflects(wi)
        return BSDFSample(wi, np.where(good, weight, 0.0), np.full(member.size, np.inf))

    def transmittance(self, member: Indices, at: SurfaceInteraction) -> Array:
        return (1.0 - self._mirrored_share(member, at)) * self._transmittance(member, at)

    def _mirrored_share(self, member: Indices, at: SurfaceInteraction) -> Array:
        once, _ = fresnel_dielectric(dot(at.wo, at.normal), self._ior[member])
        return 2.0 * once / (1.0 + once)

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._transmittance(member, at)


BSDFS = {ThinDielectric: ThinDielectricBSDF}
