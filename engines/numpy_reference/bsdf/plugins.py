"""BSDFs that users bring (`engines.plugin.BSDF`), by their objects for NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, transmits
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, Mask
from engines.scene import CustomBSDF


class PluginBSDF:
    """All leaves of plugins in a scene. A plugin's object has the verbs of `BSDF`, with the options of one material
    in the place of members, and `albedos(options)`. What is no delta leaves below the surface only where the plugin has the
    flag `transmission`."""

    def __init__(self, leaves: Sequence[CustomBSDF]) -> None:
        self._models = list(leaves)
        self.lobes = np.array([_lobes(model.plugin).value for model in self._models])
        albedos = [model.plugin.numpy.albedos(model.options) for model in self._models]
        self._diffuse, self._albedo = np.moveaxis(np.array(albedos, np.float64).reshape(-1, 2, 3), 0, -1).copy()

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """What the plugins answer, in materials that have one of the lobes."""
        found = BSDFSample.empty(member.size)
        for model, lanes in self._by_model(member):
            chosen = _lobes(model.plugin) & lobes
            if chosen:
                here = at.take(lanes)
                wi, weight, pdf = model.plugin.numpy.sample(model.options, here, uc[lanes], u0[lanes], u1[lanes], chosen)
                kept = np.isinf(pdf) | _leaves(model, here, wi)
                found.put(lanes, wi, np.where(kept, weight, 0.0), pdf)
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        return self._ask(member, at, wi, np.zeros(wi.shape), lambda model: model.plugin.numpy.evaluate)

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        return self._ask(member, at, wi, np.zeros(wi.shape[1]), lambda model: model.plugin.numpy.pdf)

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._diffuse.take(member, axis=1)

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._albedo.take(member, axis=1)

    def _ask(
        self, member: Indices, at: SurfaceInteraction, wi: Array, found: Array, verb: Callable[[CustomBSDF], Any]
    ) -> Array:
        """Fills `found` with what each point's model answers of `wi`, 0 where nothing leaves."""
        for model, lanes in self._by_model(member):
            here, towards = at.take(lanes), wi.take(lanes, axis=1)
            found[..., lanes] = np.where(_leaves(model, here, towards), verb(model)(model.options, here, towards), 0.0)
        return found

    def _by_model(self, member: Indices) -> list[tuple[CustomBSDF, Indices]]:
        return [(self._models[which], np.flatnonzero(member == which)) for which in np.unique(member)]


BSDFS = {CustomBSDF: PluginBSDF}


FLAGS = {
    "specular_reflection": Lobes.SPECULAR_REFLECTION,
    "specular_transmission": Lobes.SPECULAR_TRANSMISSION,
    "transmission": Lobes.GLOSSY_TRANSMISSION,
}
"""Lobes that a plugin says it has."""


def _lobes(plugin: Any) -> Lobes:
    found = Lobes.DIFFUSE_REFLECTION | Lobes.GLOSSY_REFLECTION
    for name, lobe in FLAGS.items():
        found |= lobe if getattr(plugin, name, False) else Lobes(0)
    return found


def _leaves(model: CustomBSDF, at: SurfaceInteraction, wi: Array) -> Mask:
    """(n,) whether what is no delta may leave the surface along `wi`."""
    above = at.reflects(wi)
    return above | transmits(at, wi) if _lobes(model.plugin) & Lobes.GLOSSY_TRANSMISSION else above
