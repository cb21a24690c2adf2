"""The conductor: a mirror, or microfacets, with the Fresnel reflectance of a metal.

Parameters: eta, k, reflectance (3 each), the roughnesses along the two tangents, both 0 for a mirror.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.features import SceneFeatures
from engines.kernels.lane.bsdf.interface import ALL, SPECULAR_REFLECTION, BSDFSample, LaneBSDF, Spectrum
from engines.kernels.lane.fresnel import fresnel_conductor, reflect
from engines.kernels.lane.microfacet import Distribution, half_vector
from engines.kernels.lane.vector import BLACK, Vec3, dot, frame_at, to_local, to_world

PARAMETERS = 11


@inline
def _roughness(parameters):
    """(whether it is rough, ax, ay), these above 0."""
    rough = parameters[9] > 0.0
    return rough, select(rough, parameters[9], 1.0), select(rough, parameters[10], 1.0)


@inline
def _reflectance(parameters, cos):
    """Fresnel's, times the material's factor."""
    eta, k = Vec3(parameters[0], parameters[1], parameters[2]), Vec3(parameters[3], parameters[4], parameters[5])
    return Vec3(parameters[6], parameters[7], parameters[8]) * fresnel_conductor(cos, eta, k)


@inline
def albedos(parameters, si):
    return BLACK, _reflectance(parameters, const(1.0, si.t))


@cache
def _make(distribution: Distribution, tangents: bool) -> LaneBSDF:
    frame_of, (density_of, masking, visible_masking, visible_normal, exact) = frame_at(tangents), distribution

    @inline
    def evaluate(parameters, si, wi):
        rough, ax, ay = _roughness(parameters)
        frame = frame_of(si)
        wo, wi = to_local(frame, -si.direction), to_local(frame, wi)
        m = half_vector(wo, wi)
        value = density_of(m, ax, ay) * masking(wo, ax, ay) * masking(wi, ax, ay) / (4.0 * wo.z)
        valid = rough & (wo.z > 0.0) & (wi.z > 0.0)
        return Spectrum(_reflectance(parameters, dot(wo, m)), select(valid, value, 0.0))

    @inline
    def pdf(parameters, si, wi):
        rough, ax, ay = _roughness(parameters)
        frame = frame_of(si)
        wo, wi = to_local(frame, -si.direction), to_local(frame, wi)
        density = density_of(half_vector(wo, wi), ax, ay) * visible_masking(wo, ax, ay) / (4.0 * wo.z)
        return select(rough & (wo.z > 0.0) & (wi.z > 0.0), density, 0.0)

    @inline
    def sample(parameters, si, u_lobe, u0, u1, which):
        rough, ax, ay = _roughness(parameters)
        frame = frame_of(si)
        wo = to_local(frame, -si.direction)
        m = visible_normal(wo, ax, ay, u0, u1)
        m = Vec3(select(rough, m.x, 0.0), select(rough, m.y, 0.0), select(rough, m.z, 1.0))
        cos = dot(wo, m)
        wi = m * (2.0 * cos) - wo
        above = (wo.z > 0.0) & (wi.z > 0.0)
        visible, weight = visible_masking(wo, ax, ay), masking(wi, ax, ay)
        if not exact:
            weight = weight * (masking(wo, ax, ay) / visible)
        density = density_of(m, ax, ay) * visible / (4.0 * wo.z)
        world = select(rough, to_world(frame, wi), reflect(si.direction, si.normal))
        spectrum = Spectrum(_reflectance(parameters, cos), select(rough, weight, 1.0))
        # of the lobes apart, there is the specular reflection alone
        valid = above & ((which == ALL) | ((which == SPECULAR_REFLECTION) & (not rough)))
        return BSDFSample(world, spectrum, select(rough, density, math.inf), False, valid)

    @inline
    def only_delta(parameters):
        return not _roughness(parameters)[0]

    return LaneBSDF(evaluate, pdf, sample, albedos, only_delta=only_delta)


def maker(distribution: Distribution) -> Callable[[SceneFeatures], LaneBSDF]:
    """What gives the model's functions in a scene of given features."""
    return lambda features: _make(distribution, features.tangents)
