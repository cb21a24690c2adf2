"""Smooth interfaces: Fresnel reflectance, reflected and refracted directions."""

from __future__ import annotations

from typing import NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.compile.vec3 import Vec3
from engines.kernels.lane.target import sqrt
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
    return d - n * (2.0 * dot(d, n))


class Interface(NamedTuple):
    """A smooth dielectric under an angle: what it reflects, and the cosine on the far side (0 when all is reflected)."""

    reflectance: float
    cos_transmitted: float
    total: bool


@inline
def fresnel_dielectric(c1, eta):
    """Exact, unpolarised Fresnel reflectance at the cosine c1 in [0, 1]; eta = n_t / n_i."""
    c1 = select(c1 > 1.0, 1.0, c1)
    s2 = (1.0 - c1 * c1) / (eta * eta)
    total = s2 >= 1.0
    c2 = sqrt(select(total, 0.0, 1.0 - s2))
    across = (c1 - eta * c2) / (c1 + eta * c2)
    along = (eta * c1 - c2) / (eta * c1 + c2)
    return Interface(select(total, 1.0, 0.5 * across * across + 0.5 * along * along), c2, total)


@inline
def refract(d, n, eta):
    """Exact, unpolarised Fresnel reflectance and Snell's direction; eta = n_t / n_i, n faces against d."""
    c1 = abs(dot(d, n))
    c1 = select(c1 > 1.0, 1.0, c1)
    found = fresnel_dielectric(c1, eta)
    total = found.total
    refracted = d * (1.0 / eta) + n * (c1 / eta - found.cos_transmitted)
    mirror = reflect(d, n)
    direction = Vec3(
        select(total, mirror.x, refracted.x), select(total, mirror.y, refracted.y), select(total, mirror.z, refracted.z)
    )
    return Refraction(found.reflectance, direction, total, select(total, 1.0, 1.0 / (eta * eta)))


@inline
def _conductor_channel(c, eta, k):
    """Reflectance of one channel, in real numbers."""
    s2 = 1.0 - c * c
    g = eta * eta - k * k - s2
    twice = 2.0 * eta * k
    b = sqrt(g * g + twice * twice)
    square = 0.5 * (b + g)
    a = sqrt(select(square > 0.0, square, 0.0))
    perpendicular = (b + c * c - 2.0 * a * c) / (b + c * c + 2.0 * a * c)
    bc, cross = b * c * c + s2 * s2, 2.0 * a * c * s2
    return 0.5 * perpendicular * (1.0 + (bc - cross) / (bc + cross))


@inline
def fresnel_conductor(c, eta, k):
    """Exact, unpolarised reflectance of the complex index eta + ik at the cosine c in (0, 1], per channel."""
    return Vec3(_conductor_channel(c, eta.x, k.x), _conductor_channel(c, eta.y, k.y), _conductor_channel(c, eta.z, k.z))
