"""The sheen of cloth at grazing angles (Burley 2012): f = color (1 - cos_d)^5, cos_d the cosine between wi and the half vector.

Parameters: color (3). Directions are sampled by the cosine rule.
"""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.bsdf.interface import ALL, BSDFSample, LaneBSDF, Spectrum
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import BLACK, Vec3, dot

PARAMETERS = 3


@inline
def _color(parameters):
    return Vec3(parameters[0], parameters[1], parameters[2])


@inline
def _fifth_power(si, wi):
    """(1 - cos_d)^5."""
    square = 0.5 - 0.5 * dot(si.direction, wi)
    rest = 1.0 - sqrt(select(square > 0.0, square, 0.0))
    return rest * rest * rest * rest * rest


@inline
def _evaluate(parameters, si, wi):
    cos = dot(si.normal, wi)
    return Spectrum(_color(parameters), select(cos > 0.0, cos, 0.0) * _fifth_power(si, wi))


@inline
def _pdf(parameters, si, wi):
    return cosine_pdf(si.normal, wi)


@inline
def _sample(parameters, si, u_lobe, u0, u1, which):
    wi = cosine_direction(si.normal, u0, u1)
    weight = Spectrum(_color(parameters), math.pi * _fifth_power(si, wi))
    return BSDFSample(wi, weight, cosine_pdf(si.normal, wi), False, which == ALL)


@inline
def _albedos(parameters, si):
    return BLACK, _color(parameters)


SHEEN = LaneBSDF(_evaluate, _pdf, _sample, _albedos)
