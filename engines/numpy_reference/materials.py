"""The materials of a scene: what they emit, and the BSDF of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from engines.numpy_reference.bsdf import BSDF, BSDFS, BSDFSample, Lobes
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, Mask
from engines.scene import Bsdf, Material, Mixture

Colour = Callable[[Indices, SurfaceInteraction], Array]


class Materials:
    """A column for each material: `kd`, `ks`, `kt`, `emission` (3, m); `ior`, `two_sided`, `lobes`."""

    def __init__(self, materials: Sequence[Material]) -> None:
        def colours(name: str) -> Array:
            return np.array([getattr(material, name) for material in materials], np.float64).reshape(-1, 3).T.copy()

        self.kd, self.ks, self.kt, self.emission = map(colours, ("kd", "ks", "kt", "emission"))
        self.ior = np.array([material.ior for material in materials], np.float64)
        self.two_sided = np.array([material.two_sided for material in materials], bool)
        self.emissive = bool((self.emission > 0.0).any())
        """Whether any surface emits."""
        leaves = [_leaf(material) for material in materials]
        self.lobes = np.zeros(len(materials), np.int64)
        self._models: list[BSDF] = []
        self._model, self._member = np.zeros(len(materials), np.int64), np.zeros(len(materials), np.int64)
        for kind in dict.fromkeys(BSDFS.values()):
            mine = np.flatnonzero([BSDFS[type(leaf)] is kind for leaf in leaves])
            if mine.size:
                model = kind([leaves[m] for m in mine])
                self._model[mine], self._member[mine] = len(self._models), np.arange(mine.size)
                self.lobes[mine] = model.lobes
                self._models.append(model)

    def emitted(self, at: SurfaceInteraction) -> Array:
        """(3, n) radiance that the surface sends back along the rays that found it."""
        lit = at.front | self.two_sided[at.material]
        return np.where(lit, self.emission.take(at.material, axis=1), 0.0)

    def diffuse(self, at: SurfaceInteraction) -> Array:
        """(3, n) the albedo of the diffuse lobe."""
        return self._colour(at, lambda model: model.diffuse)

    def albedo(self, at: SurfaceInteraction) -> Array:
        """(3, n) the colour that the shader `albedo` shows: the emission where the BSDF is black."""
        own = self._colour(at, lambda model: model.albedo)
        return np.where((own > 0.0).any(axis=0), own, self.emission.take(at.material, axis=1))

    def has(self, at: SurfaceInteraction, lobes: Lobes) -> Mask:
        """(n,) whether the BSDF has any of the lobes."""
        return (self.lobes[at.material] & lobes) != 0

    def sample(
        self, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:  # fmt: skip
        """`BSDF.sample` of the material at each point."""
        found = BSDFSample.empty(at.material.size)
        for model, lanes, member, here in self._by_model(at):
            found.put(lanes, *model.sample(member, here, uc[lanes], u0[lanes], u1[lanes], lobes))
        return found

    def evaluate(self, at: SurfaceInteraction, wi: Array) -> Array:
        """`BSDF.evaluate` of the material at each point."""
        value = np.empty(wi.shape)
        for model, lanes, member, here in self._by_model(at):
            value[:, lanes] = model.evaluate(member, here, wi[:, lanes])
        return value

    def pdf(self, at: SurfaceInteraction, wi: Array) -> Array:
        """`BSDF.pdf` of the material at each point."""
        density = np.empty(at.material.size)
        for model, lanes, member, here in self._by_model(at):
            density[lanes] = model.pdf(member, here, wi[:, lanes])
        return density

    def _colour(self, at: SurfaceInteraction, verb: Callable[[BSDF], Colour]) -> Array:
        found = np.empty(at.wo.shape)
        for model, lanes, member, here in self._by_model(at):
            found[:, lanes] = verb(model)(member, here)
        return found

    def _by_model(self, at: SurfaceInteraction) -> Iterator[tuple[BSDF, Indices | slice, Indices, SurfaceInteraction]]:
        """For each model among n points: which of them have it, their places in it, and the points themselves."""
        member = self._member[at.material]
        if len(self._models) == 1:
            yield self._models[0], slice(None), member, at
            return
        model = self._model[at.material]
        for number, found in enumerate(self._models):
            lanes = np.flatnonzero(model == number)
            if lanes.size:
                yield found, lanes, member[lanes], at.take(lanes)


def _leaf(material: Material) -> Bsdf:
    """The BSDF of a material, kd, ks and kt being one."""
    m = material
    return Mixture(m.kd, m.ks, m.kt, m.ior, m.fresnel) if m.bsdf is None else m.bsdf
