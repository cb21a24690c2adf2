"""The cylinder that emits: uniform in area. Parameters are one end of its axis (3), the way to the other (3) and the radius."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.vector import Vec3, dot, length, sin_cos_turn, tangents


@inline
def sample(light, p, normal, u0, u1):
    x, y, z, ax, ay, az, radius = light.parameters[:7]
    axis = Vec3(ax, ay, az)
    long = length(axis)
    sine, cosine = sin_cos_turn(u1)
    t, b = tangents(axis * (1.0 / long))
    out = t * cosine + b * sine
    to = Vec3(x, y, z) + axis * u0 + out * radius - p
    distance = length(to)
    wi = to * (1.0 / distance)
    facing = -dot(wi, out)
    lit = (facing > 0.0) | (light.two_sided > 0.0)
    weight = abs(facing) * (2.0 * math.pi) * radius * long / (distance * distance)
    return LightSample(wi, distance, light.color * select(lit, weight, 0.0), 1.0 / weight)


@inline
def pdf(parameters, o, t, facing, n_lights):
    """Per solid angle, of a hit at distance t from o under the cosine `facing`, when one of `n_lights` lights is chosen."""
    _, _, _, ax, ay, az, radius = parameters[:7]
    area = (2.0 * math.pi) * radius * length(Vec3(ax, ay, az))
    return t * t / (facing * area * n_lights)
