"""Disney's principled BSDF (Burley 2012, 2015) with Mitsuba's parameters, as docs/transport.md has it.

Parameters: base colour (3), roughness, anisotropic, metallic, eta, spec_tint, sheen, sheen_tint, clearcoat, clearcoat_gloss,
flatness, spec_trans (below 0 where it is the constant 0: such a surface has no back). The lobes, in the order in which a draw
finds them: microfacets that reflect or transmit, clearcoat, diffuse.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.features import SceneFeatures
from engines.kernels.lane.bsdf.interface import ALL, BSDFSample, LaneBSDF, Spectrum
from engines.kernels.lane.elementary import exp, log
from engines.kernels.lane.fresnel import fresnel_dielectric
from engines.kernels.lane.microfacet import ggx_density, ggx_masking, ggx_visible_normal, half_vector
from engines.kernels.lane.sampling import cosine_direction
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot, frame_at, sin_cos_turn, to_local, to_world

PARAMETERS = 14


class _Surface(NamedTuple):
    """A material and its facets, met from one side."""

    base: Vec3
    tint: Vec3
    roughness: float
    metallic: float
    eta: float
    """Of the inside over the outside."""
    e: float
    """Of the far side over the near one."""
    spec_tint: float
    sheen: float
    sheen_tint: float
    coat: float
    """A quarter of clearcoat."""
    coat_square: float
    """The squared roughness of clearcoat."""
    flatness: float
    diffuse: float
    """(1 - metallic) (1 - spec_trans)."""
    glass: float
    """(1 - metallic) spec_trans."""
    ax: float
    ay: float
    front: bool


@inline
def _lerp(a, b, t):
    return a + (b - a) * t


@inline
def _fifth(cos):
    """Schlick's weight (1 - cos)^5."""
    rest = 1.0 - cos
    rest = select(rest > 0.0, rest, 0.0)
    rest = select(rest < 1.0, rest, 1.0)
    square = rest * rest
    return square * square * rest


@inline
def _albedos(parameters, si):
    trans = parameters[13]
    base = Vec3(parameters[0], parameters[1], parameters[2])
    return base * ((1.0 - parameters[5]) * (1.0 - select(trans > 0.0, trans, 0.0))), base


@inline
def _schlick(of, cos):
    """The weight of white in Schlick's reflectance: of the cosine in the thinner medium."""
    inside = 1.0 - (1.0 - cos * cos) / (of.eta * of.eta)
    inside = sqrt(select(inside > 0.0, inside, 0.0))
    return _fifth(select(of.eta > 1.0, cos, inside))


@inline
def _metal_and_tint(of, f, w):
    """The reflectance in front: Fresnel's, the metal's and the tinted one."""
    normal = (of.eta - 1.0) / (of.eta + 1.0)
    white = (1.0 - of.metallic) * (1.0 - of.spec_tint) * f
    metal, tinted = of.metallic, (1.0 - of.metallic) * of.spec_tint
    at_normal = of.tint * (normal * normal)
    constant = of.base * (metal * (1.0 - w)) + at_normal * (tinted * (1.0 - w))
    rest = white + (metal + tinted) * w
    return Vec3(constant.x + rest, constant.y + rest, constant.z + rest)


@inline
def _diffuse_and_sheen(of, wo, wi, cos):
    """f of both, in front."""
    wo5, wi5 = _fifth(wo.z), _fifth(wi.z)
    retro = 2.0 * of.roughness * cos * cos
    lambert = (1.0 - 0.5 * wo5) * (1.0 - 0.5 * wi5)
    returned = retro * (wo5 + wi5 + wo5 * wi5 * (retro - 1.0))
    bend = 0.5 * retro - 1.0
    flat = (1.0 + bend * wo5) * (1.0 + bend * wi5)
    between = wo.z + wi.z
    flat = 1.25 * (flat * (1.0 / select(between > 0.0, between, 1.0) - 0.5) + 0.5)
    value = of.diffuse * (1.0 / math.pi) * _lerp(lambert + returned, flat, of.flatness)
    sheen = of.sheen * (1.0 - of.metallic) * _fifth(cos)
    tinted = of.sheen_tint * sheen
    white = sheen - tinted
    color = of.base * value + of.tint * tinted
    return Vec3(color.x + white, color.y + white, color.z + white)


