"""A diffuse base under a dielectric coat, smooth or of microfacets (after Mitsuba's plastic and roughplastic).

Parameters: diffuse, reflectance (3 each), ior, roughness, the coat's reflectance from inside F_dr, the specular share s, 1
where light that is reflected inside takes the base's colour each time, and for the rough model where its table begins in
`si.tables`: NODES transmittances of the coat, by the cosine from 0 to 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.features import SceneFeatures
from engines.kernels.lane.bsdf.interface import ALL, SPECULAR_REFLECTION, BSDFSample, LaneBSDF, Spectrum, delta
from engines.kernels.lane.fresnel import fresnel_dielectric, reflect
from engines.kernels.lane.microfacet import Distribution, half_vector
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf
from engines.kernels.lane.target import floor
from engines.kernels.lane.vector import Vec3, dot, frame_at, largest, to_local, to_world

PARAMETERS = 12
NODES = 64


@inline
def _reflectance(parameters):
    return Vec3(parameters[3], parameters[4], parameters[5])


@inline
def _base(parameters):
    """rho / (pi eta^2 (1 - k F_dr)): the colour of the base, times transmittances its value."""
    ior, inside, repeated = parameters[6], parameters[8], parameters[10]
    r, g, b = parameters[0], parameters[1], parameters[2]
    scale = 1.0 / (math.pi * ior * ior)
    r = r * scale / (1.0 - select(repeated > 0.0, r, 1.0) * inside)
    g = g * scale / (1.0 - select(repeated > 0.0, g, 1.0) * inside)
    b = b * scale / (1.0 - select(repeated > 0.0, b, 1.0) * inside)
    return Vec3(r, g, b)


@inline
def _share(reflected, s):
    """The probability of the specular lobe, where the coat reflects this share of the light."""
    both = reflected * s + (1.0 - reflected) * (1.0 - s)
    return select(both > 0.0, reflected * s / select(both > 0.0, both, 1.0), 0.0)


@inline
def _albedos(parameters, si):
    diffuse = Vec3(parameters[0], parameters[1], parameters[2])
    return diffuse, diffuse


@inline
def _evaluate_smooth(parameters, si, wi):
    cos = dot(si.normal, wi)
    near = fresnel_dielectric(-dot(si.direction, si.normal), parameters[6]).reflectance
    far = fresnel_dielectric(cos, parameters[6]).reflectance
    return Spectrum(_base(parameters), select(cos > 0.0, (1.0 - near) * (1.0 - far) * cos, 0.0))


@inline
def _pdf_smooth(parameters, si, wi):
    near = fresnel_dielectric(-dot(si.direction, si.normal), parameters[6]).reflectance
    return (1.0 - _share(near, parameters[9])) * cosine_pdf(si.normal, wi)


@inline
def _sample_smooth(parameters, si, u_lobe, u0, u1, which):
    near = fresnel_dielectric(-dot(si.direction, si.normal), parameters[6]).reflectance
    mirror, color = reflect(si.direction, si.normal), _reflectance(parameters)
    if which != ALL:
        there = (which == SPECULAR_REFLECTION) & (near * largest(color) > 0.0)
        return delta(mirror, color, near, False, there)
    p = _share(near, parameters[9])
    specular = u_lobe < p
    wi = cosine_direction(si.normal, u0, u1)
    far = fresnel_dielectric(dot(si.normal, wi), parameters[6]).reflectance
    share = select(specular, p, 1.0 - p)
    scale = select(specular, near, math.pi * (1.0 - near) * (1.0 - far)) / share
    color = select(specular, color, _base(parameters))
    pdf = select(specular, math.inf, share * cosine_pdf(si.normal, wi))
    valid = largest(color) > 0.0
    return BSDFSample(select(specular, mirror, wi), Spectrum(color, scale), pdf, False, valid)


SMOOTH = LaneBSDF(_evaluate_smooth, _pdf_smooth, _sample_smooth, _albedos)


@inline
def _transmittance(tables, first, cos):
    """The coat's, between the nodes of its table. Lanes of other models, that run along, read within the tables, too."""
    last = const(NODES - 2, cos)
    most = tables[0] - const(NODES, cos)
    first = select(first < most, first, most)
    first = select(first > 1.0, first, 1.0)
    x = select(cos < 1.0, cos, 1.0) * const(NODES - 1, cos)
    x = select(x > 0.0, x, 0.0)
    node = floor(x)
    node = select(node < last, node, last)
    index = np.int32(first) + np.int32(node)
    low, high = tables[index], tables[index + np.int32(1)]
    return low + (high - low) * (x - node)


@cache
def _make(distribution: Distribution, tangents: bool) -> LaneBSDF:
    frame_of, (density_of, masking, visible_masking, visible_normal, _) = frame_at(tangents), distribution

    @inline
    def value_and_pdf(parameters, si, wo, wi, near):
        """(f cos, pdf) in the local frame; `near` is the coat's transmittance towards wo."""
        alpha = parameters[7]
        m = half_vector(wo, wi)
        density = density_of(m, alpha, alpha) / (4.0 * wo.z)
        f = fresnel_dielectric(dot(wo, m), parameters[6]).reflectance
        coat = f * density * masking(wo, alpha, alpha) * masking(wi, alpha, alpha)
        below = near * _transmittance(si.tables, parameters[11], wi.z) * wi.z
        p = _share(1.0 - near, parameters[9])
        pdf = p * density * visible_masking(wo, alpha, alpha) + (1.0 - p) * wi.z * (1.0 / math.pi)
        valid = (wo.z > 0.0) & (wi.z > 0.0)
        value = _reflectance(parameters) * coat + _base(parameters) * below
        return Spectrum(value, select(valid, const(1.0, pdf), 0.0)), select(valid, pdf, 0.0)

    @inline
    def at_directions(parameters, si, wi):
        frame = frame_of(si)
        wo = to_local(frame, -si.direction)
        near = _transmittance(si.tables, parameters[11], wo.z)
        return value_and_pdf(parameters, si, wo, to_local(frame, wi), near)

    @inline
    def evaluate(parameters, si, wi):
        return at_directions(parameters, si, wi)[0]

    @inline
    def pdf(parameters, si, wi):
        return at_directions(parameters, si, wi)[1]

    @inline
    def sample(parameters, si, u_lobe, u0, u1, which):
        alpha = parameters[7]
        frame = frame_of(si)
        wo = to_local(frame, -si.direction)
        near = _transmittance(si.tables, parameters[11], wo.z)
        m = visible_normal(wo, alpha, alpha, u0, u1)
        mirrored = m * (2.0 * dot(wo, m)) - wo
        base = to_local(frame, cosine_direction(si.normal, u0, u1))
        wi = select(u_lobe < _share(1.0 - near, parameters[9]), mirrored, base)
        value, density = value_and_pdf(parameters, si, wo, wi, near)
        positive = density > 0.0
        weight = Spectrum(value.color, value.scale / select(positive, density, 1.0))
        return BSDFSample(to_world(frame, wi), weight, density, False, (which == ALL) & positive)

    return LaneBSDF(evaluate, pdf, sample, _albedos)


def maker(distribution: Distribution) -> Callable[[SceneFeatures], LaneBSDF]:
    """What gives the functions of the rough model in a scene of given features."""
    return lambda features: _make(distribution, features.tangents)
