"""A ray and a sphere, in float64; and the cone under which a sphere is seen."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.shapes.coordinates import Coordinates, turn_of
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot, to_float64, to_real, unit

_ON_SPHERE = 4.0 * float(np.finfo(np.float64).eps)


@inline
def sphere_distance(o, d, center, radius):
    """Nearest positive distance along a unit direction, in float64; inf for a miss. Haines et al., Ray Tracing Gems 7.

    An origin within four units in the last place of the surface lies on it: the root near zero is not a hit.
    """
    f = o - center
    a = dot(d, d)
    b = -dot(f, d)
    l = f + d * (b / a)
    discriminant = radius * radius - dot(l, l)
    distance = math.sqrt(dot(f, f))
    gap = distance - radius
    c = select(abs(gap) <= _ON_SPHERE * radius, 0.0, gap) * (distance + radius)
    root = math.sqrt(select(discriminant > 0.0, a * discriminant, 0.0))
    q = b + select(b < 0.0, -root, root)
    one, two = c / select(q == 0.0, 1.0, q), q / a
    near, far = select(one < two, one, two), select(one < two, two, one)
    t = select(near > 0.0, near, far)
    return select((discriminant >= 0.0) & (t > 0.0), t, math.inf)


@inline
def intersection(o, d, center, radius, real):
    """Where a ray (o, d in `real`) meets a sphere (in float64): put back onto the sphere, and rounded to `real`."""
    t = sphere_distance(to_float64(o), to_float64(d), center, radius)
    out = unit(to_float64(o) + to_float64(d) * t - center)
    normal = to_real(out, real)
    zero = real(0)
    tangent = Vec3(-normal.y, normal.x, zero)
    return ShapeIntersection(real(t), real(radius), zero, zero, to_real(center + out * radius, real), normal, normal, tangent)


@inline
def coordinates(p, center, radius):
    """u along phi, counter-clockwise about +z; v from +z to -z."""
    x = p - center
    across = math.sqrt(x.x * x.x + x.y * x.y)
    phi, height = turn_of(x.y, x.x), x.z / radius
    height = select(height > -1.0, height, -1.0)
    theta = math.acos(select(height < 1.0, height, 1.0))
    cos, sin = math.cos(phi), math.sin(phi)
    dp_du = Vec3(-x.y, x.x, 0.0) * (2.0 * math.pi)
    return Coordinates(phi / (2.0 * math.pi), theta / math.pi, dp_du, Vec3(x.z * cos, x.z * sin, -across) * math.pi)


class Cone(NamedTuple):
    """The cone under which a sphere is seen: `pdf` per solid angle, 0 from inside; `k` is 1 - cos of its half angle."""

    pdf: float
    k: float
    axis: Vec3
    distance: float


@inline
def cone(p, center, radius):
    """The cone under which a sphere is seen from the point `p`."""
    to = center - p
    square = dot(to, to)
    outside = square > 1.0001 * radius * radius
    sin2 = select(outside, radius * radius / square, 0.0)
    k = sin2 / (1.0 + sqrt(1.0 - sin2))
    pdf = select(outside, 1.0 / ((2.0 * math.pi) * select(outside, k, 1.0)), 0.0)
    distance = sqrt(square)
    return Cone(pdf, k, to * (1.0 / distance), distance)
