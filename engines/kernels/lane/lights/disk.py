"""The disk that emits: uniform in area. Parameters are center (3), unit normal (3) and radius."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot, length, sin_cos_turn, tangents


@inline
def sample(light, p, normal, u0, u1):
    x, y, z, nx, ny, nz, radius = light.parameters[:7]
    n = Vec3(nx, ny, nz)
    sine, cosine = sin_cos_turn(u1)
    t, b = tangents(n)
    r = radius * sqrt(u0)
    to = Vec3(x, y, z) + t * (r * cosine) + b * (r * sine) - p
    distance = length(to)
    wi = to * (1.0 / distance)
    facing = -dot(wi, n)
    lit = (facing > 0.0) | (light.two_sided > 0.0)
    weight = abs(facing) * math.pi * radius * radius / (distance * distance)
    return LightSample(wi, distance, light.color * select(lit, weight, 0.0), 1.0 / weight)


@inline
def pdf(parameters, o, t, facing, n_lights):
    """Per solid angle, of a hit at distance t from o under the cosine `facing`, when one of `n_lights` lights is chosen."""
    radius = parameters[6]
    return t * t / (facing * math.pi * radius * radius * n_lights)
