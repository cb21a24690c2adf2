"""The point light: parameters are position (3) and 1, or 0 for a light that does not fall off with distance."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot


@inline
def sample(light, p, normal, u0, u1):
    x, y, z, falloff = light.parameters[:4]
    to = Vec3(x, y, z) - p
    square = dot(to, to)
    distance = sqrt(square)
    scale = 1.0 / select(falloff > 0.0, square, 1.0)
    return LightSample(to * (1.0 / distance), distance, light.color * scale, math.inf)
