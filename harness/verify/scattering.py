"""Values of BSDF models in closed form, as docs/transport.md has them, for grey parameters.

Directions are in the local frame: z along the normal on the viewer's side, `wo` (3,) with z > 0, `wi` (3, n). Values (n,) are
f |cos|, without delta lobes. No code is shared with an engine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from engines.scene import Conductor, Dielectric, Diffuse, Plastic, Principled, Sheen
from harness.verify.case import Array


def fresnel(cosine: Any, eta: float) -> Array:
    """Reflectance of unpolarised light by a dielectric; `eta` is the index behind over the one in front."""
    c = np.asarray(cosine, np.float64)
    g = np.sqrt(np.maximum(eta**2 - 1 + c * c, 0.0))
    return (((c - g) / (c + g)) ** 2 + ((eta**2 * c - g) / (eta**2 * c + g)) ** 2) / 2


def metal(cosine: Array, eta: float, k: float) -> Array:
    """Reflectance of unpolarised light by a metal of index eta + i k."""
    index = (eta + 1j * k) ** 2
    w = np.sqrt(index - (1 - cosine**2))
    return (np.abs((cosine - w) / (cosine + w)) ** 2 + np.abs((index * cosine - w) / (index * cosine + w)) ** 2) / 2


def facets(m: Array, alpha: tuple[float, float], beckmann: bool = False) -> Array:
    """D(m), per solid angle."""
    slope2 = ((m[0] / alpha[0]) ** 2 + (m[1] / alpha[1]) ** 2) / m[2] ** 2
    shape = np.exp(-slope2) if beckmann else 1 / (1 + slope2) ** 2
    return shape / (math.pi * alpha[0] * alpha[1] * m[2] ** 4)


def seen(v: Array, alpha: tuple[float, float], beckmann: bool = False) -> Array:
    """Smith's G1(v); of Beckmann's distribution by the rational function of Walter et al. (2007)."""
    spread = np.hypot(alpha[0] * v[0], alpha[1] * v[1]) / np.abs(v[2])
    if not beckmann:
        return 2 / (1 + np.sqrt(1 + spread**2))
    a = 1 / np.maximum(spread, 1e-300)
    held = np.minimum(a, 1.6)
    return np.where(a < 1.6, held * (3.535 + 2.181 * held) / (1 + held * (2.276 + 2.577 * held)), 1.0)


def unit(v: Array) -> Array:
    return v / np.sqrt((v * v).sum(axis=0))


def _reflected(wo: Array, wi: Array, alpha: tuple[float, float], beckmann: bool = False) -> tuple[Array, Array]:
    """D G1 G1 / (4 wo.z), and the cosine at the facets; wi.z > 0."""
    m = unit(wo[:, None] + wi)
    masking = seen(wo, alpha, beckmann) * seen(wi, alpha, beckmann)
    return facets(m, alpha, beckmann) * masking / (4 * wo[2]), (wo[:, None] * m).sum(axis=0)


def _refracted(wo: Array, wi: Array, eta: float, alpha: tuple[float, float], beckmann: bool = False) -> tuple[Array, Array]:
    """The factor of 1 - F for light from behind, and the cosine before the facets; wi.z < 0."""
    m = unit(wo[:, None] + eta * wi)
    m = np.where(m[2] < 0, -m, m)
    out, into = (wo[:, None] * m).sum(axis=0), (wi * m).sum(axis=0)
    masking = seen(wo, alpha, beckmann) * seen(wi, alpha, beckmann)
    value = facets(m, alpha, beckmann) * masking * out * np.abs(into) / (wo[2] * (out + eta * into) ** 2)
    return np.where((out > 0) & (into < 0), value, 0.0), np.maximum(out, 0.0)


def _diffuse(leaf: Diffuse, wo: Array, wi: Array, front: bool) -> Array:
    return _grey(leaf.reflectance) / math.pi * np.maximum(wi[2], 0.0)


def _conductor(leaf: Conductor, wo: Array, wi: Array, front: bool) -> Array:
    value, cosine = _reflected(wo, wi, _alphas(leaf), leaf.distribution == "beckmann")
    reflectance = _grey(leaf.reflectance) * metal(cosine, leaf.eta[0], leaf.k[0])
    return np.where(wi[2] > 0, reflectance * value, 0.0)


def _dielectric(leaf: Dielectric, wo: Array, wi: Array, front: bool) -> Array:
    eta, beckmann = leaf.ior if front else 1 / leaf.ior, leaf.distribution == "beckmann"
    above, cosine = _reflected(wo, wi, _alphas(leaf), beckmann)
    above = above * _grey(leaf.reflectance) * fresnel(cosine, eta)
    below, cosine = _refracted(wo, wi, eta, _alphas(leaf), beckmann)
    below = below * _grey(leaf.transmittance) * (1 - fresnel(cosine, eta))
    return np.where(wi[2] > 0, above, below)


def _plastic(leaf: Plastic, wo: Array, wi: Array, front: bool) -> Array:
    eta, rho = leaf.ior, _grey(leaf.diffuse)
    inside = 0.0636 * eta + 0.6681 + 0.7099 / eta - 1.4399 / eta**2
    passed = (1 - fresnel(wo[2], eta)) * (1 - fresnel(np.abs(wi[2]), eta))
    coat = np.zeros(wi.shape[1])
    if leaf.alpha:
        table, inside = _coat(eta, leaf.alpha)
        nodes = np.linspace(0, 1, table.size)
        passed = np.interp(wo[2], nodes, table) * np.interp(wi[2], nodes, table)
        coat, cosine = _reflected(wo, wi, (leaf.alpha, leaf.alpha))
        coat = coat * _grey(leaf.reflectance) * fresnel(cosine, eta)
    base = passed * rho / (math.pi * eta**2 * (1 - (rho if leaf.nonlinear else 1.0) * inside))
    return np.where(wi[2] > 0, coat + base * wi[2], 0.0)


@cache
def _coat(eta: float, alpha: float) -> tuple[Array, float]:
    """What a rough GGX coat lets pass by the cosine, at 64 nodes, and the share that it reflects inside.

    Means over visible normals (spherical caps, Dupuy and Benyoub 2023) by Gauss and Legendre's rule.
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    u, v = np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2, indexing="ij")
    weight = np.outer(weights, weights) / 4
    passed, inside = [], 0.0
    for cosine in np.maximum(np.linspace(0, 1, 64), 1e-6):
        wo = np.array([math.sqrt(1 - cosine**2), 0.0, cosine])
        view = unit(np.array([alpha, alpha, 1.0]) * wo)
        z = 1 - u * (1 + view[2])
        ring, phi = np.sqrt(np.maximum(1 - z * z, 0)), 2 * math.pi * v
        cap = np.stack([ring * np.cos(phi) + view[0], ring * np.sin(phi) + view[1], z + view[2]])
        m = unit(np.array([alpha, alpha, 1.0])[:, None, None] * cap)
        c1 = np.maximum((wo[:, None, None] * m).sum(axis=0), 0.0)
        c2 = np.sqrt(1 - (1 - c1**2) / eta**2)
        down = (c1 / eta - c2) * m - wo[:, None, None] / eta
        up = 2 * c1 * m - wo[:, None, None]
        share = np.where(down[2] < 0, (1 - fresnel(c1, eta)) * seen(down, (alpha, alpha)), 0.0)
        back = np.where(up[2] > 0, fresnel(c1, 1 / eta) * seen(up, (alpha, alpha)), 0.0)
        passed.append(float((weight * share).sum()))
        inside += 2 / 64 * cosine * float((weight * back).sum())
    return np.array(passed), inside


