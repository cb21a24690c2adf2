"""One ray of one lane against one primitive. Every intersector uses these, so their distances agree bit for bit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from engines.kernels.jit import const, fma, inline, select
from engines.kernels.vector import Vec3, cross, dot

_ON_SPHERE = 4.0 * float(np.finfo(np.float64).eps)


class Frame(NamedTuple):
    """A shear that takes a ray to the z axis: points on the ray have x . p = y . p = 0 and t = z . p, p from its origin."""

    x: Vec3
    y: Vec3
    z: Vec3


@inline
def ray_frame(d):
    """The shear of Woop, Benthin and Wald (2013) along the largest component of d, without their permutation of axes."""
    zero, one = const(0.0, d.x), const(1.0, d.x)
    ax, ay, az = abs(d.x), abs(d.y), abs(d.z)
    along_x = (ax >= ay) & (ax >= az)
    along_y = (ay >= az) & (~along_x)
    inverse = one / select(along_x, d.x, select(along_y, d.y, d.z))
    sx, sy, sz = -d.x * inverse, -d.y * inverse, -d.z * inverse
    return Frame(
        Vec3(select(along_x, sy, select(along_y, zero, one)), select(along_x, one, select(along_y, sz, zero)),
             select(along_x, zero, select(along_y, one, sx))),
        Vec3(select(along_x, sz, select(along_y, one, zero)), select(along_x, zero, select(along_y, sx, one)),
             select(along_x, one, select(along_y, zero, sy))),
        Vec3(select(along_x, inverse, zero), select(along_y, inverse, zero), select(along_x | along_y, zero, inverse)),
    )  # fmt: skip


@inline
def shear(frame, p):
    """A vertex relative to the ray's origin, in the ray's frame. The same for every triangle that shares the vertex."""
    return Vec3(dot(frame.x, p), dot(frame.y, p), dot(frame.z, p))


class Weights(NamedTuple):
    """Unnormalised barycentric weights of the three vertices; hit when none differ in sign and the sum is not 0."""

    a: float
    b: float
    c: float


@inline
def difference_of_products(a, b, c, d):
    """a b - c d to 1.5 ulp (Kahan; Jeannerod et al. 2013): its sign is exact, and it is 0 only where the true value is."""
    product = c * d
    return fma(a, b, -product) + fma(-c, d, product)


@inline
def edge_weights(a, b, c):
    """Edge functions of sheared vertices. Their signs are exact and zero counts as inside, so no ray slips between
    triangles that share an edge or a vertex, and no tiny triangle is hit by a ray that passes far from it."""
    return Weights(
        difference_of_products(c.x, b.y, c.y, b.x),
        difference_of_products(a.x, c.y, a.y, c.x),
        difference_of_products(b.x, a.y, b.y, a.x),
    )


@inline
def triangle_distance(a, b, c):
    """Distance along the ray to the triangle of sheared vertices, NaN or inf where it is missed."""
    w = edge_weights(a, b, c)
    low = select(w.a < w.b, w.a, w.b)
    low = select(w.c < low, w.c, low)
    high = select(w.a > w.b, w.a, w.b)
    high = select(w.c > high, w.c, high)
    zero = const(0.0, a.x)
    t = (w.a * a.z + w.b * b.z + w.c * c.z) / (w.a + w.b + w.c)
    return select((low >= zero) | (high <= zero), t, const(np.inf, a.x))


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
    return select((discriminant >= 0.0) & (t > 0.0), t, np.inf)


@inline
def plane_distance(o, d, point, normal):
    """Distance to an infinite plane, in float64; NaN, inf or negative where it is missed."""
    slope = dot(normal, d)
    t = dot(normal, point - o) / select(slope == 0.0, 1.0, slope)
    return select(slope == 0.0, np.inf, t)


@inline
def triangle_normal(a, b, c):
    """(b - a) x (c - a), not normalised."""
    return cross(b - a, c - a)
