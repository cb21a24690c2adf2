"""The sphere that emits: by the cone from outside, uniform in area from inside. Parameters are center (3) and radius."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.shapes.sphere import cone
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot, length, sin_cos_turn, tangents


@inline
def sample(light, p, normal, u0, u1):
    zero = const(0.0, u0)
    x, y, z, radius = light.parameters[:4]
    center = Vec3(x, y, z)
    seen = cone(p, center, radius)
    sine, cosine = sin_cos_turn(u1)
    # the cone
    drop = u0 * seen.k
    cos = 1.0 - drop
    sin2 = drop * (2.0 - drop)
    sin = sqrt(select(sin2 > zero, sin2, zero))
    t, b = tangents(seen.axis)
    wi = t * (sin * cosine) + b * (sin * sine) + seen.axis * cos
    inside = radius * radius - seen.distance * seen.distance * sin2
    near = seen.distance * cos - sqrt(select(inside > zero, inside, zero))
    # the whole surface
    height = 1.0 - 2.0 * u0
    ring = sqrt(select(1.0 - height * height > zero, 1.0 - height * height, zero))
    out = Vec3(ring * cosine, ring * sine, height)
    to = center + out * radius - p
    far = length(to)
    wa = to * (1.0 / far)
    facing = -dot(wa, out)
    area_pdf = far * far / (abs(facing) * (4.0 * math.pi) * radius * radius)
    by_cone = seen.pdf > zero
    pdf = select(by_cone, seen.pdf, area_pdf)
    lit = by_cone | (facing > zero) | (light.two_sided > zero)
    radiance = select(lit, light.color * (1.0 / pdf), Vec3(zero, zero, zero))
    return LightSample(select(by_cone, wi, wa), select(by_cone, near, far), radiance, pdf)


@inline
def pdf(parameters, o, t, facing, n_lights):
    """Per solid angle, of a hit at distance t from o under the cosine `facing`, when one of `n_lights` lights is chosen."""
    x, y, z, radius = parameters[:4]
    by_cone = cone(o, Vec3(x, y, z), radius).pdf
    by_area = t * t / (facing * (4.0 * math.pi) * radius * radius)
    return select(by_cone > 0.0, by_cone, by_area) / n_lights
