"""Closed forms for the light that a point receives, per unit of radiance; the floor's normal is up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike


def polygon(corners: ArrayLike, normal: Sequence[float]) -> float:
    """Irradiance at the origin from a polygon (n, 3) that is black behind; the part below the horizon is cut off.

    Lambert 1760: E = 1/2 sum theta_i (n . unit(v_i x v_{i+1})), theta by atan2.
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


def roulette_second_moment(emission: float, rho: float, least: float = 1e-18) -> float:
    """E[L^2] of a furnace path that may end after every segment, survival q = min(beta, 0.95).

    L = E sum of beta_k over the segments reached; beta_{k+1} = rho beta_k / q_k. Backwards over k: with the rest
    S_k = E beta_k + (alive) S_{k+1}, mean and second moment follow from those of S_{k+1}.
    """
    betas, survivals, beta = [1.0], [], 1.0
    while len(betas) < 400 and beta > least:
        scattered = rho * beta
        survival = min(scattered, 0.95)
        beta = scattered / survival
        survivals.append(survival)
        betas.append(beta)
    mean, second = 0.0, 0.0
    for value, survival in zip(reversed(betas[:-1]), reversed(survivals), strict=True):
        here = emission * value
        mean, second = here + survival * mean, here * here + 2 * here * survival * mean + survival * second
    return second
