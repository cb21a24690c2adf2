"""A diffuse base under a dielectric coat, which is smooth or made of microfacets."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.bsdf.facets import Facets
from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, has, mirrored, reflects, refracted
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter
from engines.numpy_reference.vectors import Array, Frame, Indices, cosine_hemisphere, dot, unit
from engines.scene import Plastic

SMOOTH = Lobes.SPECULAR_REFLECTION | Lobes.DIFFUSE_REFLECTION
ROUGH = Lobes.GLOSSY_REFLECTION | Lobes.DIFFUSE_REFLECTION
NODES = 64
"""Of the tables of rough interfaces, and points along either draw for each node."""


class PlasticBSDF:
    """All plastics of a scene, the same on both sides. What enters the coat is spread by the base, and leaves it at once or
    after reflections inside, of which `inside` is the share F_dr."""

    def __init__(self, leaves: Sequence[Plastic]) -> None:
        self._ior = np.array([leaf.ior for leaf in leaves], np.float64)
        self._diffuse = ColorParameter([leaf.diffuse for leaf in leaves])
        self._reflectance = ColorParameter([leaf.reflectance for leaf in leaves])
        self._alpha = np.array([leaf.alpha for leaf in leaves], np.float64)
        self._beckmann = np.array([leaf.distribution == "beckmann" for leaf in leaves], bool)
        self._nonlinear = np.array([leaf.nonlinear for leaf in leaves], bool)
        self._smooth = self._alpha == 0.0
        self.lobes = np.where(self._smooth, SMOOTH.value, ROUGH.value)
        coats = [_smooth_coat(leaf.ior) if leaf.alpha == 0.0 else _rough_coat(leaf) for leaf in leaves]
        self._inside = np.array([coat.inside for coat in coats], np.float64)
        self._passes = np.array([coat.passes for coat in coats], np.float64).reshape(-1, NODES)
        specular, base = (colour.mean.mean(axis=0) for colour in (self._reflectance, self._diffuse))
        with np.errstate(invalid="ignore"):
            self._share = np.where(specular + base > 0.0, specular / (specular + base), 0.0)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """The coat with a probability that its reflectance gives, else the base."""
        found = BSDFSample.empty(member.size)
        lanes = np.flatnonzero(self._smooth[member] & ((self.lobes[member] & lobes) != 0))
        found.put(lanes, *self._sample_smooth(member[lanes], at.take(lanes), uc[lanes], u0[lanes], u1[lanes], lobes))
        lanes = np.flatnonzero(~self._smooth[member] & ((self.lobes[member] & lobes) != 0))
        found.put(lanes, *self._sample_rough(member[lanes], at.take(lanes), uc[lanes], u0[lanes], u1[lanes]))
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """The base as it is seen through the coat, and the coat where it is rough."""
        value = np.zeros(wi.shape)
        lanes = np.flatnonzero(reflects(at, wi))
        member, at, wi = member[lanes], at.take(lanes), wi.take(lanes, axis=1)
        value[:, lanes] = self._base(member, at, wi)
        rough = np.flatnonzero(~self._smooth[member])
        facets, towards, m, which, here = self._facets(member, at, wi, rough)
        reflectance, _ = fresnel_dielectric(dot(facets.wo, m), self._ior[which])
        value[:, lanes[rough]] += facets.reflected(self._reflectance(which, here) * reflectance, towards, m)
        return value

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        density = np.zeros(member.size)
        lanes = np.flatnonzero(reflects(at, wi))
        member, at, wi = member[lanes], at.take(lanes), wi.take(lanes, axis=1)
        specular = self._specular(member, at)
        density[lanes] = (1.0 - specular) * dot(at.normal, wi) / np.pi
        rough = np.flatnonzero(~self._smooth[member])
        facets, _, m, _, _ = self._facets(member, at, wi, rough)
        density[lanes[rough]] += specular[rough] * facets.pdf_reflected(m)
        return density

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._diffuse(member, at)

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._diffuse(member, at)

    def _sample_smooth(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes
    ) -> BSDFSample:
        specular = self._specular(member, at) if lobes & Lobes.DIFFUSE_REFLECTION else np.ones(member.size)
        specular = specular * has(lobes, Lobes.SPECULAR_REFLECTION)
        mirror = uc < specular
        wi = np.where(mirror, mirrored(at), cosine_hemisphere(at.normal, u0, u1))
        base = 1.0 - specular
        with np.errstate(divide="ignore", invalid="ignore"):
            coat = self._reflectance(member, at) * (1.0 - self._transmitted(member, dot(at.wo, at.normal))) / specular
            weight = np.where(mirror, coat, self._base(member, at, wi) * np.pi / base)
        pdf = np.where(mirror, np.inf, base * dot(at.normal, wi) / np.pi)
        return BSDFSample(wi, np.where(reflects(at, wi), weight, 0.0), pdf)

    def _sample_rough(self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array) -> BSDFSample:
        facets = self._rough(member, at)
        coat = facets.frame.to_world(facets.mirrored(facets.sample_visible(u0, u1)))
        wi = np.where(uc < self._specular(member, at), coat, cosine_hemisphere(at.normal, u0, u1))
        pdf = self.pdf(member, at, wi)
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = self.evaluate(member, at, wi) * dot(at.normal, wi) / pdf
        return BSDFSample(wi, np.where(pdf > 0.0, weight, 0.0), pdf)

    def _base(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """(3, n) value of the diffuse base."""
        colour, ior = self._diffuse(member, at), self._ior[member]
        through = self._transmitted(member, dot(at.wo, at.normal)) * self._transmitted(member, dot(wi, at.normal))
        again = np.where(self._nonlinear[member], colour, 1.0) * self._inside[member]
        return through * colour / (np.pi * ior**2 * (1.0 - again))

    def _specular(self, member: Indices, at: SurfaceInteraction) -> Array:
        """(n,) probability of the coat, among both lobes."""
        coat = 1.0 - self._transmitted(member, dot(at.wo, at.normal))
        share = self._share[member]
        with np.errstate(invalid="ignore"):
            chosen = coat * share / (coat * share + (1.0 - coat) * (1.0 - share))
        return np.where(np.isnan(chosen), 0.0, chosen)

    def _transmitted(self, member: Indices, cosine: Array) -> Array:
        """(n,) share of the light under this cosine that passes the coat, from either side by reciprocity."""
        smooth = 1.0 - fresnel_dielectric(cosine, self._ior[member])[0]
        if self._smooth.all():
            return smooth
        place = np.clip(cosine, 0.0, 1.0) * (NODES - 1)
        node = np.minimum(place.astype(np.int64), NODES - 2)
        rest, table = place - node, self._passes[member]
        lanes = np.arange(node.size)
        rough = table[lanes, node] * (1.0 - rest) + table[lanes, node + 1] * rest
        return np.where(self._smooth[member], smooth, rough)

    def _rough(self, member: Indices, at: SurfaceInteraction) -> Facets:
        return Facets.around(at, np.stack([self._alpha[member]] * 2), self._beckmann[member])

    def _facets(
        self, member: Indices, at: SurfaceInteraction, wi: Array, lanes: Indices
    ) -> tuple[Facets, Array, Array, Indices, SurfaceInteraction]:
        """Of rough coats, some of the points: facets, local `wi`, normals that reflect it to `wo`, and members and points."""
        which, here = member[lanes], at.take(lanes)
        facets = self._rough(which, here)
        towards = facets.frame.to_local(wi.take(lanes, axis=1))
        return facets, towards, unit(facets.wo + towards), which, here


BSDFS = {Plastic: PlasticBSDF}


class _Coat(NamedTuple):
    """What a coat does with light from everywhere."""

    inside: float
    """F_dr, the share of diffuse light in the coat that it reflects back to the base."""
    passes: Array
    """(NODES,) share of the light that passes it, at even cosines from 0 to 1; ones where it is smooth, and not used."""


def _smooth_coat(ior: float) -> _Coat:
    """The fit of Egan and Hilgeman to the integral of Fresnel's equations."""
    return _Coat(0.0636 * ior + 0.6681 + 0.7099 / ior - 1.4399 / ior**2, np.ones(NODES))


