"""Lights chosen evenly, or in proportion to their power."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.distribution import first_above, rest
from engines.numpy_reference.vectors import Array, Indices


class ChosenLight(NamedTuple):
    """n choices of a light."""

    light: Indices
    """(n,) places in the list of lights, -1 where none is chosen."""
    uc: Array
    """(n,) what is left of the random number, in [0, 1)."""
    inverse_pmf: Array
    """(n,) 1 / the probability of the choice."""


class LightSampler(Protocol):
    """Points (3, n) and the geometric normals there, which face the viewer and are 0 in media, are those of the vertices."""

    def choose(self, point: Array, geometric: Array, u: Array) -> ChosenLight:
        """One light a point, by a random number (n,) each."""
        ...

    def inverse_pmf(self, light: Indices, point: Array, geometric: Array) -> Array:
        """(n,) 1 / the probability with which `choose` gives the lights, inf where never."""
        ...


class UniformLightSampler:
    """Each of `count` lights with the same probability."""

    def __init__(self, count: int) -> None:
        self._count = count

    def choose(self, point: Array, geometric: Array, u: Array) -> ChosenLight:
        scaled = u * self._count
        light = np.minimum(scaled.astype(np.int64), self._count - 1)
        return ChosenLight(light, scaled - light, self.inverse_pmf(light, point, geometric))

    def inverse_pmf(self, light: Indices, point: Array, geometric: Array) -> Array:
        return np.full(light.size, float(self._count))


class PowerLightSampler:
    """Lights in proportion to their power, of which `shares` (J,) add up to 1, wherever the vertex is."""

    def __init__(self, shares: Array) -> None:
        sums = np.cumsum(shares)
        self._cumulative = sums / sums[-1]
        with np.errstate(divide="ignore"):
            self._inverse_pmf = 1.0 / shares

    def choose(self, point: Array, geometric: Array, u: Array) -> ChosenLight:
        start = np.zeros(u.size, np.int64)
        light = first_above(self._cumulative, start, start + self._cumulative.size, u)
        return ChosenLight(light, rest(self._cumulative, start, light, u), self._inverse_pmf[light])

    def inverse_pmf(self, light: Indices, point: Array, geometric: Array) -> Array:
        return self._inverse_pmf[light]
