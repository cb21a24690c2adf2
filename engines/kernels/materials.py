"""Surface response of one lane: Fresnel, mirror and refracted directions, the cosine rule."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from engines.kernels.jit import const, inline, select
from engines.kernels.vector import Vec3, dot, sin_cos_turn, tangents


class Refraction(NamedTuple):
    """What a smooth dielectric does with a direction. `scale` is the factor on radiance, 1/eta^2 (1 when `total`)."""

    reflectance: float
    direction: Vec3
    total: bool
    scale: float


@inline
def mirrored(d, n):
    """The direction d (towards the surface) reflected at the normal n."""
    return d - n * (const(2.0, d.x) * dot(d, n))


@inline
def refracted(d, n, eta):
    """Exact, unpolarised Fresnel reflectance and Snell's direction; eta = n_t / n_i, n faces against d."""
    zero, one, half = const(0.0, eta), const(1.0, eta), const(0.5, eta)
    c1 = abs(dot(d, n))
    c1 = select(c1 > one, one, c1)
    s2 = (one - c1 * c1) / (eta * eta)
    total = s2 >= one
    c2 = np.sqrt(select(total, zero, one - s2))
    across = (c1 - eta * c2) / (c1 + eta * c2)
    along = (eta * c1 - c2) / (eta * c1 + c2)
    reflectance = select(total, one, half * across * across + half * along * along)
    bent = d * (one / eta) + n * (c1 / eta - c2)
    mirror = mirrored(d, n)
    direction = Vec3(select(total, mirror.x, bent.x), select(total, mirror.y, bent.y), select(total, mirror.z, bent.z))
    return Refraction(reflectance, direction, total, select(total, one, one / (eta * eta)))


@inline
def cosine_direction(n, u0, u1):
    """A direction about n with pdf cos/pi per solid angle."""
    one = const(1.0, u0)
    radius = np.sqrt(u0)
    sine, cosine = sin_cos_turn(u1)
    t, b = tangents(n)
    return t * (radius * cosine) + b * (radius * sine) + n * np.sqrt(one - u0)


@inline
def cosine_pdf(n, w):
    """Per solid angle, of the unit direction `w` around the normal `n`; 0 below the surface."""
    cos = dot(n, w)
    return select(cos > const(0.0, cos), cos, const(0.0, cos)) * const(1.0 / math.pi, cos)