@inline
def _coat_density(of, m):
    """GTR1."""
    rest = of.coat_square - 1.0
    return rest / (math.pi * log(of.coat_square) * (1.0 + rest * m.z * m.z))


@inline
def _coat_normal(of, u0, u1):
    """A normal with density D(m) m.z of the clearcoat."""
    square = (1.0 - exp((1.0 - u1) * log(of.coat_square))) / (1.0 - of.coat_square)
    sine, cosine = sin_cos_turn(u0)
    across = 1.0 - square
    ring = sqrt(select(across > 0.0, across, 0.0))
    return Vec3(ring * cosine, ring * sine, sqrt(select(square > 0.0, square, 0.0)))


@cache
def _make_surface_of(transmission: bool, clearcoat: bool) -> Any:
    """The function (parameters, si) -> surface."""

    @inline
    def surface_of(parameters, si):
        r, g, b, roughness, anisotropic, metallic, eta, spec_tint, sheen, sheen_tint, coat, gloss, flatness, trans = (
            parameters[0],
            parameters[1],
            parameters[2],
            parameters[3],
            parameters[4],
            parameters[5],
            parameters[6],
            parameters[7],
            parameters[8],
            parameters[9],
            parameters[10],
            parameters[11],
            parameters[12],
            parameters[13],
        )
        zero, least = const(0.0, r), const(0.001, r)
        aspect = sqrt(1.0 - 0.9 * anisotropic)
        ax, ay = roughness * roughness / aspect, roughness * roughness * aspect
        ax, ay = select(ax > least, ax, least), select(ay > least, ay, least)
        luminance = 0.212671 * r + 0.715160 * g + 0.072169 * b
        colored = luminance > zero
        scale = 1.0 / select(colored, luminance, 1.0)
        tint = Vec3(select(colored, r * scale, 1.0), select(colored, g * scale, 1.0), select(colored, b * scale, 1.0))
        front, e = True, eta
        if transmission:
            front = si.front | (trans < zero)
            e, trans = select(front, eta, 1.0 / eta), select(trans > zero, trans, zero)
        else:
            trans = zero
        coat_roughness = _lerp(const(0.1, r), least, gloss)
        coat = coat * 0.25 if clearcoat else zero
        return _Surface(
            Vec3(r, g, b),
            tint,
            roughness,
            metallic,
            eta,
            e,
            spec_tint,
            sheen,
            sheen_tint,
            coat,
            coat_roughness * coat_roughness,
            flatness,
            (1.0 - metallic) * (1.0 - trans),
            (1.0 - metallic) * trans,
            ax,
            ay,
            front,
        )

    return surface_of


