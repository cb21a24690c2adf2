"""The mesh that emits: a face, uniform in area. The parameter is the area of all its faces."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot, length, unit


@inline
def sample(light, p, normal, u0, u1):
    a, b, c = light.vertex0, light.vertex1, light.vertex2
    su = sqrt(u0)
    on_light = a * (1.0 - su) + b * (su * (1.0 - u1)) + c * (su * u1)
    to = on_light - p
    distance = length(to)
    wi = to * (1.0 / distance)
    ab, ac = b - a, c - a
    n = unit(Vec3(ab.y * ac.z - ab.z * ac.y, ab.z * ac.x - ab.x * ac.z, ab.x * ac.y - ab.y * ac.x))
    facing = -dot(wi, n)
    lit = (facing > 0.0) | (light.two_sided > 0.0)
    weight = abs(facing) * light.parameters[0] / (distance * distance)
    return LightSample(wi, distance, light.color * select(lit, weight, 0.0), 1.0 / weight)


@inline
def pdf(parameters, o, t, facing, n_lights):
    """Per solid angle, of a hit at distance t from o under the cosine `facing`, when one of `n_lights` lights is chosen."""
    return t * t / (facing * parameters[0] * n_lights)
