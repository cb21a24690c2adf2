"""Grey by distance, max(0, (D - t)/D) with D = 1.1 |max_point - origin|, and black where nothing is hit."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.integrators.interface import Integrator, Uses, finish
from engines.kernels.lane.vector import Vec3, length


@inline
def step(si, light, bsdf, draws, path, options):
    zero = const(0.0, si.t)
    far = 1.1 * length(Vec3(options[3], options[4], options[5]) - si.origin)
    grey = (far - si.t) / select(far > zero, far, 1.0)
    grey = select((not si.miss) & (grey > zero) & (far > zero), grey, zero)
    return finish(si.t, Vec3(grey, grey, grey), Vec3(zero, zero, zero))


INTEGRATOR = Integrator(step, Uses(), lit=False)
