"""What a kind of light can do, and what sampling a light from a point gives, whatever the light.

A new kind is a module with a class that has the verbs of `LightSet`, and a table: `LIGHTS = {PointLight: PointLights}`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.vectors import Array, Indices


class LightSample(NamedTuple):
    """n samples of lights, one a point. No sample: `weight` is 0, whatever the rest says."""

    wi: Array
    """(3, n) unit, from the point to the light."""
    distance: Array
    """(n,) metres, inf for lights at infinity."""
    weight: Array
    """(3, n) Li / pdf; for delta lights what stands in its place: W/m2 on a surface that faces the light."""
    pdf: Array
    """(n,) per solid angle, inf for delta lights."""

    @classmethod
    def empty(cls, n: int) -> LightSample:
        """Samples that hold nothing yet."""
        return cls(np.zeros((3, n)), np.zeros(n), np.zeros((3, n)), np.zeros(n))

    def put(self, lanes: Indices, samples: LightSample) -> None:
        """Overwrites some of the samples."""
        for mine, new in zip(self, samples, strict=True):
            mine[..., lanes] = new


class LightSet(Protocol):
    """All lights of one kind in a scene; `light` (n,) are places among them.

    Which scattered rays find a light depends on the kind. None finds one that is `delta`; a ray that hits nothing finds
    those that are `infinite`, which are `InfiniteLightSet`s; area lights are found as surfaces (`AreaLights`).
    """

    delta: bool = True
    """Whether they have no size: then they are always sampled, and never weighted."""
    infinite: bool = False
    """Whether rays that hit nothing find them."""

    def __init__(self, lights: Sequence[Any]) -> None:
        """The scene's lights of this kind, in their order."""

    def sample(self, light: Indices, point: Array, normal: Array, u0: Array, u1: Array, uc: Array) -> LightSample:
        """One sample of each light from points with shading normals (3, n), 0 in media, by three draws (n,) each."""
        ...


class InfiniteLightSet(LightSet, Protocol):
    """Lights at infinity; here `light` is one of them."""

    def Li(self, light: int, direction: Array) -> Array:
        """(3, n) radiance from unit directions."""
        ...

    def pdf(self, light: int, direction: Array, normal: Array) -> Array:
        """(n,) per solid angle, with which `sample` finds the directions from points with these normals, 0 in media."""
        ...
