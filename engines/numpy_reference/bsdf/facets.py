"""Rough surfaces made of microfacets: which way these lie, which are seen, and how a leaf's roughness is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.bsdf import beckmann, ggx
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import NumberParameter
from engines.numpy_reference.vectors import Array, Frame, Indices, Mask, dot, unit
from engines.scene import Number, Texture

SMOOTHEST = 1e-4
"""The least roughness that a texture gives."""


class RoughLeaf(Protocol):
    """Leaves with two roughnesses."""

    @property
    def alpha(self) -> tuple[Number, Number]: ...
    @property
    def distribution(self) -> str: ...


class Roughness:
    """The roughness of m leaves: constants or textures, GGX or Beckmann."""

    smooth: Mask
    """(m,) whether both roughnesses are the constant 0."""

    def __init__(self, leaves: Sequence[RoughLeaf]) -> None:
        textured = [any(isinstance(alpha, Texture) for alpha in leaf.alpha) for leaf in leaves]
        self.smooth = np.array([not t and not any(leaf.alpha) for leaf, t in zip(leaves, textured, strict=True)], bool)
        self._alpha = [NumberParameter([leaf.alpha[axis] for leaf in leaves], low=SMOOTHEST) for axis in (0, 1)]
        self._beckmann = np.array([leaf.distribution == "beckmann" for leaf in leaves], bool)

    def at(self, member: Indices, at: SurfaceInteraction) -> Facets:
        """Those of leaves that are not smooth."""
        alpha = np.stack([parameter(member, at) for parameter in self._alpha])
        return Facets.around(at, alpha, self._beckmann[member])


class Facets(NamedTuple):
    """The microfacets at n points, and the directions they are seen from. Directions are in the local frame."""

    frame: Frame
    wo: Array
    alpha: Array
    """(2, n) roughnesses along x and y, above 0."""
    beckmann: Mask
    """(n,) of the distribution of Beckmann, rather than GGX."""

    @classmethod
    def around(cls, at: SurfaceInteraction, alpha: Array, beckmann: Mask) -> Facets:
        """z along the shading normal, x along dp_du."""
        frame = Frame.along(at.normal, at.dp_du)
        return cls(frame, frame.to_local(at.wo), alpha, beckmann)

    def distribution(self, m: Array) -> Array:
        """D(m) (n,)."""
        return self._either(ggx.distribution(m, self.alpha), lambda: beckmann.distribution(m, self.alpha))

    def masking(self, v: Array) -> Array:
        """G1(v) (n,) in values; v may lie below the surface."""
        return self._either(ggx.masking(v, self.alpha), lambda: beckmann.masking(v, self.alpha))

    def pdf_visible(self, m: Array) -> Array:
        """(n,) density of `sample_visible` per solid angle."""
        pair = self.wo, m, self.alpha
        return self._either(ggx.pdf_visible_normals(*pair), lambda: beckmann.pdf_visible_normals(*pair))

    def sample_visible(self, u0: Array, u1: Array) -> Array:
        """(3, n) normals of facets as they are seen."""
        m = ggx.sample_visible_normals(self.wo, self.alpha, u0, u1)
        lanes = np.flatnonzero(self.beckmann)
        if lanes.size:
            wo, alpha = self.wo.take(lanes, axis=1), self.alpha.take(lanes, axis=1)
            m[:, lanes] = beckmann.sample_visible_normals(wo, alpha, u0[lanes], u1[lanes])
        return m

    def reflected(self, reflectance: Array, wi: Array, m: Array) -> Array:
        """(3, n) value of facets of this `reflectance`, (3, n): F D G1 G1 / (4 cos cos)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            facets = self.distribution(m) * self.masking(self.wo) * self.masking(wi)
            return reflectance * facets / (4.0 * self.wo[2] * wi[2])

    def transmitted(self, transmittance: Array, wi: Array, m: Array, eta: Array) -> Array:
        """(3, n) value of facets of this `transmittance`, (3, n), in units of radiance: its 1/eta^2 is in it."""
        out, into = dot(self.wo, m), dot(wi, m)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            facets = self.distribution(m) * self.masking(self.wo) * self.masking(wi)
            return transmittance * facets * np.abs(out * into / (self.wo[2] * wi[2])) / (out + eta * into) ** 2

    def weight(self, wi: Array) -> Array:
        """(n,) share of the light of `wi` that visible facets, which were sampled, let pass: G1(wi) where masking is exact."""
        with np.errstate(divide="ignore", invalid="ignore"):
            lit = self.masking(wi)
            if not self.beckmann.any():
                return lit
            ratio = beckmann.masking(self.wo, self.alpha) / beckmann.exact_masking(self.wo, self.alpha)
            return np.where(self.beckmann, lit * ratio, lit)

    def pdf_reflected(self, m: Array) -> Array:
        """(n,) density per solid angle of directions that visible facets reflect."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self.pdf_visible(m) / (4.0 * dot(self.wo, m))

    def pdf_transmitted(self, wi: Array, m: Array, eta: Array) -> Array:
        """(n,) density per solid angle of directions that visible facets refract."""
        into = dot(wi, m)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self.pdf_visible(m) * eta**2 * np.abs(into) / (dot(self.wo, m) + eta * into) ** 2

    def halfway(self, wi: Array, eta: Array) -> tuple[Array, Mask]:
        """(3, n) normals of the facets that send `wi` to `wo`: by reflection above the surface, by refraction below it, where
        `eta` (n,) is the index over that before it. And (n,) whether they can: both sides of a facet must be met."""
        below = wi[2] < 0.0
        with np.errstate(invalid="ignore"):
            m = unit(self.wo + np.where(below, eta, 1.0) * wi)
            m = np.where(m[2] < 0.0, -m, m)
            return m, (dot(self.wo, m) > 0.0) & np.where(below, dot(wi, m) < 0.0, dot(wi, m) > 0.0)

    def mirrored(self, m: Array) -> Array:
        """(3, n) directions that facets reflect to `wo`."""
        return 2.0 * dot(self.wo, m) * m - self.wo

    def _either(self, first: Array, second: Callable[[], Array]) -> Array:
        return np.where(self.beckmann, second(), first) if self.beckmann.any() else first