def _rough_coat(leaf: Plastic) -> _Coat:
    return _tabulated(leaf.alpha, leaf.ior, leaf.distribution == "beckmann")


@lru_cache(maxsize=64)
def _tabulated(alpha: float, ior: float, beckmann: bool) -> _Coat:
    """Means over the visible facets of each direction, by Gauss and Legendre's rule."""
    cosine = np.maximum(np.linspace(0.0, 1.0, NODES), 1e-6)
    node, weight = np.polynomial.legendre.leggauss(NODES)
    draw, weights = 0.5 * (node + 1.0), 0.25 * np.outer(weight, weight).reshape(-1)
    held, u0, u1 = (axis.reshape(-1) for axis in np.meshgrid(cosine, draw, draw, indexing="ij"))
    wo = np.stack([np.sqrt(1.0 - held**2), np.zeros(held.size), held])
    x, y, z = (np.broadcast_to(axis[:, None], wo.shape) for axis in np.eye(3))
    facets = Facets(Frame(x, y, z), wo, np.full((2, held.size), alpha), np.full(held.size, beckmann))
    m = facets.sample_visible(u0, u1)

    def mean(share: Array, wi: Array, kept: Array) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(kept, share * facets.masking(wi), 0.0).reshape(NODES, -1) @ weights

    reflectance, c2 = fresnel_dielectric(dot(wo, m), np.full(held.size, ior))
    down = refracted(wo, m, c2, np.full(held.size, ior))
    passes = mean(1.0 - reflectance, down, down[2] < 0.0)
    reflectance, _ = fresnel_dielectric(dot(wo, m), np.full(held.size, 1.0 / ior))
    up = facets.mirrored(m)
    inside = 2.0 / NODES * (cosine * mean(reflectance, up, up[2] > 0.0)).sum()
    return _Coat(float(inside), passes)
