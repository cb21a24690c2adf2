"""Nothing: every ray goes straight on."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const
from engines.kernels.lane.bsdf.interface import SPECULAR_REFLECTION, LaneBSDF, always_delta, delta, no_pdf, no_value
from engines.kernels.lane.vector import Vec3


@inline
def _sample(parameters, si, u_lobe, u0, u1, which):
    one = const(1.0, si.t)
    return delta(si.direction, Vec3(one, one, one), one, True, which != SPECULAR_REFLECTION)


@inline
def _albedos(parameters, si):
    zero, one = const(0.0, si.t), const(1.0, si.t)
    return Vec3(zero, zero, zero), Vec3(one, one, one)


@inline
def _transmittance(parameters, direction, normal):
    one = const(1.0, direction.x)
    return Vec3(one, one, one)


NULL = LaneBSDF(no_value, no_pdf, _sample, _albedos, _transmittance, only_delta=always_delta)
