"""The materials of a scene: what they emit, and the BSDF that each leads to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from engines.numpy_reference.bsdf import BSDF, BSDFS, BSDFSample, Lobes, NullLobes, Refracts
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.instances import Turned
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.shapes import Primitives
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.tilts import kept, shadowing
from engines.numpy_reference.vectors import Array, Indices, Mask, columns, dot
from engines.numpy_reference.wrappers import Wrappers
from engines.scene import Material


class Materials:
    """A column for each of m materials: `kd`, `ks`, `kt`, `emission` (3, m); `ior`, `two_sided` (m,). `lobes` are those of the
    BSDFs that are no wrappers, the leaves. `placed` (m,) says which materials need texture coordinates, None that none does.

    Where some emission is a texture, `emission` has its mean, and `geometry` is needed. The verbs of BSDFs are those of the
    leaves to which `walk` has led, which comes first where there are wrappers.
    """

    def __init__(self, materials: Sequence[Material], geometry: Geometry | None = None) -> None:
        self.kd, self.ks, self.kt = (columns(materials, name) for name in ("kd", "ks", "kt"))
        self.emission = columns(materials, "mean_emission")
        self._radiance = ColorParameter([m.emission for m in materials], np.inf)
        self._geometry = geometry
        self.ior = np.array([material.ior for material in materials], np.float64)
        self.two_sided = np.array([material.two_sided for material in materials], bool)
        self.emissive = bool((self.emission > 0.0).any())
        """Whether any surface emits."""
        self._wrappers = Wrappers([material.as_bsdf for material in materials])
        self.placed = self._wrappers.placed if self._wrappers.placed.any() else None
        leaves = self._wrappers.leaves
        self.lobes = np.zeros(len(leaves), np.int64)
        self._models: list[BSDF] = []
        self._model, self._member = np.zeros(len(leaves), np.int64), np.zeros(len(leaves), np.int64)
        for kind in dict.fromkeys(BSDFS.values()):
            mine = np.flatnonzero([BSDFS[type(leaf)] is kind for leaf in leaves])
            if mine.size:
                model = kind([leaves[number] for number in mine])
                self._model[mine], self._member[mine] = len(self._models), np.arange(mine.size)
                self.lobes[mine] = model.lobes
                self._models.append(model)
        self._crossed = np.array([isinstance(model, NullLobes) for model in self._models], bool)
        self.null_lobes = self._wrappers.masks or bool(self._crossed.any())
        """Whether any surface may let rays pass as if it were not there."""

    def emits(self, at: SurfaceInteraction) -> Mask:
        """(n,) whether the surface emits, on whichever side."""
        return (self.emission > 0.0).any(axis=0)[at.material]

    def emitted(self, at: SurfaceInteraction) -> Array:
        """(3, n) radiance that the surface sends back along the rays that found it."""
        return np.where(at.front | self.two_sided[at.material], self._emission(at), 0.0)

    def radiance(self, shapes: Primitives, index: Indices, material: Indices, wo: Array, point: Array) -> Array:
        """(3, n) that leaves points (3, n) of `shapes` along `wo`, where that side emits."""
        found = self.emission.take(material, axis=1)
        lanes = np.flatnonzero(self._radiance.textured[material])
        if lanes.size:
            wo, point = wo.take(lanes, axis=1), point.take(lanes, axis=1)
            place = shapes.coordinates(index[lanes], point + wo, -wo, point)
            found[:, lanes] = self._radiance(material[lanes], place)
        return found

    def _emission(self, at: SurfaceInteraction) -> Array:
        """(3, n) radiance on either side."""
        if not self._radiance.textured.any():
            return self.emission.take(at.material, axis=1)
        assert self._geometry is not None
        found = np.empty(at.wo.shape)
        for shapes, lanes, index in self._geometry.by_kind(at.primitive_id):
            there = at.take(lanes)
            if isinstance(shapes, Turned):  # no group emits
                found[:, lanes] = 0.0
            else:
                found[:, lanes] = self.radiance(shapes, index, there.material, there.wo, there.point)
        return found

    def walk(self, at: SurfaceInteraction, u: Array) -> tuple[SurfaceInteraction, Array]:
        """The points as the BSDFs there see them, and what the wrappers have left of `u` (n,), which was drawn for a lobe."""
        return self._wrappers.walk(at, u) if self._wrappers.any else (at, u)

    def diffuse(self, at: SurfaceInteraction) -> Array:
        """(3, n) the albedo of the diffuse lobe, times the opacity."""
        found = np.empty(at.wo.shape)
        for model, lanes, member, here in self._by_model(at):
            found[:, lanes] = model.diffuse(member, here)
        return found if at.wrapped is None else found * at.wrapped.opacity

    def albedo(self, at: SurfaceInteraction) -> Array:
        """(3, n) the colour that the shader `albedo` shows: the emission where the BSDF is black."""
        found = np.empty(at.wo.shape)
        for model, lanes, member, here in self._by_model(at):
            found[:, lanes] = model.albedo(member, here)
        return np.where((found > 0.0).any(axis=0), found, self._emission(at))

    def has(self, at: SurfaceInteraction, lobes: Lobes) -> Mask:
        """(n,) whether the BSDF has any of the lobes."""
        return (self.lobes[self._leaf(at)] & lobes) != 0

    def sample(self, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL) -> BSDFSample:
        """`BSDF.sample` of the BSDF at each point; straight on where a mask lets the ray pass."""
        found = self._sampled(at, uc, u0, u1, lobes)
        if at.wrapped is None:
            return found
        passing, pdf = at.wrapped.passing, np.where(np.isinf(found.pdf), np.inf, found.pdf * at.wrapped.opacity)
        return BSDFSample(*(np.where(passing, *pair) for pair in ((-at.wo, found.wi), (1.0, found.weight), (np.inf, pdf))))

    def passes(self, at: SurfaceInteraction, wi: Array) -> Mask:
        """(n,) whether a sample `wi` is that of a null lobe: straight on through a mask, null or a thin pane."""
        straight = (wi == -at.wo).all(axis=0) & self._crossed[self._model[self._leaf(at)]]
        return straight if at.wrapped is None else straight | at.wrapped.passing

    def transmittance(self, at: SurfaceInteraction) -> Array:
        """(3, n) the mean weight of what null lobes let pass along the rays that found the surface."""
        return self._wrappers.transmittance(at, self._leaf_transmittance)

    def follow(self, at: SurfaceInteraction, lobe: Lobes) -> tuple[Indices, BSDFSample]:
        """What one delta lobe shows, as if it were the only one; and at which points, of all n. The lobe of transmission goes
        straight on where a mask is not quite opaque."""
        lanes = np.flatnonzero(self._follows(at, lobe))
        at, undrawn = at.take(lanes), np.zeros(lanes.size)
        found = self._sampled(at, undrawn, undrawn, undrawn, lobe)
        if at.wrapped is not None:
            opacity = at.wrapped.opacity
            weight, wi = found.weight * opacity, found.wi
            if lobe == Lobes.SPECULAR_TRANSMISSION:
                weight, wi = np.where(opacity < 1.0, 1.0 - opacity, weight), np.where(opacity < 1.0, -at.wo, wi)
            found = BSDFSample(wi, weight, found.pdf)
        return lanes, found

    def evaluate(self, at: SurfaceInteraction, wi: Array) -> Array:
        """`BSDF.evaluate` of the BSDF at each point, times the opacity."""
        value = np.empty(wi.shape)
        for model, lanes, member, here in self._by_model(at):
            value[:, lanes] = model.evaluate(member, here, wi[:, lanes])
        if at.wrapped is None:
            return value
        return np.where(kept(at, at.wrapped, wi), value * (at.wrapped.opacity * shadowing(at, at.wrapped, wi)), 0.0)

    def pdf(self, at: SurfaceInteraction, wi: Array) -> Array:
        """`BSDF.pdf` of the BSDF at each point, times the opacity."""
        density = np.empty(at.material.size)
        for model, lanes, member, here in self._by_model(at):
            density[lanes] = model.pdf(member, here, wi[:, lanes])
        return density if at.wrapped is None else np.where(kept(at, at.wrapped, wi), density * at.wrapped.opacity, 0.0)

    def eta(self, at: SurfaceInteraction, wi: Array) -> Array:
        """(n,) index of refraction where rays along `wi` are, over that where the ray that found the surface was: 1 of what is
        reflected, or goes straight on."""
        found = np.ones(at.material.size)
        for model, lanes, member, here in self._by_model(at):
            if isinstance(model, Refracts):
                found[lanes] = model.eta(member, here)
        refracted = dot(at.geometric, wi) < 0.0
        return np.where(refracted if at.wrapped is None else refracted & ~at.wrapped.passing, found, 1.0)

    def _sampled(self, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes) -> BSDFSample:
        """`BSDF.sample`, and what tilts do to it."""
        found = BSDFSample.empty(at.material.size)
        for model, lanes, member, here in self._by_model(at):
            found.put(lanes, *model.sample(member, here, uc[lanes], u0[lanes], u1[lanes], lobes))
        if at.wrapped is None:
            return found
        weight = found.weight * shadowing(at, at.wrapped, found.wi)
        return found._replace(weight=np.where(kept(at, at.wrapped, found.wi), weight, 0.0))

    def _leaf_transmittance(self, at: SurfaceInteraction) -> Array:
        assert at.wrapped is not None
        found = np.zeros(at.wo.shape)
        for model, lanes, member, here in self._by_model(at):
            if isinstance(model, NullLobes):
                found[:, lanes] = model.transmittance(member, here)
        return np.where(kept(at, at.wrapped, -at.wo), found * shadowing(at, at.wrapped, -at.wo), 0.0)

    def _follows(self, at: SurfaceInteraction, lobe: Lobes) -> Mask:
        if at.wrapped is None or lobe != Lobes.SPECULAR_TRANSMISSION:
            return self.has(at, lobe)
        return self.has(at, lobe) | (at.wrapped.opacity < 1.0)

    def _leaf(self, at: SurfaceInteraction) -> Indices:
        if at.wrapped is not None:
            return at.wrapped.leaf
        assert not self._wrappers.any, "wrappers are walked first"
        return self._wrappers.leaf(at.material)

    def _by_model(self, at: SurfaceInteraction) -> Iterator[tuple[BSDF, Indices | slice, Indices, SurfaceInteraction]]:
        """For each model among n points: which of them have it, their places in it, and the points themselves."""
        leaf = self._leaf(at)
        member = self._member[leaf]
        if len(self._models) == 1:
            yield self._models[0], slice(None), member, at
            return
        model = self._model[leaf]
        for number, found in enumerate(self._models):
            lanes = np.flatnonzero(model == number)
            if lanes.size:
                yield found, lanes, member[lanes], at.take(lanes)
