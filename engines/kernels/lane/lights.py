"""Lights: how each kind is sampled from a point, by a function

    sample_<kind>(light, p, normal, u0, u1) -> LightSample

of a `Light`, the point, the shading normal there and two random numbers. The radiance is that of the light alone: whoever chose
it among several divides by the probability of the choice. Of a shape that emits there is

    <kind>_pdf(parameters, o, t, facing, inverse_pmf) -> float

too: per solid angle, of a hit at distance t from o under the cosine `facing`, where the light is chosen with the probability
1 / `inverse_pmf`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.compile.vec3 import Vec3
from engines.kernels.lane.elementary import arccos
from engines.kernels.lane.media import SPHERE_PDF, is_at_vertex_of_medium, uniform_direction
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf
from engines.kernels.lane.shapes.sphere import cone
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import dot, length, sin_cos_turn, tangents, unit


class Light(NamedTuple):
    """A row of the scene's lights; for a mesh that emits, a face of it and that face's emission."""

    parameters: tuple[float, ...]
    color: Vec3
    two_sided: float
    """1 or 0."""
    vertex0: Vec3
    vertex1: Vec3
    vertex2: Vec3


class LightSample(NamedTuple):
    """`wi` unit, towards the light; `radiance` over pdf; `pdf` per solid angle, inf for delta lights. A sample counts only
    where `pdf` is above 0: else `radiance` may be anything, NaN too."""

    wi: Vec3
    distance: float
    radiance: Vec3
    pdf: float


@inline
def sample_point(light, p, normal, u0, u1):
    """The point light: parameters are position (3) and 1, or 0 for a light that does not fall off with distance."""
    x, y, z, falloff = light.parameters[:4]
    to = Vec3(x, y, z) - p
    square = dot(to, to)
    distance = sqrt(square)
    scale = 1.0 / select(falloff > 0.0, square, 1.0)
    return LightSample(to * (1.0 / distance), distance, light.color * scale, math.inf)


@inline
def sample_spot(light, p, normal, u0, u1):
    """The spot light: parameters are position (3), unit direction (3), and the half angles of cutoff and beam in radians."""
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


@inline
def sample_projector(light, p, normal, u0, u1):
    """The projector, as if its image were white and without end: parameters are position (3) and unit direction (3)."""
    x, y, z, dx, dy, dz = light.parameters[:6]
    to = Vec3(x, y, z) - p
    distance = length(to)
    wi = to * (1.0 / distance)
    cosine = -dot(wi, Vec3(dx, dy, dz))
    depth = distance * cosine
    scale = select(cosine > 0.0, 1.0 / (depth * depth * cosine), 0.0)
    return LightSample(wi, distance, light.color * scale, math.inf)


@inline
def sample_directional(light, p, normal, u0, u1):
    """The directional light: parameters are the unit direction towards it (3)."""
    x, y, z = light.parameters[:3]
    infinite = const(math.inf, x)
    return LightSample(Vec3(x, y, z), infinite, light.color, infinite)


@inline
def sample_constant_environment(light, p, normal, u0, u1):
    """The environment of one radiance, sampled by the cosine rule."""
    wi = cosine_direction(normal, u0, u1)
    pdf = cosine_pdf(normal, wi)
    scale = select(pdf > 0.0, 1.0 / pdf, 0.0)
    return LightSample(wi, math.inf, light.color * scale, pdf)


@inline
def sample_environment_all_around(light, p, normal, u0, u1):
    """The same where points may lie in media, which have no normal (0): sampled uniformly there."""
    around = sample_constant_environment(light, p, normal, u0, u1)
    pdf = const(SPHERE_PDF, u0)
    uniform = LightSample(uniform_direction(u0, u1), around.distance, light.color * (1.0 / pdf), pdf)
    return select(is_at_vertex_of_medium(normal), uniform, around)


@inline
def sample_mesh(light, p, normal, u0, u1):
    """The mesh that emits: a face, uniform in area. The parameter is the area of all its faces."""
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
def mesh_pdf(parameters, o, t, facing, inverse_pmf):
    return t * t / (facing * parameters[0] * inverse_pmf)


@inline
def sample_sphere(light, p, normal, u0, u1):
    """The sphere that emits: by the cone from outside, uniform in area from inside. Parameters are center (3) and radius."""
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
def sphere_pdf(parameters, o, t, facing, inverse_pmf):
    x, y, z, radius = parameters[:4]
    by_cone = cone(o, Vec3(x, y, z), radius).pdf
    by_area = t * t / (facing * (4.0 * math.pi) * radius * radius)
    return select(by_cone > 0.0, by_cone, by_area) / inverse_pmf


@inline
def sample_disk(light, p, normal, u0, u1):
    """The disk that emits: uniform in area. Parameters are center (3), unit normal (3) and radius."""
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
def disk_pdf(parameters, o, t, facing, inverse_pmf):
    radius = parameters[6]
    return t * t / (facing * math.pi * radius * radius * inverse_pmf)


@inline
def sample_cylinder(light, p, normal, u0, u1):
    """The cylinder that emits: uniform in area. Parameters are one end of its axis (3), the way to the other (3) and the
    radius."""
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
def cylinder_pdf(parameters, o, t, facing, inverse_pmf):
    _, _, _, ax, ay, az, radius = parameters[:7]
    area = (2.0 * math.pi) * radius * length(Vec3(ax, ay, az))
    return t * t / (facing * area * inverse_pmf)
