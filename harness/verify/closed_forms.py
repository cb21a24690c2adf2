"""Closed forms: irradiance and form factors, per unit of radiance (the normal of a floor is +y), metals, media."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike


def polygon(corners: ArrayLike, normal: Sequence[float]) -> float:
    """Irradiance at the origin from a one-sided polygon (n, 3); the part below the horizon is clipped.

    Lambert 1760: E = 1/2 sum theta_i (n . normalize(v_i x v_{i+1})), theta by atan2.
    """
    n, points = np.asarray(normal, np.float64), _above(np.asarray(corners, np.float64), np.asarray(normal, np.float64))
    total = 0.0
    for i in range(len(points)):
        a, b = points[i], points[(i + 1) % len(points)]
        across = np.cross(a, b)
        length = float(np.linalg.norm(across))
        if length > 0:
            total += math.atan2(length, float(a @ b)) * float(n @ across) / length
    return abs(total) / 2


def _above(points: np.ndarray, n: np.ndarray) -> np.ndarray:
    """The polygon clipped to the half space n . p > 0 (Sutherland and Hodgman 1974)."""
    kept = []
    for i in range(len(points)):
        a, b = points[i], points[(i + 1) % len(points)]
        ha, hb = float(n @ a), float(n @ b)
        if ha >= 0:
            kept.append(a)
        if ha * hb < 0:
            kept.append(a + ha / (ha - hb) * (b - a))
    return np.array(kept).reshape(-1, 3)


def sphere(radius: float, distance: float, beta: float) -> float:
    """Irradiance from a sphere whose centre is `distance` away at the angle `beta` from the normal (Snyder 1996)."""
    s = radius / distance
    if beta + math.asin(s) <= math.pi / 2:
        return math.pi * s * s * math.cos(beta)
    h = distance / radius
    c1 = math.sqrt(h * h - 1)
    y = -c1 / math.tan(beta) if beta != math.pi / 2 else 0.0
    root = math.sin(beta) * math.sqrt(1 - y * y)
    return (math.cos(beta) * math.acos(y) - c1 * root) / (h * h) + math.atan(root / c1)


def parallel_rectangles(x: float, y: float) -> float:
    """Form factor of equal rectangles that face each other, sides x and y in units of their distance (Howell, C-11)."""
    u, v = 1 + x * x, 1 + y * y
    arcs = x * math.sqrt(v) * math.atan(x / math.sqrt(v)) + y * math.sqrt(u) * math.atan(y / math.sqrt(u))
    return 2 / (math.pi * x * y) * (math.log(u * v / (u + v - 1)) / 2 + arcs - x * math.atan(x) - y * math.atan(y))


def perpendicular_rectangles(height: float, width: float) -> float:
    """From a rectangle `width` wide to one `height` high at a right angle, in units of their common edge (Howell, C-14)."""
    h, w = height * height, width * width
    across = math.sqrt(h + w)
    arcs = width * math.atan(1 / width) + height * math.atan(1 / height) - across * math.atan(1 / across)
    logs = math.log((1 + w) * (1 + h) / (1 + w + h))
    logs += w * math.log(w * (1 + w + h) / ((1 + w) * (w + h))) + h * math.log(h * (1 + w + h) / ((1 + h) * (w + h)))
    return (arcs + logs / 4) / (math.pi * width)


def coaxial_discs(first: float, second: float) -> float:
    """From a disc to one that faces it, radii in units of their distance (Howell, C-41)."""
    s = 1 + (1 + second**2) / first**2
    return (s - math.sqrt(s * s - 4 * (second / first) ** 2)) / 2


def parallel_disk(radius: float, height: float, offset: float) -> float:
    """Irradiance from a disk that faces a floor `height` below it, `offset` from its axis (Howell, B-13)."""
    r2, h2, x2 = radius**2, height**2, offset**2
    return math.pi / 2 * (1 - (h2 + x2 - r2) / math.sqrt((h2 + x2 + r2) ** 2 - 4 * r2 * x2))


def conductor(eta: float, k: float, cosine: float) -> float:
    """Fresnel reflectance of a metal for unpolarised light, in real numbers (Born and Wolf, Principles of Optics, 14.2)."""
    c2, s2 = cosine**2, 1 - cosine**2
    g = eta**2 - k**2 - s2
    b = math.hypot(g, 2 * eta * k)
    twice = 2 * cosine * math.sqrt(max(0.0, (b + g) / 2))
    across = (b + c2 - twice) / (b + c2 + twice)
    along = across * (b * c2 + s2**2 - twice * s2) / (b * c2 + s2**2 + twice * s2)
    return (across + along) / 2


def specular_value(alpha: float, wo: np.ndarray, wi: np.ndarray) -> float:
    """f cos of a white isotropic GGX surface, its normal +y (Walter et al. 2007, equations 20, 33 and 34)."""
    half = (wo + wi) / np.linalg.norm(wo + wi)
    d = alpha**2 / (math.pi * (half[1] ** 2 * (alpha**2 - 1) + 1) ** 2)
    g = [2 / (1 + math.sqrt(1 + alpha**2 * (1 / v[1] ** 2 - 1))) for v in (wo, wi)]
    return float(d * g[0] * g[1] / (4 * wo[1]))


def roulette_second_moment(emission: float, rho: float, survival: float) -> float:
    """E[L^2] of paths in a closed furnace that go on with a constant probability after every segment.

    L = E sum of (rho / survival)^k over the segments reached; infinite where rho^2 >= survival.
    """
    return emission**2 * (1 + rho) / ((1 - rho) * (1 - rho * rho / survival))


def henyey_greenstein(g: float, cosine: float) -> float:
    """The phase function, per solid angle, by the cosine of the angle that light is turned by."""
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def back_scattering(depth: float, albedo: float, g: float) -> float:
    """Radiance of light that a slab of this optical depth scatters once, back along the sun's rays, per unit of irradiance."""
    return albedo * henyey_greenstein(g, -1.0) * (1 - math.exp(-2 * depth)) / 2


def forward_scattering(depth: float, albedo: float, g: float) -> float:
    """The same through the slab, on along the sun's rays."""
    return albedo * henyey_greenstein(g, 1.0) * depth * math.exp(-depth)


def half_space(albedo: float, incident: float, seen: float) -> float:
    """Radiance at the cosine `seen` of isotropic scatterers that fill all below a plane, under rays at the cosine `incident`,
    of irradiance 1 across them (Chandrasekhar 1950, Radiative Transfer, 123)."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu, weights = (nodes + 1) / 2, weights / 2
    h = np.ones(mu.size)

    def at(cosine: float) -> float:
        return 1 / (math.sqrt(1 - albedo) + albedo / 2 * float((weights * mu * h / (cosine + mu)).sum()))

    for _ in range(200):
        h = np.array([at(cosine) for cosine in mu])
    return albedo / (4 * math.pi) * incident / (incident + seen) * at(incident) * at(seen)
