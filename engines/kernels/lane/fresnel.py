"""Smooth interfaces: Fresnel reflectance, reflected and refracted directions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.compile.vec3 import Vec3
from engines.kernels.lane.vector import dot


class Refraction(NamedTuple):
    """What a smooth dielectric does with a direction. `scale` is the factor on radiance, 1/eta^2 (1 when `total`)."""

    reflectance: float
    direction: Vec3
    total: bool
    scale: float


@inline
def reflect(d, n):
    """The direction d (towards the surface) reflected at the normal n."""
    return d - n * (const(2.0, d.x) * dot(d, n))


class Interface(NamedTuple):
    """A smooth dielectric under an angle: what it reflects, and the cosine on the far side (0 when all is reflected)."""

    reflectance: float
    cos_transmitted: float
    total: bool


@inline
def fresnel_dielectric(c1, eta):
    """Exact, unpolarised Fresnel reflectance at the cosine c1 in [0, 1]; eta = n_t / n_i."""
    zero, one, half = const(0.0, eta), const(1.0, eta), const(0.5, eta)
    c1 = select(c1 > one, one, c1)
    s2 = (one - c1 * c1) / (eta * eta)
    total = s2 >= one
    c2 = np.sqrt(select(total, zero, one - s2))
    across = (c1 - eta * c2) / (c1 + eta * c2)
    along = (eta * c1 - c2) / (eta * c1 + c2)
    return Interface(select(total, one, half * across * across + half * along * along), c2, total)


@inline
def refract(d, n, eta):
    """Exact, unpolarised Fresnel reflectance and Snell's direction; eta = n_t / n_i, n faces against d."""
    one = const(1.0, eta)
    c1 = abs(dot(d, n))
    c1 = select(c1 > one, one, c1)
    found = fresnel_dielectric(c1, eta)
    total = found.total
    refracted = d * (one / eta) + n * (c1 / eta - found.cos_transmitted)
    mirror = reflect(d, n)
    direction = Vec3(
        select(total, mirror.x, refracted.x), select(total, mirror.y, refracted.y), select(total, mirror.z, refracted.z)
    )
    return Refraction(found.reflectance, direction, total, select(total, one, one / (eta * eta)))


@inline
def _conductor_channel(c, eta, k):
    """Reflectance of one channel, in real numbers."""
    zero, one, two, half = const(0.0, c), const(1.0, c), const(2.0, c), const(0.5, c)
    s2 = one - c * c
    g = eta * eta - k * k - s2
    twice = two * eta * k
    b = np.sqrt(g * g + twice * twice)
    square = half * (b + g)
    a = np.sqrt(select(square > zero, square, zero))
    perpendicular = (b + c * c - two * a * c) / (b + c * c + two * a * c)
    bc, cross = b * c * c + s2 * s2, two * a * c * s2
    return half * perpendicular * (one + (bc - cross) / (bc + cross))


@inline
def fresnel_conductor(c, eta, k):
    """Exact, unpolarised reflectance of the complex index eta + ik at the cosine c in (0, 1], per channel."""
    return Vec3(_conductor_channel(c, eta.x, k.x), _conductor_channel(c, eta.y, k.y), _conductor_channel(c, eta.z, k.z))
