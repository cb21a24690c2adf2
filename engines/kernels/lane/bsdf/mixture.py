"""The dissertation's material: a Lambertian part kd, a mirror ks and a refraction kt, with exact Fresnel where wanted.

One lobe is chosen in proportion to the sum of its colour's channels. Parameters: kd, ks, kt (3 each), ior, 1 with
Fresnel.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.features import SceneFeatures
from engines.kernels.lane.bsdf.interface import ALL, SPECULAR_REFLECTION, BSDFSample, LaneBSDF, Spectrum
from engines.kernels.lane.fresnel import reflect, refract
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf
from engines.kernels.lane.vector import Vec3, dot, largest, total

_KD, _KS, _KT, _INTERFACE = range(3), range(3, 6), range(6, 9), range(9, 11)


class Lobes(NamedTuple):
    """The three lobes as `si` meets them. `d`, `r` and `t` are the sums of their weights, Fresnel's included; `scale` is the
    factor of refraction on radiance."""

    kd: Vec3
    ks: Vec3
    kt: Vec3
    fresnel_ks: float
    fresnel_kt: float
    d: float
    r: float
    t: float
    reflected: Vec3
    refracted: Vec3
    through: bool
    scale: float


def columns(features: SceneFeatures) -> tuple[int, ...]:
    """The parameters that are read in a scene of these features."""
    specular = features.mirror or features.refraction
    return (
        *(_KD if features.diffuse else ()),
        *(_KS if features.mirror else ()),
        *(_KT if features.refraction else ()),
        *(_INTERFACE if specular else ()),
    )


def make(features: SceneFeatures) -> LaneBSDF:
    """The model's functions in a scene of these features."""
    return _make(features.diffuse, features.mirror, features.refraction)


@cache
def _make(diffuse: bool, reflection: bool, transmission: bool) -> LaneBSDF:
    specular = reflection or transmission

    @inline
    def lobes_of(parameters, si):
        zero = const(0.0, si.t)
        none = Vec3(zero, zero, zero)
        kd = Vec3(parameters[0], parameters[1], parameters[2]) if diffuse else none
        if not specular:
            return Lobes(kd, none, none, 1.0, 1.0, total(kd), zero, zero, none, none, False, 1.0)
        ks = Vec3(parameters[3], parameters[4], parameters[5]) if reflection else none
        kt = Vec3(parameters[6], parameters[7], parameters[8]) if transmission else none
        eta = select(si.front, parameters[9], 1.0 / parameters[9])
        glass = refract(si.direction, si.normal, eta)
        weighted = parameters[10] > zero
        f = select(weighted, glass.reflectance, 1.0)
        g = select(weighted, 1.0 - glass.reflectance, 1.0)
        return Lobes(
            kd,
            ks,
            kt,
            f,
            g,
            total(kd),
            total(ks * f),
            total(kt * g),
            reflect(si.direction, si.normal),
            glass.direction,
            not glass.total,
            glass.scale,
        )

    @inline
    def evaluate(parameters, si, wi):
        zero = const(0.0, si.t)
        kd = Vec3(parameters[0], parameters[1], parameters[2]) if diffuse else Vec3(zero, zero, zero)
        cos = dot(si.normal, wi)
        return Spectrum(kd, select((cos > zero) & (total(kd) > zero), cos, zero) * (1.0 / math.pi))

    @inline
    def pdf(parameters, si, wi):
        lobes = lobes_of(parameters, si)
        q, cos = lobes.d + lobes.r + lobes.t, dot(si.normal, wi)
        return lobes.d / select(q > 0.0, q, 1.0) * select(cos > 0.0, cos, 0.0) * (1.0 / math.pi)

    sample_any = _make_sample_any(lobes_of, specular)

    @inline
    def sample(parameters, si, u_lobe, u0, u1, which):
        if which == ALL:
            return sample_any(parameters, si, u_lobe, u0, u1)
        lobes = lobes_of(parameters, si)
        infinite = const(math.inf, si.t)
        if which == SPECULAR_REFLECTION:
            weight = Spectrum(lobes.ks, lobes.fresnel_ks)
            return BSDFSample(lobes.reflected, weight, infinite, False, lobes.r > 0.0)
        weight = Spectrum(lobes.kt, lobes.fresnel_kt * lobes.scale)
        return BSDFSample(lobes.refracted, weight, infinite, lobes.through, lobes.t > 0.0)

    @inline
    def albedos(parameters, si):
        zero = const(0.0, si.t)
        none = Vec3(zero, zero, zero)
        kd = Vec3(parameters[0], parameters[1], parameters[2]) if diffuse else none
        ks = Vec3(parameters[3], parameters[4], parameters[5]) if reflection else none
        kt = Vec3(parameters[6], parameters[7], parameters[8]) if transmission else none
        shown = select(largest(kt) > zero, kt, none)
        shown = select(largest(ks) > zero, ks, shown)
        return kd, select(largest(kd) > zero, kd, shown)

    @inline
    def only_delta(parameters):
        return not (total(Vec3(parameters[0], parameters[1], parameters[2])) > 0.0) if diffuse else True

    return LaneBSDF(evaluate, pdf, sample, albedos, ior=_INTERFACE[0] if transmission else None, only_delta=only_delta)


def _make_sample_any(lobes_of: Any, specular: bool) -> Any:
    """The function `sample` that chooses among all lobes."""

    @inline
    def sample_any(parameters, si, u_lobe, u0, u1):
        lobes = lobes_of(parameters, si)
        d, r, t = lobes.d, lobes.r, lobes.t
        q = d + r + t
        share = d / select(q > 0.0, q, 1.0)
        wi = cosine_direction(si.normal, u0, u1)
        pdf = share * cosine_pdf(si.normal, wi)
        weight = Spectrum(lobes.kd, q / select(d > 0.0, d, 1.0))
        transmitted = False
        if specular:
            u = u_lobe * q
            is_diffuse, is_reflection = u < d, (u >= d) & (u < d + r)
            transmitted = (u >= d + r) & lobes.through
            ks, kt = lobes.ks * lobes.fresnel_ks, lobes.kt * lobes.fresnel_kt
            refraction = kt * (q / select(t > 0.0, t, 1.0))
            color = select(is_diffuse, lobes.kd, select(is_reflection, ks, refraction))
            scale = select(is_reflection, q / select(r > 0.0, r, 1.0), lobes.scale)
            weight = Spectrum(color, select(is_diffuse, weight.scale, scale))
            wi = select(is_diffuse, wi, select(is_reflection, lobes.reflected, lobes.refracted))
            pdf = select(is_diffuse, pdf, math.inf)
        return BSDFSample(wi, weight, pdf, transmitted, q > 0.0)

    return sample_any
