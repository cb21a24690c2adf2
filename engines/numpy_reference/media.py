"""Homogeneous media: which one rays are in, how far they fly in it, what passes, and how it scatters (docs/transport.md,
"Media")."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from engines.numpy_reference.distribution import BELOW_ONE, last_begun
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, Mask, along, dot
from engines.scene import HomogeneousMedium, Shape, singles

VACUUM = -1
"""Where there is no medium: the last column of every table."""


class MediumInteraction(NamedTuple):
    """n points where media scatter light. They have no normal: both are 0, and lights are sampled all around."""

    point: Array
    wo: Array
    """(3, n) unit, back along the ray."""
    medium: Indices
    offset: Array
    """(n,) metres by which shadow rays end early; rays from here start at the point itself."""

    @property
    def normal(self) -> Array:
        """(3, n) zeros."""
        return np.zeros(self.point.shape)

    @property
    def geometric(self) -> Array:
        """(3, n) zeros."""
        return np.zeros(self.point.shape)

    @property
    def primitive_id(self) -> Indices:
        """(n,) -1: rays from here leave no primitive."""
        return np.full(self.medium.size, -1)

    def take(self, lanes: Indices) -> MediumInteraction:
        """The interactions at some of the points."""
        taken: list[Any] = [field.take(lanes, axis=-1) for field in self]
        return MediumInteraction(*taken)

    def spawn(self, wi: Array) -> Array:
        """(3, n) origins of rays along `wi`."""
        return self.point

    def cosine(self, wi: Array) -> Array:
        """(n,) ones: no surface is inclined to the light."""
        return np.ones(self.medium.size)

    def faces(self, wi: Array) -> Mask:
        """(n,) whether light along `wi` may be scattered: it is."""
        return np.ones(self.medium.size, bool)


class Media:
    """A column for each of m media, and one for vacuum: `sigma_t` (1/m), `albedo` (3, m + 1) and `g` (m + 1,). `any` says
    whether there are media."""

    def __init__(self, media: Sequence[HomogeneousMedium], shapes: Sequence[Shape], geometry: Geometry) -> None:
        self.any = bool(media)
        vacuum = HomogeneousMedium("vacuum", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        columns = (*media, vacuum)
        self.sigma_t = np.array([medium.sigma_t for medium in columns]).T
        self.albedo = np.array([medium.albedo for medium in columns]).T
        self.g = np.array([medium.g for medium in columns])
        # the last row is that of no shape
        sides = [*((shape.interior, shape.exterior) for _, shape in singles(shapes)), (None, None)]
        self._interior, self._exterior = np.array([[VACUUM if side is None else side for side in pair] for pair in sides]).T
        self._boundary = (self._interior != VACUUM) | (self._exterior != VACUUM)
        self._geometry = geometry

    def beyond(self, at: SurfaceInteraction | MediumInteraction, wi: Array, medium: Indices) -> Indices:
        """(n,) the media that rays along `wi` enter; the given one, where the surface is no boundary of media."""
        if not self.any or isinstance(at, MediumInteraction):
            return medium
        met = at.primitive_id >= 0
        shape = np.where(met, self._geometry.single[self._geometry.row(np.where(met, at.primitive_id, 0))], -1)
        cosine = dot(at.geometric, wi)
        outside = np.where(at.front, cosine, -cosine) > 0.0
        return np.where(self._boundary[shape], np.where(outside, self._exterior[shape], self._interior[shape]), medium)

    def transmittance(self, medium: Indices, distance: Array) -> Array:
        """(3, n) the share of light that passes so many metres (n,), inf too."""
        sigma_t = self.sigma_t.take(medium, axis=1)
        with np.errstate(invalid="ignore"):
            return np.where(sigma_t > 0.0, np.exp(-sigma_t * distance), 1.0)

    def fly(self, medium: Indices, throughput: Array, u: Array, distance: Array) -> tuple[Array, Array]:
        """(n,) metres to where media scatter rays, by numbers in [0, 1): not before the surface, `distance` (n,) away, where
        they are as far or farther; and the weights (3, n) of what happens first.

        Where the three extinctions differ, a channel draws the distance, in proportion to its throughput, and the weights are
        those of the balance heuristic over the channels.
        """
        sigma_t = self.sigma_t.take(medium, axis=1)
        grey = (sigma_t == sigma_t[0]).all(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            channel, rest = _channel(throughput, u)
            channel, rest = np.where(grey, 0, channel), np.where(grey, u, rest)
            chosen = np.take_along_axis(sigma_t, channel[None], axis=0)[0]
            flight = np.where(chosen > 0.0, -np.log1p(-rest) / chosen, np.inf)
            way = np.minimum(flight, distance)
            # of channels that light is left in; a factor that all have in common is left out
            present = throughput > 0.0
            least = np.where(present, sigma_t, np.inf).min(axis=0)
            passed = np.where(sigma_t > least, np.exp(-(sigma_t - least) * way), 1.0)
            density = np.where(present, np.where(flight < distance, sigma_t, 1.0) * passed, 0.0)
            share = throughput / throughput.sum(axis=0)
            weight = density / (share * density).sum(axis=0)
        return flight, np.where(grey, 1.0, weight)

    def evaluate(self, at: MediumInteraction, wi: Array) -> Array:
        """(3, n) the phase function, 1/sr."""
        return np.repeat(self.pdf(at, wi)[None], 3, axis=0)

    def pdf(self, at: MediumInteraction, wi: Array) -> Array:
        """(n,) per solid angle, with which `sample` finds directions: the phase function itself."""
        g = self.g[at.medium]
        # not from the cosine: at the peak it rounds to 1, while the difference of directions keeps their angle
        off = at.wo + np.where(g < 0.0, -1.0, 1.0) * wi
        return _henyey_greenstein(g, 0.5 * dot(off, off))

    def sample(self, at: MediumInteraction, u0: Array, u1: Array) -> tuple[Array, Array]:
        """Unit directions (3, n) in which light is scattered, and their pdf per solid angle (n,)."""
        g, phi = self.g[at.medium], 2.0 * np.pi * u1
        size, share = np.abs(g), np.where(g < 0.0, 1.0 - u0, u0)
        ratio = (1.0 - size) / (1.0 - size + 2.0 * size * share)
        versine = 2.0 * (1.0 - share) * (1.0 + size * share) * ratio * ratio
        cosine = np.where(g < 0.0, versine - 1.0, 1.0 - versine)
        sine = np.sqrt(np.maximum(versine * (2.0 - versine), 0.0))
        return along(sine * np.cos(phi), sine * np.sin(phi), cosine, -at.wo), _henyey_greenstein(g, versine)


def _channel(throughput: Array, u: Array) -> tuple[Indices, Array]:
    """(n,) channels, in proportion to `throughput` (3, n), and the rests of the numbers in [0, 1) that have chosen them."""
    channel, begin, total = last_begun(throughput, u)
    size = np.take_along_axis(throughput, channel[None], axis=0)[0]
    return channel, np.minimum((u * total - begin) / size, BELOW_ONE)


def _henyey_greenstein(g: Array, versine: Array) -> Array:
    """(n,) per solid angle, of scattering by angles with these versines, 1 minus the cosine, from the peak of the phase
    function (Henyey and Greenstein 1941)."""
    size, least = np.abs(g), 1.0 - np.abs(g)
    return least * (1.0 + size) / (4.0 * np.pi * (least * least + 2.0 * size * versine) ** 1.5)
