"""The disk that emits: uniform in area. Parameters are center (3), unit normal (3) and radius."""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.vector import Vec3, dot, length, sin_cos_turn, tangents


@inline
def sample(light, p, normal, u0, u1):
    x, y, z, nx, ny, nz, radius = light.parameters[:7]
    zero, one = const(0.0, u0), const(1.0, u0)
    n = Vec3(nx, ny, nz)
    sine, cosine = sin_cos_turn(u1)
    t, b = tangents(n)
    r = radius * np.sqrt(u0)
    to = Vec3(x, y, z) + t * (r * cosine) + b * (r * sine) - p
    distance = length(to)
    wi = to * (one / distance)
    facing = -dot(wi, n)
    lit = (facing > zero) | (light.two_sided > zero)
    weight = abs(facing) * const(math.pi, u0) * radius * radius / (distance * distance)
    return LightSample(wi, distance, light.color * select(lit, weight, zero), one / weight)


@inline
def pdf(parameters, o, t, facing, n_lights):
    """Per solid angle, of a hit at distance t from o under the cosine `facing`, when one of `n_lights` lights is chosen."""
    radius = parameters[6]
    return t * t / (facing * const(math.pi, t) * radius * radius * n_lights)
