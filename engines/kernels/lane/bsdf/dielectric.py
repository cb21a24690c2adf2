"""Glass: reflection and refraction chosen by Fresnel's reflectance, at a smooth interface or at microfacets (Walter et al.
2007).

Parameters: ior, the roughnesses along the two tangents, reflectance, transmittance (3 each). The smooth models do not read
the roughnesses.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.features import SceneFeatures
from engines.kernels.lane.bsdf.interface import (
    ALL,
    SPECULAR_REFLECTION,
    BSDFSample,
    LaneBSDF,
    Spectrum,
    always_delta,
    delta,
    no_pdf,
    no_value,
)
from engines.kernels.lane.fresnel import fresnel_dielectric, reflect, refract
from engines.kernels.lane.microfacet import Distribution, half_vector
from engines.kernels.lane.vector import BLACK, Vec3, dot, frame_at, to_local, to_world

PARAMETERS = 9


@inline
def _reflectance(parameters):
    return Vec3(parameters[3], parameters[4], parameters[5])


@inline
def _transmittance(parameters):
    return Vec3(parameters[6], parameters[7], parameters[8])


@inline
def _albedos(parameters, si):
    return BLACK, _transmittance(parameters)


@inline
def _delta_lobes(parameters, si, u_lobe, which, reflectance, mirror, transmitted, scale):
    """A mirror of this reflectance, and what passes along `transmitted`: one of them, or both by chance."""
    is_reflection = (which == SPECULAR_REFLECTION) | ((which == ALL) & (u_lobe < reflectance))
    share = select(is_reflection, reflectance, 1.0 - reflectance)
    weight = select(is_reflection, 1.0, scale)
    if which != ALL:
        weight = weight * share
    color = select(is_reflection, _reflectance(parameters), _transmittance(parameters))
    return delta(select(is_reflection, mirror, transmitted), color, weight, not is_reflection, share > 0.0)


@inline
def _sample_smooth(parameters, si, u_lobe, u0, u1, which):
    glass = refract(si.direction, si.normal, select(si.front, parameters[0], 1.0 / parameters[0]))
    mirror = reflect(si.direction, si.normal)
    return _delta_lobes(parameters, si, u_lobe, which, glass.reflectance, mirror, glass.direction, glass.scale)


@inline
def _mirrored_share(direction, normal, ior):
    """Of a pane, with all reflections between its faces."""
    f = fresnel_dielectric(-dot(direction, normal), ior).reflectance
    return 2.0 * f / (1.0 + f)


@inline
def _sample_thin(parameters, si, u_lobe, u0, u1, which):
    share, mirror = _mirrored_share(si.direction, si.normal, parameters[0]), reflect(si.direction, si.normal)
    return _delta_lobes(parameters, si, u_lobe, which, share, mirror, si.direction, 1.0)


@inline
def _through_thin(parameters, direction, normal):
    return _transmittance(parameters) * (1.0 - _mirrored_share(direction, normal, parameters[0]))


SMOOTH = LaneBSDF(no_value, no_pdf, _sample_smooth, _albedos, ior=0, only_delta=always_delta)
THIN = LaneBSDF(no_value, no_pdf, _sample_thin, _albedos, _through_thin, only_delta=always_delta)


class _Microfacet(NamedTuple):
    """A facet with normal m that sends light from wi to wo, or its reverse. eta is that of the far side over the near one."""

    reflectance: float
    reflection: float
    """F D(m) / (4 wo.z): times masking, the reflected value (with the cosine), or its density."""
    transmission: float
    """The same of what is refracted: its value."""


@cache
def _make(distribution: Distribution, tangents: bool) -> LaneBSDF:
    frame_of, (density_of, masking, visible_masking, visible_normal, exact) = frame_at(tangents), distribution

    @inline
    def facet(wo, wi, m, ax, ay, eta):
        out, into = dot(wo, m), dot(wi, m)
        f = fresnel_dielectric(out, eta).reflectance
        d = density_of(m, ax, ay) / wo.z
        across = out + eta * into
        return _Microfacet(f, f * d / 4.0, (1.0 - f) * d * out * abs(into) / (across * across))

    @inline
    def of_directions(parameters, si, wi):
        """(the facet between wo and wi, whether it reflects, whether there is one, wo, wi, eta)."""
        frame = frame_of(si)
        wo, wi = to_local(frame, -si.direction), to_local(frame, wi)
        eta = select(si.front, parameters[0], 1.0 / parameters[0])
        reflects = wi.z > 0.0
        m = half_vector(wo, wi * select(reflects, 1.0, eta))
        m = m * select(m.z < 0.0, -1.0, 1.0)
        through = (wi.z < 0.0) & (dot(wo, m) > 0.0) & (dot(wi, m) < 0.0)
        valid = (wo.z > 0.0) & (reflects | through)
        return facet(wo, wi, m, parameters[1], parameters[2], eta), reflects, valid, wo, wi, eta

    @inline
    def evaluate(parameters, si, wi):
        found, reflects, valid, wo, wi, _ = of_directions(parameters, si, wi)
        ax, ay = parameters[1], parameters[2]
        value = select(reflects, found.reflection, found.transmission) * masking(wo, ax, ay) * masking(wi, ax, ay)
        color = select(reflects, _reflectance(parameters), _transmittance(parameters))
        return Spectrum(color, select(valid, value, 0.0))

    @inline
    def pdf(parameters, si, wi):
        found, reflects, valid, wo, wi, eta = of_directions(parameters, si, wi)
        density = select(reflects, found.reflection, found.transmission * (eta * eta))
        return select(valid, density * visible_masking(wo, parameters[1], parameters[2]), 0.0)

    @inline
    def sample(parameters, si, u_lobe, u0, u1, which):
        ax, ay, frame = parameters[1], parameters[2], frame_of(si)
        wo, eta = to_local(frame, -si.direction), select(si.front, parameters[0], 1.0 / parameters[0])
        m = visible_normal(wo, ax, ay, u0, u1)
        out = dot(wo, m)
        fresnel = fresnel_dielectric(out, eta)
        reflects = u_lobe < fresnel.reflectance
        along, back = select(reflects, 2.0 * out, out / eta - fresnel.cos_transmitted), select(reflects, 1.0, 1.0 / eta)
        wi = m * along - wo * back
        found = facet(wo, wi, m, ax, ay, eta)
        visible, weight = visible_masking(wo, ax, ay), masking(wi, ax, ay)
        if not exact:
            weight = weight * (masking(wo, ax, ay) / visible)
        density = select(reflects, found.reflection, found.transmission * (eta * eta)) * visible
        color = select(reflects, _reflectance(parameters), _transmittance(parameters))
        spectrum = Spectrum(color, weight * select(reflects, 1.0, 1.0 / (eta * eta)))
        valid = (which == ALL) & (wo.z > 0.0) & (select(reflects, wi.z, -wi.z) > 0.0)
        return BSDFSample(to_world(frame, wi), spectrum, density, not reflects, valid)

    return LaneBSDF(evaluate, pdf, sample, _albedos, ior=0)


def maker(distribution: Distribution) -> Callable[[SceneFeatures], LaneBSDF]:
    """What gives the functions of the rough model in a scene of given features."""
    return lambda features: _make(distribution, features.tangents)
