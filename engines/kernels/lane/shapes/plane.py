"""A ray and an infinite plane, in float64."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.shapes.coordinates import Coordinates
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.lane.vector import Vec3, dot, tangents, to_float64, to_real


@inline
def plane_distance(o, d, point, normal):
    """Distance to an infinite plane, in float64; NaN, inf or negative where it is missed."""
    slope = dot(normal, d)
    t = dot(normal, point - o) / select(slope == 0.0, 1.0, slope)
    return select(slope == 0.0, math.inf, t)


@inline
def intersection(o, d, point, normal, real):
    """Where a ray (o, d in `real`) meets a plane (in float64)."""
    t = plane_distance(to_float64(o), to_float64(d), point, normal)
    found = to_float64(o) + to_float64(d) * t
    found = found + normal * dot(normal, point - found)
    out, zero = to_real(normal, real), real(0)
    return ShapeIntersection(real(t), zero, zero, zero, to_real(found, real), out, out, Vec3(zero, zero, zero))


@inline
def coordinates(p, point, normal):
    """Metres along the local frame of the plane's normal."""
    t1, t2 = tangents(normal)
    out = p - point
    return Coordinates(dot(out, t1), dot(out, t2), t1, t2)
