"""A ray and a triangle. Every intersector uses these functions, so distances agree bit for bit."""

from __future__ import annotations

import math
from typing import NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, fma, select
from engines.kernels.lane.shapes.coordinates import Coordinates
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, cross, dot, unit


class Shear(NamedTuple):
    """A shear that takes a ray to the z axis: points on the ray have x . p = y . p = 0 and t = z . p, p from its origin."""

    x: Vec3
    y: Vec3
    z: Vec3


@inline
def ray_frame(d):
    """The shear of Woop, Benthin and Wald (2013) along the largest component of d, without their permutation of
    axes."""
    ax, ay, az = abs(d.x), abs(d.y), abs(d.z)
    along_x = (ax >= ay) & (ax >= az)
    along_y = (ay >= az) & (~along_x)
    inverse = 1.0 / select(along_x, d.x, select(along_y, d.y, d.z))
    sx, sy, sz = -d.x * inverse, -d.y * inverse, -d.z * inverse
    return Shear(
        Vec3(
            select(along_x, sy, select(along_y, 0.0, 1.0)),
            select(along_x, 1.0, select(along_y, sz, 0.0)),
            select(along_x, 0.0, select(along_y, 1.0, sx)),
        ),
        Vec3(
            select(along_x, sz, select(along_y, 1.0, 0.0)),
            select(along_x, 0.0, select(along_y, sx, 1.0)),
            select(along_x, 1.0, select(along_y, 0.0, sy)),
        ),
        Vec3(select(along_x, inverse, 0.0), select(along_y, inverse, 0.0), select(along_x | along_y, 0.0, inverse)),
    )


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
    """a b - c d to 1.5 ulp (Kahan; Jeannerod et al. 2013): its sign is exact, and it is 0 only where the true value
    is."""
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
    t = (w.a * a.z + w.b * b.z + w.c * c.z) / (w.a + w.b + w.c)
    return select((low >= 0.0) | (high <= 0.0), t, const(math.inf, a.x))


@inline
def triangle_normal(a, b, c):
    """(b - a) x (c - a), not normalised."""
    return cross(b - a, c - a)


@inline
def intersection(o, d, a, b, c, na, nb, nc, smooth):
    """Where a ray meets the triangle a, b, c; with `smooth` the shading normal is interpolated between na, nb, nc. The
    point comes from the barycentric weights: it lies in the face however far the origin was."""
    frame = ray_frame(d)
    sa, sb, sc = shear(frame, a - o), shear(frame, b - o), shear(frame, c - o)
    w = edge_weights(sa, sb, sc)
    whole = w.a + w.b + w.c
    inverse = 1.0 / whole
    u, v = w.b * inverse, w.c * inverse
    normal = unit(triangle_normal(a, b, c))
    shading = normal
    if smooth:
        interpolated = na * (w.a * inverse) + nb * u + nc * v
        square = dot(interpolated, interpolated)
        good = square > 0.0
        shading = select(good, interpolated * (1.0 / sqrt(select(good, square, 1.0))), normal)
    t = (w.a * sa.z + w.b * sb.z + w.c * sc.z) / whole
    return ShapeIntersection(t, 0.0, u, v, a * (w.a * inverse) + b * u + c * v, normal, shading, b - a)


class VertexUV(NamedTuple):
    """Texture coordinates of a vertex."""

    u: float
    v: float


@inline
def coordinates(b1, b2, a, b, c):
    """The weights of the second and the third vertex."""
    return Coordinates(b1, b2, b - a, c - a)


@inline
def interpolated_uv(b1, b2, ta, tb, tc):
    """Between the coordinates of the vertices; `b1` and `b2` are the weights of the second and the third."""
    b0 = 1.0 - b1 - b2
    return VertexUV(b0 * ta.u + b1 * tb.u + b2 * tc.u, b0 * ta.v + b1 * tb.v + b2 * tc.v)


@inline
def mesh_coordinates(b1, b2, a, b, c, ta, tb, tc):
    """Interpolated between those of the vertices, `ta`, `tb` and `tc`; the derivatives of `coordinates` where these lie on a
    line."""
    u1, u2, v1, v2 = tb.u - ta.u, tc.u - ta.u, tb.v - ta.v, tc.v - ta.v
    determinant = u1 * v2 - v1 * u2
    dp_du, dp_dv = b - a, c - a
    if determinant != 0.0:
        scale = 1.0 / determinant
        dp_du, dp_dv = (dp_du * v2 - dp_dv * v1) * scale, (dp_dv * u1 - dp_du * u2) * scale
    uv = interpolated_uv(b1, b2, ta, tb, tc)
    return Coordinates(uv.u, uv.v, dp_du, dp_dv)
