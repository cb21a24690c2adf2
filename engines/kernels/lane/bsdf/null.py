"""Nothing: every ray goes straight on."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const
from engines.kernels.lane.bsdf.interface import SPECULAR_REFLECTION, LaneBSDF, always_delta, delta, no_pdf, no_value
from engines.kernels.lane.vector import BLACK, WHITE, Vec3


@inline
def _sample(parameters, si, u_lobe, u0, u1, which):
    return delta(si.direction, WHITE, 1.0, True, which != SPECULAR_REFLECTION)


@inline
def _albedos(parameters, si):
    return BLACK, WHITE


@inline
def _transmittance(parameters, direction, normal):
    one = const(1.0, direction.x)  # no literal: it is one branch of several
    return Vec3(one, one, one)


NULL = LaneBSDF(no_value, no_pdf, _sample, _albedos, _transmittance, only_delta=always_delta)
