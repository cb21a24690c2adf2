"""The Beckmann distribution of microfacets: slopes with a normal distribution.

Arguments as in `ggx`. Masking has two forms: the rational one of Walter et al. (2007), which values use, and the exact one,
which belongs to the density of visible normals. They differ by 0.4 % at most.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf, erfc, erfinv

from engines.numpy_reference.vectors import Array, dot, unit

SMALLEST_DRAW = 2.0**-25
"""Draws are held this far from 0 and 1, where slopes are infinite."""
LOWEST = -87.0
"""Exponent of the least number that the distribution may be, as float32 would have it."""
STEEPEST = 6.0
"""Slopes of roughness 1 beyond this one have a probability below 1e-16."""
STEPS = 60
"""Of the inversion at most; halving alone would come to 1e-17."""


def distribution(m: Array, alpha: Array) -> Array:
    """D(m) (n,), for m.z > 0; 0 where its exponential is below e^`LOWEST`."""
    ax, ay = alpha
    cosine2 = m[2] ** 2
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        exponent = -((m[0] / ax) ** 2 + (m[1] / ay) ** 2) / cosine2
        return np.where(exponent > LOWEST, np.exp(exponent) / (np.pi * ax * ay * cosine2**2), 0.0)


def masking(v: Array, alpha: Array) -> Array:
    """Smith's G1(v) (n,) in values, v on either side."""
    a = _cotangent(v, alpha)
    held = np.minimum(a, 1.6)
    rational = (3.535 * held + 2.181 * held**2) / (1.0 + 2.276 * held + 2.577 * held**2)
    return np.where(a < 1.6, rational, 1.0)


def exact_masking(v: Array, alpha: Array) -> Array:
    """Smith's G1(v) (n,) without approximation."""
    a = _cotangent(v, alpha)
    return 2.0 / (1.0 + erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi)))


def pdf_visible_normals(wo: Array, m: Array, alpha: Array) -> Array:
    """(n,) density per solid angle of the facets' normals as they are seen from wo."""
    return exact_masking(wo, alpha) * distribution(m, alpha) * dot(wo, m) / wo[2]


def sample_visible_normals(wo: Array, alpha: Array, u0: Array, u1: Array) -> Array:
    """(3, n) normals of facets with the density `pdf_visible_normals`, by two draws.

    Stretched by the roughness, slopes (x, y) in the plane of the view and across it are independent: y is normally
    distributed, and x in proportion to what the view sees of it.
    """
    ax, ay = alpha
    view = unit(np.stack([ax * wo[0], ay * wo[1], wo[2]]))
    sine = np.hypot(view[0], view[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        cos_phi, sin_phi = (np.where(sine > 0.0, part / sine, start) for part, start in ((view[0], 1.0), (view[1], 0.0)))
    u0, u1 = (np.clip(u, SMALLEST_DRAW, 1.0 - SMALLEST_DRAW) for u in (u0, u1))
    x, y = _visible_slope(view[2], sine, u0), erfinv(2.0 * u1 - 1.0)
    slope_x, slope_y = ax * (cos_phi * x - sin_phi * y), ay * (sin_phi * x + cos_phi * y)
    return unit(np.stack([-slope_x, -slope_y, np.ones(x.size)]))


def _cotangent(v: Array, alpha: Array) -> Array:
    """(n,) of the angle between v and the normal, after stretching by the roughness; inf along the normal."""
    with np.errstate(divide="ignore"):
        return np.abs(v[2]) / np.sqrt((alpha[0] * v[0]) ** 2 + (alpha[1] * v[1]) ** 2)


def _visible_slope(cosine: Array, sine: Array, u: Array) -> Array:
    """(n,) x up to which a share u lies of the density (cosine - x sine) exp(-x^2), on x below cosine / sine.

    Newton's method inside a bracket, which is halved where a step leaves it. Each point ends by itself, so that its result
    does not depend on the others: where it rests, or at the end of the bracket, where rounding keeps it moving, after
    `STEPS`.
    """
    with np.errstate(divide="ignore"):
        high = np.minimum(cosine / sine, STEEPEST)
    low = np.full(u.size, -STEEPEST)
    sought = u * _visible_below(high, cosine, sine)
    found = np.minimum(erfinv(2.0 * u - 1.0), 0.5 * (low + high))
    active = np.arange(u.size)
    for _ in range(STEPS):
        x, c, s = found[active], cosine[active], sine[active]
        error = _visible_below(x, c, s) - sought[active]
        below = error < 0.0
        low[active] = np.where(below, x, low[active])
        high[active] = np.where(below, high[active], x)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x - error / ((c - x * s) * np.exp(-x * x) / np.sqrt(np.pi))
        inside = (x >= low[active]) & (x <= high[active])
        x = np.where(inside, x, 0.5 * (low[active] + high[active]))
        moved = np.abs(x - found[active])
        found[active] = x
        active = active[moved > 1e-14 * (1.0 + np.abs(x))]
    return found


def _visible_below(x: Array, cosine: Array, sine: Array) -> Array:
    """(n,) integral of (cosine - t sine) exp(-t^2) / sqrt(pi) over t < x."""
    return 0.5 * cosine * erfc(-x) + 0.5 * sine * np.exp(-x * x) / np.sqrt(np.pi)
