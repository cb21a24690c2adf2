"""Grey by distance, max(0, (D - t)/D) with D = 1.1 |max_point - origin|, and black where nothing is hit."""

from __future__ import annotations

from engines.kernels.jit import const, inline, select
from engines.kernels.shaders.step import finish
from engines.kernels.vector import Vec3, length

EVERY_LIGHT = False
BRANCHES = False


@inline
def step(hit, material, light, draws, path, options, needs):
    zero, one = const(0.0, hit.t), const(1.0, hit.t)
    far = const(1.1, hit.t) * length(Vec3(options[3], options[4], options[5]) - hit.origin)
    grey = (far - hit.t) / select(far > zero, far, one)
    grey = select((not hit.miss) & (grey > zero) & (far > zero), grey, zero)
    return finish(hit.t, Vec3(grey, grey, grey), Vec3(zero, zero, zero))
