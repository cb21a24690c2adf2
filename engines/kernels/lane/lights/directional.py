"""The directional light: parameters are the unit direction towards it (3)."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.vector import Vec3


@inline
def sample(light, p, normal, u0, u1):
    x, y, z = light.parameters[:3]
    infinite = const(math.inf, x)
    return LightSample(Vec3(x, y, z), infinite, light.color, infinite)
