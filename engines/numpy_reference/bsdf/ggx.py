"""The GGX (Trowbridge-Reitz) distribution of microfacets: how a rough surface's normals are spread, and which are seen.

Directions (3, n) are unit and in the local frame: z along the surface's normal, and roughnesses `alpha` (2, n) along x and
y. Sources: Walter et al., Microfacet Models for Refraction (2007); Heitz, Understanding the Masking-Shadowing Function
(2014) and Sampling the GGX Distribution of Visible Normals (2018).
"""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import Array, dot, unit


def distribution(m: Array, alpha: Array) -> Array:
    """D(m) (n,): area of the facets with normal m, per solid angle and area of the surface; for m.z > 0."""
    ax, ay = alpha
    ellipsoid = (m[0] / ax) ** 2 + (m[1] / ay) ** 2 + m[2] ** 2
    return 1.0 / (np.pi * ax * ay * ellipsoid**2)


def masking(v: Array, alpha: Array) -> Array:
    """Smith's G1(v) (n,): the share of the facets facing v that are seen from there; for v.z > 0."""
    tangent2 = ((alpha[0] * v[0]) ** 2 + (alpha[1] * v[1]) ** 2) / v[2] ** 2
    return 2.0 / (1.0 + np.sqrt(1.0 + tangent2))


def pdf_visible_normals(wo: Array, m: Array, alpha: Array) -> Array:
    """(n,) density per solid angle of the facets' normals as they are seen from wo."""
    return masking(wo, alpha) * distribution(m, alpha) * dot(wo, m) / wo[2]


def sample_visible_normals(wo: Array, alpha: Array, u0: Array, u1: Array) -> Array:
    """(3, n) normals of facets with the density `pdf_visible_normals`, by two draws.

    Stretched by the roughness, the facets are those of a hemisphere. What is seen of it reflects the view into a spherical
    cap around it, evenly (Dupuy and Benyoub, Sampling Visible GGX Normals with Spherical Caps, 2023).
    """
    ax, ay = alpha
    view = unit(np.stack([ax * wo[0], ay * wo[1], wo[2]]))
    drop, phi = u0 * (1.0 + view[2]), 2.0 * np.pi * u1  # drop: 1 - z on the cap, which keeps its digits near the pole
    ring = np.sqrt(drop * (2.0 - drop))
    halfway = np.stack([ring * np.cos(phi) + view[0], ring * np.sin(phi) + view[1], (1.0 - u0) * (1.0 + view[2])])
    return unit(np.stack([ax * halfway[0], ay * halfway[1], halfway[2]]))
