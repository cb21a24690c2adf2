"""The material's albedo (the first of kd, ks and kt that is not black), and emission where that is black, as MobileRT's
shader of the diffuse material shows it."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.integrators.interface import Integrator, Uses, finish
from engines.kernels.lane.vector import Vec3, largest


@inline
def step(si, light, bsdf, draws, path, options):
    zero = const(0.0, si.t)
    none = Vec3(zero, zero, zero)
    shown = select(largest(bsdf.albedo) > zero, bsdf.albedo, select(si.miss, none, si.emission))
    return finish(si.t, shown, none)


INTEGRATOR = Integrator(step, Uses(albedos=True), lit=False)
