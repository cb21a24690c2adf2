"""Nothing: every ray goes straight on."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.lane.bsdf.interface import SPECULAR_REFLECTION, LaneBSDF, always_delta, delta, no_pdf, no_value
from engines.kernels.lane.vector import BLACK, WHITE


@inline
def _sample(parameters, si, u_lobe, u0, u1, which):
    return delta(si.direction, WHITE, 1.0, True, which != SPECULAR_REFLECTION)


@inline
def _albedos(parameters, si):
    return BLACK, WHITE


@inline
def _transmittance(parameters, direction, normal):
    return WHITE


NULL = LaneBSDF(no_value, no_pdf, _sample, _albedos, _transmittance, only_delta=always_delta)
