"""Direct light without visibility, plus the ambient term; mirrors and glass are black."""

from __future__ import annotations

from engines.kernels.jit import inline
from engines.kernels.shaders.step import finish
from engines.kernels.shaders.whitted import local

EVERY_LIGHT = True
BRANCHES = False


@inline
def step(hit, material, light, draws, path, options, needs):
    radiance, direct = local(hit, material, light, path, options[1])
    return finish(hit.t, radiance, direct)
