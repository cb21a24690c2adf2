"""The spot light: parameters are position (3), unit direction (3), and the half angles of cutoff and beam in radians."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.elementary import arccos
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot


@inline
def sample(light, p, normal, u0, u1):
    x, y, z, dx, dy, dz, cutoff, beam = light.parameters
    to = Vec3(x, y, z) - p
    square = dot(to, to)
    distance = sqrt(square)
    wi = to * (1.0 / distance)
    theta = arccos(-dot(wi, Vec3(dx, dy, dz)))
    soft = cutoff > beam
    falloff = (cutoff - theta) / select(soft, cutoff - beam, 1.0)
    falloff = select(soft & (falloff < 1.0), falloff, 1.0)
    scale = select(theta < cutoff, falloff / square, 0.0)
    return LightSample(wi, distance, light.color * scale, math.inf)
