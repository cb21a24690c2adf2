"""Distributions of microfacet normals, in the local frame: z along the shading normal.

GGX and Beckmann: Walter et al. 2007; Heitz 2014, 2018.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.elementary import LARGEST_ERROR_ARGUMENT, erfcx, exp, log, rough_erfinv
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, dot, sin_cos_turn, unit

SMALLEST_TAIL = 2.0**-25
"""Draws nearer to 0 or 1 are held there: Beckmann's slopes have no bound."""


class Distribution(NamedTuple):
    """Lane functions of a distribution, for roughnesses ax, ay above 0."""

    density: Any
    """(m, ax, ay) -> D(m), per steradian."""
    masking: Any
    """(v, ax, ay) -> G1(v) of values."""
    visible_masking: Any
    """(v, ax, ay) -> the G1(v) of the density of visible normals."""
    visible_normal: Any
    """(wo, ax, ay, u0, u1) -> a normal with density D(m) visible_masking(wo) max(0, wo . m) / wo.z."""
    exact: bool
    """Both kinds of masking are the same."""


@inline
def ggx_density(m, ax, ay):
    """D(m), per steradian, of roughnesses ax, ay above 0."""
    x, y = m.x / ax, m.y / ay
    e = x * x + y * y + m.z * m.z
    return 1.0 / (math.pi * ax * ay * e * e)


@inline
def ggx_masking(v, ax, ay):
    """Smith's G1(v), for v.z above 0."""
    x, y = ax * v.x, ay * v.y
    return 2.0 / (1.0 + sqrt(1.0 + (x * x + y * y) / (v.z * v.z)))


@inline
def ggx_visible_normal(wo, ax, ay, u0, u1):
    """A normal with density D(m) G1(wo) max(0, wo . m) / wo.z, by spherical caps (Dupuy and Benyoub 2023)."""
    v = unit(Vec3(ax * wo.x, ay * wo.y, wo.z))
    k = u0 * (1.0 + v.z)
    sine, cosine = sin_cos_turn(u1)
    square = k * (2.0 - k)
    ring = sqrt(select(square > 0.0, square, 0.0))
    h = Vec3(ring * cosine + v.x, ring * sine + v.y, (1.0 - u0) * (1.0 + v.z))
    return unit(Vec3(ax * h.x, ay * h.y, h.z))


@inline
def beckmann_density(m, ax, ay):
    """D(m), per steradian, for m.z above 0."""
    x, y = m.x / ax, m.y / ay
    inverse = 1.0 / (m.z * m.z)
    e = exp(-(x * x + y * y) * inverse)
    return select(e > 0.0, e * (inverse * inverse) / (math.pi * ax * ay), 0.0)


@inline
def _cot(v, ax, ay):
    """cot(theta) of `v` on the surface that is stretched to roughness 1; inf at the pole."""
    x, y = ax * v.x, ay * v.y
    return abs(v.z) / sqrt(x * x + y * y)


@inline
def beckmann_masking(v, ax, ay):
    """A rational approximation of Smith's G1(v) (Walter et al. 2007)."""
    a = _cot(v, ax, ay)
    above = a * (3.535 + 2.181 * a)
    return select(a < 1.6, above / (1.0 + a * (2.276 + 2.577 * a)), 1.0)


@inline
def beckmann_visible_masking(v, ax, ay):
    """Smith's G1(v), exact."""
    most, a = const(LARGEST_ERROR_ARGUMENT, ax), _cot(v, ax, ay)
    a = select(a < most, a, most)
    tail = exp(-a * a)
    return 2.0 / (1.0 + (1.0 - tail * erfcx(a)) + tail / (a * const(math.sqrt(math.pi), ax)))


class _Target(NamedTuple):
    """C(x) = u C(cot(theta)), with C the distribution of visible slopes as docs/transport.md has it."""

    sine: float
    cosine: float
    cot: float
    """At most 6."""
    below: float
    """u C(cot)."""
    above: float
    """(1 - u) C(cot), without the loss of digits where u is near 1."""
    end_tail: float
    """erfc(cot) / 2."""
    end_e: float
    """exp(-cot^2) / (2 sqrt(pi))."""


