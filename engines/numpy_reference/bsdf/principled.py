"""Disney's BSDF (Burley 2012 and 2015) in Mitsuba 3's form: base, microfacets that reflect and refract, clearcoat and sheen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.bsdf import ggx
from engines.numpy_reference.bsdf.facets import Facets
from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.interface import BSDFSample, Lobes, index_ratio, reflects, refracted, transmits
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter, NumberParameter
from engines.numpy_reference.vectors import Array, Indices, Mask, cosine_hemisphere, dot
from engines.scene import Principled

LUMINANCE = np.array([[0.212671], [0.715160], [0.072169]])
NUMBERS = (
    "roughness",
    "anisotropic",
    "metallic",
    "spec_tint",
    "sheen",
    "sheen_tint",
    "clearcoat",
    "clearcoat_gloss",
    "flatness",
    "spec_trans",
)
COAT_ROUGHNESS = 0.25
"""In the masking of the clearcoat, whatever its gloss."""


class PrincipledBSDF:
    """All principled leaves of a scene. One that transmits nothing is the same on both sides; the others are seen from inside
    from the back, where light is only reflected or refracted."""

    def __init__(self, leaves: Sequence[Principled]) -> None:
        self._color = ColorParameter([leaf.base_color for leaf in leaves])
        self._numbers = {name: NumberParameter([getattr(leaf, name) for leaf in leaves]) for name in NUMBERS}
        transmittance = self._numbers["spec_trans"]
        self._transmits: Mask = transmittance.textured | (transmittance.largest > 0.0)
        eta = np.array([leaf.eta for leaf in leaves], np.float64)
        self._eta = np.where(self._transmits & (eta == 1.0), 1.001, eta)
        reflection = Lobes.DIFFUSE_REFLECTION | Lobes.GLOSSY_REFLECTION
        self.lobes = reflection.value + np.where(self._transmits, Lobes.GLOSSY_TRANSMISSION.value, 0)

    def sample(
        self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array, lobes: Lobes = Lobes.ALL
    ) -> BSDFSample:
        """A lobe by its weight, and a direction of it."""
        found = BSDFSample.empty(member.size)
        lanes = np.flatnonzero(self.lobes[member] & lobes)
        found.put(lanes, *self._sample(member[lanes], at.take(lanes), uc[lanes], u0[lanes], u1[lanes]))
        return found

    def evaluate(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        """The sum of the lobes."""
        value = np.zeros(wi.shape)
        lanes, surface, pair = self._prepared(member, at, wi)
        found = np.where(pair.above, surface.reflected(pair), surface.transmitted(pair))
        value[:, lanes] = np.where(pair.possible, found, 0.0)
        return value

    def pdf(self, member: Indices, at: SurfaceInteraction, wi: Array) -> Array:
        density = np.zeros(member.size)
        lanes, surface, pair = self._prepared(member, at, wi)
        found = np.where(pair.above, surface.pdf_reflected(pair), surface.pdf_transmitted(pair))
        density[lanes] = np.where(pair.possible, found, 0.0)
        return density

    def diffuse(self, member: Indices, at: SurfaceInteraction) -> Array:
        metallic, transmittance = (self._numbers[name](member, at) for name in ("metallic", "spec_trans"))
        return (1.0 - metallic) * (1.0 - transmittance) * self._color(member, at)

    def albedo(self, member: Indices, at: SurfaceInteraction) -> Array:
        return self._color(member, at)

    def eta(self, member: Indices, at: SurfaceInteraction) -> Array:
        return index_ratio(at, self._eta[member])

    def _sample(self, member: Indices, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array) -> BSDFSample:
        surface = self._surface(member, at)
        facets, eta = surface.facets, surface.eta
        u = uc * surface.total
        # the main microfacets
        m = facets.sample_visible(u0, u1)
        fresnel, c2 = fresnel_dielectric(dot(facets.wo, m), eta)
        mirror = u < surface.share_reflected(fresnel)
        local = np.where(mirror, facets.mirrored(m), refracted(facets.wo, m, c2, eta))
        # the clearcoat
        coat = surface.sample_coat(u0, u1)
        in_coat = (u >= 1.0) & (u < 1.0 + 0.25 * surface.clearcoat)
        local = np.where(in_coat, facets.mirrored(coat), local)
        # the base
        in_base = (u >= 1.0) & ~in_coat
        wi = np.where(in_base, cosine_hemisphere(at.normal, u0, u1), facets.frame.to_world(local))
        good = np.where(mirror | (u >= 1.0), reflects(at, wi), transmits(at, wi))
        good &= ~in_coat | (dot(facets.wo, coat) > 0.0)
        pdf = self.pdf(member, at, wi)
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = self.evaluate(member, at, wi) * np.abs(dot(at.normal, wi)) / pdf
        return BSDFSample(wi, np.where(good & (pdf > 0.0), weight, 0.0), pdf)

    def _surface(self, member: Indices, at: SurfaceInteraction) -> _Surface:
        front = at.front | ~self._transmits[member]
        numbers = {name: parameter(member, at) for name, parameter in self._numbers.items()}
        aspect = np.sqrt(1.0 - 0.9 * numbers.pop("anisotropic"))
        rough2 = numbers["roughness"] ** 2
        alpha = np.maximum(1e-3, np.stack([rough2 / aspect, rough2 * aspect]))
        facets = Facets.around(at, alpha, np.zeros(member.size, bool))
        eta = self._eta[member]
        path_eta = np.where(front, eta, 1.0 / eta)
        return _Surface(facets=facets, front=front, outer=eta, eta=path_eta, color=self._color(member, at), **numbers)

    def _prepared(self, member: Indices, at: SurfaceInteraction, wi: Array) -> tuple[Indices, _Surface, _Pair]:
        """The points where `wi` may be scattered to `wo`, their surfaces, and the pairs of directions."""
        lanes = np.flatnonzero(reflects(at, wi) | (transmits(at, wi) & self._transmits[member]))
        at = at.take(lanes)
        surface = self._surface(member[lanes], at)
        towards = surface.facets.frame.to_local(wi.take(lanes, axis=1))
        m, possible = surface.facets.halfway(towards, surface.eta)
        cosine = dot(surface.facets.wo, m)
        fresnel, _ = fresnel_dielectric(cosine, surface.eta)
        possible &= surface.front | (surface.dielectric > 0.0)
        return lanes, surface, _Pair(towards, towards[2] > 0.0, m, cosine, fresnel, possible)


BSDFS = {Principled: PrincipledBSDF}


class _Pair(NamedTuple):
    """Where light comes from, at n points, and the facets that send it to the viewer."""

    wi: Array
    """(3, n) in the local frame."""
    above: Mask
    m: Array
    cosine: Array
    """(n,) wo . m."""
    fresnel: Array
    """(n,) reflectance of the facets if they are those of a dielectric."""
    possible: Mask
    """(n,) whether facets can do it."""


class _Surface(NamedTuple):
    """The parameters of n points, (n,) where nothing else is said."""

    facets: Facets
    front: Mask
    outer: Array
    """Index of the inside over that of the outside."""
    eta: Array
    """Index behind the surface over the one before it, as the viewer sees it."""
    color: Array
    """(3, n)"""
    roughness: Array
    metallic: Array
    spec_tint: Array
    sheen: Array
    sheen_tint: Array
    clearcoat: Array
    clearcoat_gloss: Array
    flatness: Array
    spec_trans: Array

    @property
    def opaque(self) -> Array:
        """Weight of the diffuse base."""
        return (1.0 - self.metallic) * (1.0 - self.spec_trans)

    @property
    def dielectric(self) -> Array:
        """Weight of the glass."""
        return (1.0 - self.metallic) * self.spec_trans

    @property
    def tint(self) -> Array:
        """(3, n) the base color at luminance 1; white where it is black."""
        luminance = (LUMINANCE * self.color).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(luminance > 0.0, self.color / luminance, 1.0)

    # values

    def reflected(self, pair: _Pair) -> Array:
        """(3, n) the lobes above the surface."""
        value = np.where(self.outer != 1.0, self.facets.reflected(self._reflectance(pair), pair.wi, pair.m), 0.0)
        in_front = self._coat(pair) + self.opaque * self.color / np.pi * self._base(pair) + self._sheen(pair)
        return value + np.where(self.front, in_front, 0.0)

    def transmitted(self, pair: _Pair) -> Array:
        """(3, n) the lobe below the surface."""
        transmittance = np.sqrt(self.color) * self.dielectric * (1.0 - pair.fresnel)
        return self.facets.transmitted(transmittance, pair.wi, pair.m, self.eta)

    def _reflectance(self, pair: _Pair) -> Array:
        """(3, n) of the main facets: in front between those of a dielectric and a metal, behind those of a dielectric."""
        normal = ((self.outer - 1.0) / (self.outer + 1.0)) ** 2
        dielectric = (1.0 - self.spec_tint) * pair.fresnel + self.spec_tint * self._schlick(self.tint * normal, pair)
        metal = self._schlick(self.color, pair)
        mixed = (1.0 - self.metallic) * dielectric + self.metallic * metal
        return np.where(self.front, mixed, self.dielectric * pair.fresnel)

    def _schlick(self, normal: Array | float, pair: _Pair) -> Array:
        """Schlick's approximation, from the reflectance at normal incidence; by the inner angle where that is larger."""
        inner = np.sqrt(np.maximum(0.0, 1.0 - (1.0 - pair.cosine**2) / self.outer**2))
        return normal + (1.0 - normal) * _fifth(np.where(self.outer > 1.0, pair.cosine, inner))

    def _coat(self, pair: _Pair) -> Array:
        rough = np.full((2, pair.cosine.size), COAT_ROUGHNESS)
        masking = ggx.masking(self.facets.wo, rough) * ggx.masking(pair.wi, rough)
        return 0.25 * self.clearcoat * self._schlick(0.04, pair) * self._coat_distribution(pair.m) * masking

    def _base(self, pair: _Pair) -> Array:
        """(n,) Burley's diffuse lobe, and the one that looks like scattering below the surface, over Lambert's."""
        out, into = self.facets.wo[2], pair.wi[2]
        grazing_out, grazing_in = _fifth(out), _fifth(into)
        retro = 2.0 * self.roughness * pair.cosine**2
        diffuse = (1.0 - 0.5 * grazing_out) * (1.0 - 0.5 * grazing_in)
        diffuse += retro * (grazing_out + grazing_in + grazing_out * grazing_in * (retro - 1.0))
        beneath = (1.0 + (0.5 * retro - 1.0) * grazing_out) * (1.0 + (0.5 * retro - 1.0) * grazing_in)
        with np.errstate(divide="ignore"):
            flat = 1.25 * (beneath * (1.0 / (out + into) - 0.5) + 0.5)
        return diffuse + self.flatness * (flat - diffuse)

    def _sheen(self, pair: _Pair) -> Array:
        color = 1.0 + self.sheen_tint * (self.tint - 1.0)
        return self.sheen * (1.0 - self.metallic) * _fifth(pair.cosine) * color

    # densities

    @property
    def total(self) -> Array:
        """The sum of the weights of the lobes, of which the main facets' is 1."""
        return np.where(self.front, 1.0 + 0.25 * self.clearcoat + self.opaque, 1.0)

    def share_reflected(self, fresnel: Array) -> Array:
        """How much of the main facets' weight is that of their reflection."""
        return np.where(self.front, 1.0 - self.dielectric * (1.0 - fresnel), fresnel)

    def pdf_reflected(self, pair: _Pair) -> Array:
        """(n,) per solid angle, of all the lobes above the surface."""
        main = self.share_reflected(pair.fresnel) * self.facets.pdf_reflected(pair.m)
        with np.errstate(divide="ignore", invalid="ignore"):
            coat = self.clearcoat * 0.25 * self._coat_distribution(pair.m) * pair.m[2] / (4.0 * pair.cosine)
        return (main + np.where(self.front, coat + self.opaque * pair.wi[2] / np.pi, 0.0)) / self.total

    def pdf_transmitted(self, pair: _Pair) -> Array:
        share = 1.0 - self.share_reflected(pair.fresnel)
        return share / self.total * self.facets.pdf_transmitted(pair.wi, pair.m, self.eta)

    def sample_coat(self, u0: Array, u1: Array) -> Array:
        """(3, n) normals of the clearcoat's facets with the density D(m) m.z."""
        rough2 = self._coat_roughness2
        cosine2 = (1.0 - rough2 ** (1.0 - u1)) / (1.0 - rough2)
        sine, phi = np.sqrt(np.maximum(0.0, 1.0 - cosine2)), 2.0 * np.pi * u0
        return np.stack([sine * np.cos(phi), sine * np.sin(phi), np.sqrt(cosine2)])

    def _coat_distribution(self, m: Array) -> Array:
        """(n,) D(m) with the longer tail of exponent 1 (GTR1)."""
        rough2 = self._coat_roughness2
        return (rough2 - 1.0) / (np.pi * np.log(rough2) * (1.0 + (rough2 - 1.0) * m[2] ** 2))

    @property
    def _coat_roughness2(self) -> Array:
        return (0.1 + (0.001 - 0.1) * self.clearcoat_gloss) ** 2


def _fifth(cosine: Array) -> Array:
    """Schlick's (1 - cos)^5."""
    return np.clip(1.0 - cosine, 0.0, 1.0) ** 5
