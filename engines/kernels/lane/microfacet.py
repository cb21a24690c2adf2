"""The GGX distribution of microfacet normals, in the local frame: z along the shading normal.

Walter et al. 2007; Heitz 2014, 2018.
"""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.vector import Vec3, dot, sin_cos_turn, unit


@inline
def ggx_density(m, ax, ay):
    """D(m), per steradian, of roughnesses ax, ay above 0."""
    one, x, y = const(1.0, ax), m.x / ax, m.y / ay
    e = x * x + y * y + m.z * m.z
    return one / (const(math.pi, ax) * ax * ay * e * e)


@inline
def ggx_masking(v, ax, ay):
    """Smith's G1(v), for v.z above 0."""
    one, x, y = const(1.0, ax), ax * v.x, ay * v.y
    return const(2.0, ax) / (one + np.sqrt(one + (x * x + y * y) / (v.z * v.z)))


@inline
def ggx_visible_normal(wo, ax, ay, u0, u1):
    """A normal with density D(m) G1(wo) max(0, wo . m) / wo.z, by spherical caps (Dupuy and Benyoub 2023)."""
    zero, one, two = const(0.0, u0), const(1.0, u0), const(2.0, u0)
    v = unit(Vec3(ax * wo.x, ay * wo.y, wo.z))
    k = u0 * (one + v.z)
    sine, cosine = sin_cos_turn(u1)
    square = k * (two - k)
    ring = np.sqrt(select(square > zero, square, zero))
    h = Vec3(ring * cosine + v.x, ring * sine + v.y, (one - u0) * (one + v.z))
    return unit(Vec3(ax * h.x, ay * h.y, h.z))


@inline
def half_vector(wo, wi):
    """The unit vector between two directions; z where they are opposite."""
    zero, one = const(0.0, wo.x), const(1.0, wo.x)
    m = wo + wi
    square = dot(m, m)
    good = square > zero
    scale = one / np.sqrt(select(good, square, one))
    return Vec3(m.x * scale, m.y * scale, select(good, m.z * scale, one))
