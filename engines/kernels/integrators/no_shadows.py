"""Direct light without visibility, plus the ambient term; specular reflection and transmission are black."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.integrators.interface import Integrator, Uses, finish
from engines.kernels.integrators.whitted import local


@inline
def step(si, light, bsdf, draws, path, options):
    radiance, direct = local(si, light, bsdf, path, options[1])
    return finish(si.t, radiance, direct)


INTEGRATOR = Integrator(step, Uses(value=True, albedos=True), every_light=True, shadows=False)