def _principled(leaf: Principled, wo: Array, wi: Array, front: bool) -> Array:
    base, rough, t = _grey(leaf.base_color), _number(leaf.roughness), _number(leaf.spec_trans)
    metallic, tint = _number(leaf.metallic), _number(leaf.spec_tint)
    aspect = math.sqrt(1 - 0.9 * _number(leaf.anisotropic))
    alpha = max(0.001, rough**2 / aspect), max(0.001, rough**2 * aspect)
    front = front or t == 0
    eta = leaf.eta if front else 1 / leaf.eta
    glass, base_weight = (1 - metallic) * t, (1 - metallic) * (1 - t)

    def fifth(cosine: Any) -> Array:
        return (1 - np.asarray(cosine)) ** 5

    def schlick(at_normal: float, cosine: Array) -> Array:
        return at_normal + (1 - at_normal) * fifth(cosine)

    below, cosine = _refracted(wo, wi, eta, alpha)
    below = below * math.sqrt(base) * glass * (1 - fresnel(cosine, eta))
    value, cosine = _reflected(wo, wi, alpha)
    reflectance = fresnel(cosine, eta)
    if not front:
        return np.where(wi[2] > 0, value * glass * reflectance, below)
    at_normal = ((leaf.eta - 1) / (leaf.eta + 1)) ** 2  # the tint of grey is white
    reflectance = (1 - metallic) * (1 - tint) * reflectance + metallic * schlick(base, cosine)
    above = value * (reflectance + (1 - metallic) * tint * schlick(at_normal, cosine))
    m, into = unit(wo[:, None] + wi), np.maximum(wi[2], 0.0)
    gloss, coat = _number(leaf.clearcoat_gloss), _number(leaf.clearcoat)
    q = (0.1 * (1 - gloss) + 0.001 * gloss) ** 2
    tail = (q - 1) / (math.pi * math.log(q) * (1 + (q - 1) * m[2] ** 2))
    above = above + 0.25 * coat * schlick(0.04, cosine) * tail * seen(wo, (0.25, 0.25)) * seen(wi, (0.25, 0.25)) * into
    retro, a, b = 2 * rough * cosine**2, fifth(wo[2]), fifth(into)
    burley = (1 - a / 2) * (1 - b / 2) + retro * (a + b + a * b * (retro - 1))
    under = (1 + (retro / 2 - 1) * a) * (1 + (retro / 2 - 1) * b)
    flat = 1.25 * (under * (1 / (wo[2] + into) - 0.5) + 0.5)
    f = _number(leaf.flatness)
    above = above + base_weight * base / math.pi * ((1 - f) * burley + f * flat) * into
    above = above + _number(leaf.sheen) * (1 - metallic) * fifth(cosine) * into
    return np.where(wi[2] > 0, above, below)


def _sheen(leaf: Sheen, wo: Array, wi: Array, front: bool) -> Array:
    theta_d = np.arccos(np.clip(wo @ wi, -1.0, 1.0)) / 2
    return _grey(leaf.color) * (1 - np.cos(theta_d)) ** 5 * np.maximum(wi[2], 0.0)


def _grey(color: Any) -> float:
    assert color[0] == color[1] == color[2]
    return float(color[0])


def _number(value: Any) -> float:
    return float(value)


def _alphas(leaf: Conductor | Dielectric) -> tuple[float, float]:
    return _number(leaf.alpha[0]), _number(leaf.alpha[1])


FORMS: dict[type, Callable[[Any, Array, Array, bool], Array]] = {
    Diffuse: _diffuse,
    Conductor: _conductor,
    Dielectric: _dielectric,
    Plastic: _plastic,
    Principled: _principled,
    Sheen: _sheen,
}


def value(leaf: Any, wo: Array, wi: Array, front: bool) -> Array:
    """f |cos| (n,) of a model of grey constants; `front`: it is seen from the side of its normal."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(FORMS[type(leaf)](leaf, wo, wi, front))
