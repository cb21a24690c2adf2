"""A ray and a disk, in float64. Parameters are center (3), unit normal (3) and radius."""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.shapes.coordinates import Coordinates, turn_of
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.lane.shapes.plane import plane_distance
from engines.kernels.lane.vector import Vec3, dot, tangents, to_float64, to_real


@inline
def distance(o, d, p):
    """Along a ray, inf where the disk is missed. The rim belongs to it."""
    center, normal = Vec3(p[0], p[1], p[2]), Vec3(p[3], p[4], p[5])
    t = plane_distance(o, d, center, normal)
    out = o + d * t - center
    return select((t > 0.0) & (dot(out, out) <= p[6] * p[6]), t, math.inf)


@inline
def intersection(o, d, p, real):
    """Where a ray (o, d in `real`) meets the disk, put back into its plane."""
    center, normal = Vec3(p[0], p[1], p[2]), Vec3(p[3], p[4], p[5])
    t = distance(to_float64(o), to_float64(d), p)
    found = to_float64(o) + to_float64(d) * select(t < math.inf, t, 0.0)
    found = found + normal * dot(normal, center - found)
    out, zero = to_real(normal, real), real(0)
    tangent = to_real(found - center, real)
    return ShapeIntersection(real(t), real(p[6]), zero, zero, to_real(found, real), out, out, tangent)


@inline
def coordinates(point, p):
    """u from the center to the rim, v around it."""
    normal = Vec3(p[3], p[4], p[5])
    t1, t2 = tangents(normal)
    out = point - Vec3(p[0], p[1], p[2])
    x, y = dot(out, t1), dot(out, t2)
    way, phi = math.sqrt(dot(out, out)), turn_of(y, x)
    cos, sin = math.cos(phi), math.sin(phi)
    dp_du, dp_dv = t1 * cos + t2 * sin, t2 * cos - t1 * sin
    return Coordinates(way / p[6], phi / (2.0 * math.pi), dp_du * p[6], dp_dv * (2.0 * math.pi * way))


def bounds(parameters):
    """Lowest and highest coordinates (n, 3) of disks, from their parameters (n, 7 or more)."""
    center, normal, radius = parameters[:, :3], parameters[:, 3:6], parameters[:, 6:7]
    half = radius * np.sqrt(np.maximum(1 - normal * normal, 0))
    return center - half, center + half
