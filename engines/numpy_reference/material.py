"""How surfaces answer light: the table of materials, the lobes of a point, mirror and refracted directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.surface import Surface
from engines.numpy_reference.vectors import Array, Indices, Mask, dot
from engines.scene.model import Material


class Materials:
    """A column for each material: `kd`, `ks`, `kt`, `emission` (3, m); `ior`, `fresnel`, `two_sided` (m,)."""

    def __init__(self, materials: Sequence[Material]) -> None:
        def colours(name: str) -> Array:
            return np.array([getattr(material, name) for material in materials], np.float64).reshape(-1, 3).T.copy()

        self.kd, self.ks, self.kt, self.emission = map(colours, ("kd", "ks", "kt", "emission"))
        self.ior = np.array([material.ior for material in materials], np.float64)
        self.fresnel = np.array([material.fresnel for material in materials], bool)
        self.two_sided = np.array([material.two_sided for material in materials], bool)
        self.specular = bool(self.ks.any() or self.kt.any())
        """Whether anything is a mirror or lets light through."""
        self.emissive = bool((self.emission > 0.0).any())
        """Whether any surface emits."""

    def emitted(self, surface: Surface) -> Array:
        """(3, n) radiance that the surface sends back along the rays that found it."""
        lit = surface.front | self.two_sided[surface.material]
        return np.where(lit, self.emission.take(surface.material, axis=1), 0.0)


class Lobes(NamedTuple):
    """What n points do with light: weights (3, n) of the diffuse, mirror and refraction lobes, Fresnel terms included,
    and `d`, `r`, `t` (n,), the sums of each over red, green and blue."""

    diffuse: Array
    mirror: Array
    refraction: Array
    d: Array
    r: Array
    t: Array

    def take(self, lanes: Indices) -> Lobes:
        """The lobes at some of the points."""
        return Lobes(*(field.take(lanes, axis=-1) for field in self))


class Refraction(NamedTuple):
    """Unit directions (3, n) of light that passes a surface, and the factor `scale` (n,) on its radiance, 1/eta^2.

    Under `total` reflection (n,) the direction is that of the mirror and the scale is 1."""

    direction: Array
    scale: Array
    total: Mask


def lobes(materials: Materials, surface: Surface, direction: Array) -> Lobes:
    """The lobes at points that rays along unit `direction` (3, n) have hit."""
    kd = materials.kd.take(surface.material, axis=1)
    if not materials.specular:
        nothing = np.zeros_like(kd)
        return Lobes(kd, nothing, nothing, kd.sum(axis=0), nothing[0], nothing[0])
    ks, kt = (table.take(surface.material, axis=1) for table in (materials.ks, materials.kt))
    reflectance, _ = fresnel(np.abs(dot(direction, surface.normal)), _index_ratio(materials, surface))
    coated = materials.fresnel[surface.material]
    mirror = np.where(coated, ks * reflectance, ks)
    refraction = np.where(coated, kt * (1.0 - reflectance), kt)
    return Lobes(kd, mirror, refraction, kd.sum(axis=0), mirror.sum(axis=0), refraction.sum(axis=0))


def mirrored(surface: Surface, direction: Array) -> Array:
    """(3, n) mirror directions of rays along unit `direction`."""
    return direction - 2.0 * dot(direction, surface.normal) * surface.normal


def refracted(materials: Materials, surface: Surface, direction: Array) -> Refraction:
    """Where rays along unit `direction` (3, n) go behind the surface."""
    eta = _index_ratio(materials, surface)
    c1 = np.abs(dot(direction, surface.normal))
    _, c2 = fresnel(c1, eta)
    total = c2 == 0.0
    bent = direction / eta + (c1 / eta - c2) * surface.normal
    return Refraction(
        np.where(total, mirrored(surface, direction), bent), np.where(total, 1.0, 1.0 / (eta * eta)), total
    )


def fresnel(c1: Array, eta: Array) -> tuple[Array, Array]:
    """Reflectance of a dielectric for unpolarised light, and the cosine c2 of the refracted ray: (n,) each.

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


def _index_ratio(materials: Materials, surface: Surface) -> Array:
    ior = materials.ior[surface.material]
    return np.where(surface.front, ior, 1.0 / ior)
