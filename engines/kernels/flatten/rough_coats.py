"""Tables of rough dielectric coats, for plastic: how much light passes, and how much is reflected back inside."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.lane.bsdf.plastic import NODES

POINTS = 64
"""Random numbers a dimension, by Gauss and Legendre's rule."""
_erf = np.vectorize(math.erf, otypes=[float])

Array = NDArray[np.float64]


class Coat(NamedTuple):
    transmittance: tuple[float, ...]
    """Of NODES cosines from 0 to 1."""
    reflected_inside: float
    """F_dr: of diffuse light from below."""


def diffuse_reflectance(ior: float) -> float:
    """F_dr of a smooth coat: of diffuse light from below."""
    return 0.0636 * ior + 0.6681 + 0.7099 / ior - 1.4399 / ior**2


@lru_cache(maxsize=256)
def rough_coat(ior: float, alpha: float, distribution: str) -> Coat:
    """Averages over visible normals m: of (1 - F) G1 of the refracted directions, and of F G1 of those reflected inside."""
    mu = np.maximum(np.linspace(0.0, 1.0, NODES), 1e-6)[:, None, None]
    node, weight = np.polynomial.legendre.leggauss(POINTS)
    u, weights = (node + 1.0) / 2.0, np.outer(weight, weight) / 4.0
    sine = np.sqrt(1.0 - mu * mu)
    normals = {"ggx": _ggx_normals, "beckmann": _beckmann_normals}[distribution]
    masking = {"ggx": _ggx_masking, "beckmann": _beckmann_masking}[distribution]
    mx, mz = normals(sine, mu, alpha, u[None, :, None], u[None, None, :])
    cos = np.clip(sine * mx + mu * mz, 0.0, 1.0)
    # refracted into the coat: only z is needed, for G1 of an isotropic distribution
    reflected, cos_in = _fresnel(cos, ior)
    z = (cos / ior - cos_in) * mz - mu / ior
    passes = (np.where(z < 0.0, (1.0 - reflected) * masking(np.abs(z), alpha), 0.0) * weights).sum(axis=(1, 2))
    reflected, _ = _fresnel(cos, 1.0 / ior)
    z = 2.0 * cos * mz - mu
    returns = (np.where(z > 0.0, reflected * masking(np.abs(z), alpha), 0.0) * weights).sum(axis=(1, 2))
    return Coat(tuple(passes), float(2.0 / NODES * (mu[:, 0, 0] * returns).sum()))


def _fresnel(cos: Array, eta: float) -> tuple[Array, Array]:
    """(reflectance, cosine of the refracted direction)."""
    square = 1.0 - (1.0 - cos * cos) / (eta * eta)
    inside = np.sqrt(np.maximum(square, 0.0))
    across = (cos - eta * inside) / np.maximum(cos + eta * inside, 1e-300)
    along = (eta * cos - inside) / np.maximum(eta * cos + inside, 1e-300)
    return np.where(square > 0.0, (across**2 + along**2) / 2.0, 1.0), inside


def _cot(z: Array, alpha: float) -> Array:
    with np.errstate(divide="ignore"):
        return z / (alpha * np.sqrt(np.maximum(1.0 - z * z, 0.0)))


def _ggx_masking(z: Array, alpha: float) -> Array:
    with np.errstate(divide="ignore"):
        return 2.0 / (1.0 + np.sqrt(1.0 + 1.0 / _cot(z, alpha) ** 2))


def _beckmann_masking(z: Array, alpha: float) -> Array:
    a = np.minimum(_cot(z, alpha), 2.0)
    return np.where(a < 1.6, (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a), 1.0)


def _stretched(sine: Array, mu: Array, alpha: float) -> tuple[Array, Array]:
    x = alpha * sine
    length = np.hypot(x, mu)
    return x / length, mu / length


def _ggx_normals(sine: Array, mu: Array, alpha: float, u0: Array, u1: Array) -> tuple[Array, Array]:
    """x and z, by spherical caps."""
    x, z = _stretched(sine, mu, alpha)
    k, phi = u0 * (1.0 + z), 2.0 * np.pi * u1
    ring = np.sqrt(np.maximum(k * (2.0 - k), 0.0))
    return _unit(alpha * (ring * np.cos(phi) + x), alpha * ring * np.sin(phi), (1.0 - u0) * (1.0 + z))


def _beckmann_normals(sine: Array, mu: Array, alpha: float, u0: Array, u1: Array) -> tuple[Array, Array]:
    """x and z, by bisection of the distributions of slopes."""
    s, c = _stretched(sine, mu, alpha)
    x, y = _slope(u0, s, c), _slope(u1, np.zeros_like(s[:1]), np.ones_like(c[:1]))
    return _unit(-alpha * x, -alpha * y, np.ones_like(x))


def _slope(u: Array, sine: Array, cosine: Array) -> Array:
    def below(x: Array) -> Array:
        return cosine * (1.0 + _erf(x)) / 2.0 + sine * np.exp(-x * x) / (2.0 * math.sqrt(math.pi))

    end = np.minimum(cosine / np.maximum(sine, 1e-3), 8.0)
    wanted = u * below(end)
    low, high = np.broadcast_arrays(np.full_like(wanted, -8.0), end + 0.0 * wanted)
    for _ in range(52):
        middle = (low + high) / 2.0
        inside = below(middle) < wanted
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return (low + high) / 2.0


def _unit(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, z / length
