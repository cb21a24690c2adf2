"""What a kind of shape can do: the verbs that accelerators, interactions and area lights call.

A new kind is a module with a class that inherits `Primitives`, and a table: `SHAPES = {Plane: Planes}`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.vectors import Array, Indices, Mask


class Primitives(Protocol):
    """All primitives of one kind in a scene, m of them. In the verbs `index` (n,) are places among them, one a ray.

    Verbs with a body here are inherited by the kinds that do not differ.
    """

    primitive_id: Indices
    """(m,) ascending: the place of each in the scene's order of all primitives."""
    data: Array
    """(copies, k, m): what `distance` wants of each, once for each way to test it."""
    area: Array
    """(m,) square metres, inf for what has no bounds."""
    planar: bool
    """Whether a ray that leaves one cannot meet it again."""
    bounded: bool
    """Whether each lies in a box. What does not enters no tree and is no light."""
    separate_lights: bool
    """Whether each primitive of an emitting shape is a light of its own; else all of them make one."""

    def __init__(self, shapes: Sequence[Any], primitive_id: Indices) -> None:
        """The primitives of the scene's shapes of this kind. Those that can never be hit may be left out."""

    @staticmethod
    def count(shape: Any) -> int:
        """How many primitives a shape of the scene is made of."""
        return 1

    @staticmethod
    def rays(origin: Array, direction: Array) -> tuple[Indices, Array]:
        """Which of the copies in `data` serves each ray (n,), and what `distance` wants of it (k, n): where there is one
        copy, origin and direction."""
        return np.zeros(origin.shape[1], np.int64), np.concatenate([origin, direction])

    def distance(self, primitive: Any, ray: Any, /) -> Array:
        """t > 0 of the hit, inf for a miss; the arguments broadcast after their first axis."""
        ...

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """The shape around points (3, n) where rays (3, n) have hit it."""
        ...

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """The texture coordinates of points (3, n) where rays (3, n) have hit the shape."""
        ...

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corners of the boxes, (3, m) each."""
        ...

    def corners(self) -> Array:
        """(3, k) points whose box is the box of all the shapes, faces without area included; k = 0 where there is none."""
        return np.concatenate(self.bounds(), axis=1)

    def sample(self, index: Indices, point: Array, u0: Array, u1: Array, area: Array) -> ShapeSample:
        """Points of the shape as seen from `point` (3, n), by two draws. `area` (n,) is that of the whole light which
        the primitive is part of, and in which it was chosen in proportion to its own."""
        ...

    def pdf(self, index: Indices, point: Array, distance: Array, cosine: Array, area: Array) -> Array:
        """(n,) per solid angle, with which `sample` finds what lies at this distance under this cosine at the shape."""
        return pdf_solid_angle(distance, cosine, area)


class LocalGeometry(NamedTuple):
    """A shape around n of its points."""

    outward: Array
    """(3, n) unit geometric normal, on the front."""
    shading_normal: Array
    """(3, n) unit; where nothing is interpolated, `outward`."""
    dp_du: Array
    """(3, n) derivative of the point by the shape's first coordinate, of any length; 0 where there is none."""
    radius: Array | float
    """(n,) metres, of round shapes: rounding errors of the point grow with it, and not with its coordinates alone."""


class TextureCoordinates(NamedTuple):
    """(u, v) of n points of a shape, and the derivatives of the point by them."""

    uv: Array
    """(2, n)"""
    dp_du: Array
    """(3, n)"""
    dp_dv: Array
    """(3, n)"""
    attributes: Mapping[str, Array] = {}
    """(3, n) each, of meshes, by name; of no meaning where a shape has none."""


class ShapeSample(NamedTuple):
    """n points on shapes, seen from n others."""

    wi: Array
    """(3, n) unit, towards the shape."""
    distance: Array
    """(n,) metres."""
    front: Mask
    """(n,) whether the front is seen."""
    pdf: Array
    """(n,) per solid angle."""


def pdf_solid_angle(distance: Array, cosine: Array, area: Array) -> Array:
    """(n,) the density per solid angle of points that are uniform over an area, under this cosine at the shape."""
    return distance * distance / (np.abs(cosine) * area)


def turn(y: Array, x: Array) -> Array:
    """(n,) angles from the x axis to the y axis, in [0, 2 pi)."""
    phi = np.arctan2(y, x)
    return np.where(phi < 0.0, phi + 2.0 * np.pi, phi)
