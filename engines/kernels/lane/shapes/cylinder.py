"""A ray and a cylinder without its caps, in float64. Parameters are one end of its axis (3), the way to the other (3) and the
radius."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import fma, select
from engines.kernels.lane.shapes.coordinates import Coordinates, turn_of
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.lane.vector import Vec3, cross, dot, tangents, to_float64, to_real, unit

_ON_SURFACE = 4.0 * float(np.finfo(np.float64).eps)


class Split(NamedTuple):
    """A vector as a share of the axis, and what lies across it."""

    share: float
    across: Vec3


@inline
def _split(v, axis, square):
    """`square` is that of the axis. Each component is rounded once: a long way along the axis leaves the rest its digits."""
    share = dot(v, axis) / square
    return Split(share, Vec3(fma(-axis.x, share, v.x), fma(-axis.y, share, v.y), fma(-axis.z, share, v.z)))


@inline
def distance(o, d, p):
    """Along a ray, inf where the cylinder is missed: the nearer root in front that lies between the ends, which belong to it.

    The roots are those of a sphere (Haines et al., Ray Tracing Gems 7), of what lies across the axis. An origin within four
    units in the last place of the surface lies on it: the root near zero is not a hit.
    """
    axis, radius = Vec3(p[3], p[4], p[5]), p[6]
    square = dot(axis, axis)
    start, slope = _split(o - Vec3(p[0], p[1], p[2]), axis, square), _split(d, axis, square)
    f, g = start.across, slope.across
    a = dot(g, g)
    divisor = select(a > 0.0, a, 1.0)
    b = -dot(f, g)
    l = f + g * (b / divisor)
    discriminant = radius * radius - dot(l, l)
    away = math.sqrt(dot(f, f))
    gap = away - radius
    c = select(abs(gap) <= _ON_SURFACE * radius, 0.0, gap) * (away + radius)
    root = math.sqrt(select(discriminant > 0.0, a * discriminant, 0.0))
    q = b + select(b < 0.0, -root, root)
    one, two = c / select(q == 0.0, 1.0, q), q / divisor
    near, far = select(one < two, one, two), select(one < two, two, one)
    at_near, at_far = start.share + slope.share * near, start.share + slope.share * far
    t = select((far > 0.0) & (at_far >= 0.0) & (at_far <= 1.0), far, math.inf)
    t = select((near > 0.0) & (at_near >= 0.0) & (at_near <= 1.0), near, t)
    return select((discriminant >= 0.0) & (a > 0.0), t, math.inf)


@inline
def intersection(o, d, p, real):
    """Where a ray (o, d in `real`) meets the cylinder, put back onto it."""
    end, axis, radius = Vec3(p[0], p[1], p[2]), Vec3(p[3], p[4], p[5]), p[6]
    o, d = to_float64(o), to_float64(d)
    t = distance(o, d, p)
    square = dot(axis, axis)
    found = _split(o + d * select(t < math.inf, t, 0.0) - end, axis, square)
    out = unit(found.across)
    normal, zero = to_real(out, real), real(0)
    tangent = to_real(cross(axis, out) * (2.0 * math.pi * radius / math.sqrt(square)), real)
    point = to_real(end + axis * found.share + out * radius, real)
    return ShapeIntersection(real(t), real(radius), zero, zero, point, normal, normal, tangent)


@inline
def coordinates(point, p):
    """u around the axis, v along it."""
    axis, radius = Vec3(p[3], p[4], p[5]), p[6]
    square = dot(axis, axis)
    found, (t1, t2) = _split(point - Vec3(p[0], p[1], p[2]), axis, square), tangents(axis * (1.0 / math.sqrt(square)))
    phi = turn_of(dot(found.across, t2), dot(found.across, t1))
    around = t2 * math.cos(phi) - t1 * math.sin(phi)
    return Coordinates(phi / (2.0 * math.pi), found.share, around * (2.0 * math.pi * radius), axis)


def bounds(parameters):
    """Lowest and highest coordinates (n, 3) of cylinders, from their parameters (n, 7 or more)."""
    end, axis, radius = parameters[:, :3], parameters[:, 3:6], parameters[:, 6:7]
    square = (axis * axis).sum(axis=1, keepdims=True)
    half = radius * np.sqrt(np.maximum(1 - axis * axis / square, 0))
    return np.minimum(end, end + axis) - half, np.maximum(end, end + axis) + half
