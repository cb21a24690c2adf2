"""Fresnel's equations for unpolarised light: how much a smooth surface reflects."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import Array


def fresnel_dielectric(c1: Array, eta: Array) -> tuple[Array, Array]:
    """Reflectance of a dielectric, and the cosine c2 of the refracted ray: (n,) each.

    `c1` is the cosine of the incident ray, `eta` the index behind the surface over the one before it. Under total
    reflection the reflectance is 1 and c2 is 0.
    """
    s2 = (1.0 - c1 * c1) / (eta * eta)
    total = s2 >= 1.0
    c2 = np.sqrt(np.where(total, 0.0, 1.0 - s2))
    perpendicular = (c1 - eta * c2) / (c1 + eta * c2)
    parallel = (eta * c1 - c2) / (eta * c1 + c2)
    mean = 0.5 * perpendicular * perpendicular + 0.5 * parallel * parallel
    return np.where(total, 1.0, mean), c2


def fresnel_conductor(cosine: Array, eta: Array, k: Array) -> Array:
    """Reflectance of a conductor of complex index `eta` + i `k`; the arguments broadcast.

    The equations are those of a dielectric, with complex numbers (Born and Wolf, Principles of Optics, 14.2). `refracted`
    is the complex index times the cosine of the refracted ray.
    """
    index2 = (eta + 1j * k) ** 2
    refracted = np.sqrt(index2 - (1.0 - cosine * cosine))
    perpendicular = (cosine - refracted) / (cosine + refracted)
    parallel = (index2 * cosine - refracted) / (index2 * cosine + refracted)
    return 0.5 * np.abs(perpendicular) ** 2 + 0.5 * np.abs(parallel) ** 2