@cache
def _make_value_and_pdf(transmission: bool, clearcoat: bool) -> Any:
    """The function (surface, wo, wi) -> (f |cos|, pdf), of directions in the local frame."""

    @inline
    def value_and_pdf(of, wo, wi):
        one = const(1.0, wo.z)
        reflects = wi.z > 0.0
        m = half_vector(wo, wi * select(reflects, one, of.e)) if transmission else half_vector(wo, wi)
        m = m * select(m.z < 0.0, -one, one)
        out, into = dot(wo, m), dot(wi, m)
        f = fresnel_dielectric(abs(out), of.e).reflectance  # below 0 nothing is scattered; 0/0 at eta 1
        facets = ggx_density(m, of.ax, of.ay) * ggx_masking(wo, of.ax, of.ay) / wo.z
        shadowing = ggx_masking(wi, of.ax, of.ay)
        through = of.glass * (one - f)
        pdf = (one - through) * facets / 4.0 + of.diffuse * wi.z * (1.0 / math.pi)
        w = _schlick(of, out)
        color = _metal_and_tint(of, f, w)
        if transmission:
            back = of.glass * f
            color = select(of.front, color, Vec3(back, back, back))
        value = color * (select(of.eta == one, 0.0, facets) * shadowing / 4.0)
        lambert = _diffuse_and_sheen(of, wo, wi, out) * wi.z
        if clearcoat:
            quarter = const(0.25, one)
            density = _coat_density(of, m)
            pdf = pdf + of.coat * density * m.z / (4.0 * out)
            coat = _lerp(const(0.04, one), one, w) * density * ggx_masking(wo, quarter, quarter)
            coat = of.coat * coat * ggx_masking(wi, quarter, quarter) * wi.z
            lambert = Vec3(lambert.x + coat, lambert.y + coat, lambert.z + coat)
        pdf = pdf / (one + of.coat + of.diffuse)
        if not transmission:
            valid = reflects & (wo.z > 0.0)
            return Spectrum(value + lambert, select(valid, one, 0.0)), select(valid, pdf, 0.0)
        # behind, microfacets are all there is
        value = value + lambert * select(of.front, one, 0.0)
        pdf = select(of.front, pdf, f * facets / 4.0)
        across = out + of.e * into
        facets = facets * out * abs(into) / (across * across)
        transmitted = of.glass * (one - f) * facets * shadowing
        root = Vec3(sqrt(of.base.x), sqrt(of.base.y), sqrt(of.base.z))
        share = select(of.front, through / (one + of.coat + of.diffuse), one - f)
        pdf = select(reflects, pdf, share * facets * of.e * of.e)
        valid = (wo.z > 0.0) & (of.front | (of.glass > 0.0))
        valid = valid & (reflects | ((wi.z < 0.0) & (out > 0.0) & (into < 0.0)))
        value = select(reflects, value, root * transmitted)
        return Spectrum(value, select(valid, one, 0.0)), select(valid, pdf, 0.0)

    return value_and_pdf


@cache
def _make(transmission: bool, clearcoat: bool, tangents: bool) -> LaneBSDF:
    frame_of, surface_of = frame_at(tangents), _make_surface_of(transmission, clearcoat)
    value_and_pdf = _make_value_and_pdf(transmission, clearcoat)

    @inline
    def at_directions(parameters, si, wi):
        frame = frame_of(si)
        return value_and_pdf(surface_of(parameters, si), to_local(frame, -si.direction), to_local(frame, wi))

    @inline
    def evaluate(parameters, si, wi):
        return at_directions(parameters, si, wi)[0]

    @inline
    def pdf(parameters, si, wi):
        return at_directions(parameters, si, wi)[1]

    @inline
    def sample(parameters, si, u_lobe, u0, u1, which):
        one = const(1.0, si.t)
        of, frame = surface_of(parameters, si), frame_of(si)
        wo = to_local(frame, -si.direction)
        u = u_lobe * (one + of.coat + of.diffuse)
        if transmission:
            u = select(of.front, u, u_lobe)
        m = ggx_visible_normal(wo, of.ax, of.ay, u0, u1)
        facets, transmits = u < one, False
        if clearcoat:
            m = select(facets, m, _coat_normal(of, u0, u1))
        out = dot(wo, m)
        along, back = 2.0 * out, one
        if transmission:
            fresnel = fresnel_dielectric(out, of.e)
            reflected = select(of.front, one - of.glass * (one - fresnel.reflectance), fresnel.reflectance)
            transmits = facets & (u >= reflected)
            along = select(transmits, out / of.e - fresnel.cos_transmitted, along)
            back = select(transmits, one / of.e, one)
        wi = m * along - wo * back
        wi = select(u < one + of.coat, wi, to_local(frame, cosine_direction(si.normal, u0, u1)))
        value, density = value_and_pdf(of, wo, wi)
        positive = density > 0.0
        weight = Spectrum(value.color, value.scale / select(positive, density, one))
        # a facet that is seen from below, or reflects downwards
        side = ((u >= one + of.coat) | (out > 0.0)) & (select(transmits, -wi.z, wi.z) > 0.0)
        return BSDFSample(to_world(frame, wi), weight, density, transmits, (which == ALL) & positive & side)

    return LaneBSDF(evaluate, pdf, sample, _albedos, ior=6 if transmission else None)


def make(features: SceneFeatures) -> LaneBSDF:
    """The model's functions in a scene of these features."""
    return _make(features.spec_trans, features.clearcoat, features.tangents)