@inline
def _tails(x):
    """(erfc(|x|) / 2, exp(-x^2) / (2 sqrt(pi))), for |x| <= 6."""
    e = exp(-x * x)
    return 0.5 * e * erfcx(abs(x)), const(0.5 / math.sqrt(math.pi), x) * e


@inline
def _target(u, sine, cosine):
    most = const(LARGEST_ERROR_ARGUMENT, u)
    cot = cosine / sine
    cot = select(cot < most, cot, most)
    tail, e = _tails(cot)
    total = cosine * (1.0 - tail) + sine * e
    return _Target(sine, cosine, cot, u * total, (1.0 - u) * total, tail, e)


@inline
def _halley(x, to):
    """A step of third order towards the target, for x below cot."""
    tail, e = _tails(x)
    beyond = to.cosine * (tail - to.end_tail) - to.sine * (e - to.end_e)
    off = select(x < 0.0, to.cosine * tail + to.sine * e - to.below, to.above - beyond)
    facing = to.cosine - x * to.sine
    ratio = off / (2.0 * facing * e)
    found = x - ratio / (1.0 + 0.5 * ratio * (2.0 * x + to.sine / facing))
    found = select(found > -5.0, found, -5.0)
    return select(found < to.cot, found, 0.5 * (x + to.cot))


@inline
def _visible_slope(u, sine, cosine):
    """The slope x with C(x) = u C(cot(theta)), to the precision of the type.

    The first guess is Jakob's (2014, "An improved visible normal sampling routine for the Beckmann distribution"), off by 0.33
    at most; four steps of third order then reach float64.
    """
    to = _target(u, sine, cosine)
    power = 1.2753 - 0.8303 * sine - cosine * (0.0167 + 0.2618 * cosine)
    highest = 1.0 - 2.0 * to.end_tail
    guess = highest - (1.0 + highest) * exp(power * log(1.0 - u))
    lowest = const(-1.0 + 2.0 * SMALLEST_TAIL, u)
    x = rough_erfinv(select(guess > lowest, guess, lowest))
    x = select(x < to.cot, x, to.cot) - 1e-4
    return _halley(_halley(_halley(_halley(x, to), to), to), to)


@inline
def _held(u):
    """`u`, not too near to 0 or 1."""
    least, most = const(SMALLEST_TAIL, u), const(1.0 - SMALLEST_TAIL, u)
    u = select(u > least, u, least)
    return select(u < most, u, most)


@inline
def beckmann_visible_normal(wo, ax, ay, u0, u1):
    """A normal with density D(m) G1(wo) max(0, wo . m) / wo.z, by inversion of the distribution of slopes."""
    zero, one = const(0.0, u0), const(1.0, u0)
    v = unit(Vec3(ax * wo.x, ay * wo.y, wo.z))
    square = v.x * v.x + v.y * v.y
    tilted = square > zero
    sine = sqrt(square)
    scale = one / select(tilted, sine, one)
    cos_phi, sin_phi = select(tilted, v.x * scale, one), v.y * scale
    u0, u1 = _held(u0), _held(u1)
    x = _visible_slope(u0, sine, v.z)
    y = _halley(rough_erfinv(2.0 * u1 - one), _target(u1, zero, one))  # C is (1 + erf) / 2 at the pole
    return unit(Vec3(ax * (sin_phi * y - cos_phi * x), -ay * (sin_phi * x + cos_phi * y), one))


GGX = Distribution(ggx_density, ggx_masking, ggx_masking, ggx_visible_normal, exact=True)
BECKMANN = Distribution(beckmann_density, beckmann_masking, beckmann_visible_masking, beckmann_visible_normal, exact=False)


@inline
def half_vector(wo, wi):
    """The unit vector between two directions; z where they are opposite."""
    m = wo + wi
    square = dot(m, m)
    good = square > 0.0
    scale = 1.0 / sqrt(select(good, square, 1.0))
    return Vec3(m.x * scale, m.y * scale, select(good, m.z * scale, 1.0))
