"""Functions of three-vectors, one lane's each, and the local frame at a surface."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.compile.vec3 import BLACK, WHITE, Vec3
from engines.kernels.lane.target import floor, sqrt

__all__ = [
    "BLACK",
    "WHITE",
    "Frame",
    "Vec3",
    "cross",
    "dot",
    "extent",
    "frame_at",
    "frame_of_normal",
    "frame_of_tangent",
    "largest",
    "length",
    "sin_cos_turn",
    "tangents",
    "to_float64",
    "to_local",
    "to_real",
    "to_world",
    "total",
    "unit",
]


@inline
def dot(a, b):
    """The scalar product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@inline
def cross(a, b):
    """The vector product, right-handed."""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@inline
def length(a):
    """Euclidean."""
    return sqrt(dot(a, a))


@inline
def unit(a):
    """`a` divided by its length; not for the zero vector."""
    return a * (1.0 / length(a))


@inline
def total(a):
    """The sum of the components."""
    return a.x + a.y + a.z


@inline
def largest(a):
    """The largest component."""
    most = select(a.x > a.y, a.x, a.y)
    return select(a.z > most, a.z, most)


@inline
def extent(a):
    """The largest component by magnitude."""
    return largest(Vec3(abs(a.x), abs(a.y), abs(a.z)))


@inline
def to_float64(v):
    """A vector of float64 numbers."""
    return Vec3(np.float64(v.x), np.float64(v.y), np.float64(v.z))


@inline
def to_real(v, real):
    """A vector of the scalar type `real`."""
    return Vec3(real(v.x), real(v.y), real(v.z))


@inline
def tangents(n):
    """Two unit vectors that complete the unit vector `n` to a right-handed frame (Duff et al. 2017).

    The two charts meet at n.z = -0.7, not at 0: many a facet lies along z, and must not turn on the sign of a rounding error.
    """
    sign = select(n.z < -0.7, -1.0, 1.0)
    a = -1.0 / (sign + n.z)
    b = n.x * n.y * a
    return Vec3(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3(b, sign + n.y * n.y * a, -n.y)


@inline
def sin_cos_turn(u):
    """(sin, cos) of 2 pi u for u in [0, 1): polynomials on an eighth of a turn, to 1 ulp, and vector code throughout.

    Coefficients of fdlibm's kernel sine and cosine (Sun Microsystems 1993).
    """
    quarter = floor(u * 4.0 + 0.5)
    x = (u - quarter / 4.0) * 6.283185307179586
    z = x * x
    s = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    s = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * s)
    s = x + x * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * s))
    c = 2.08757232129817482790e-09 + z * -1.13596475577881948265e-11
    c = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * c)
    c = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * c)
    c = 1.0 - 0.5 * z + z * z * c
    # quarter is 0..4: 0 and 4 (s, c), 1 (c, -s), 2 (-s, -c), 3 (-c, s)
    odd = (quarter == 1.0) | (quarter == 3.0)
    sine, cosine = select(odd, c, s), select(odd, s, c)
    low = (quarter == 2.0) | (quarter == 3.0)
    left = (quarter == 1.0) | (quarter == 2.0)
    return select(low, -sine, sine), select(left, -cosine, cosine)


# ---- local frames: z along the shading normal, x along the shape's tangent ------------------------------------------


class Frame(NamedTuple):
    """Unit vectors, right-handed."""

    s: Vec3
    t: Vec3
    n: Vec3


@inline
def frame_of_normal(n):
    """A frame about n whose tangents follow no shape."""
    s, t = tangents(n)
    return Frame(s, t, n)


@inline
def frame_of_tangent(n, tangent):
    """The frame about n whose s is as near to `tangent` as can be; `frame_of_normal` where that is parallel to n, or 0."""
    across = tangent - n * dot(n, tangent)
    square = dot(across, across)
    good = square > 1e-8 * dot(tangent, tangent)
    s = across * (1.0 / sqrt(select(good, square, 1.0)))
    s0, t0 = tangents(n)
    s = select(good, s, s0)
    return Frame(s, select(good, cross(n, s), t0), n)


@inline
def to_local(frame, v):
    return Vec3(dot(frame.s, v), dot(frame.t, v), dot(frame.n, v))


@inline
def to_world(frame, v):
    return frame.s * v.x + frame.t * v.y + frame.n * v.z


@cache
def frame_at(anisotropic: bool) -> Any:
    """The function (si) -> frame at a SurfaceInteraction, along the shape's tangent where some material is anisotropic."""

    @inline
    def frame(si):
        if anisotropic:
            return frame_of_tangent(si.normal, si.tangent)
        return frame_of_normal(si.normal)

    return frame
