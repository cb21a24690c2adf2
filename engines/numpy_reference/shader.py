"""From the choice of a shader to its function; and shaders that users bring.

A shader plugin is an object with a `name`, perhaps `options`, and a function
`numpy(context, origins, directions, pixels, sample)` that returns the radiance (n, 3) along n rays: origins and unit
directions (n, 3), indices of their pixels (n,), and the number of the sample. `context` is a `PluginContext`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import Choice
from engines.numpy_reference import albedo, depth_map, path_tracer, volumetric_path_tracer, whitted
from engines.numpy_reference.context import Context
from engines.numpy_reference.vectors import Array

Radiance = Callable[[Context, Array, Array, NDArray[np.int64], int], Array]

_BUILT_IN: dict[str, Radiance] = {
    "no_shadows": whitted.Li_without_shadows,
    "whitted": whitted.Li,
    "path_tracer": path_tracer.Li,
    "volumetric_path_tracer": volumetric_path_tracer.Li,
    "depth_map": depth_map.Li,
    "albedo": albedo.Li,
}


def shader_function(choice: Choice) -> Radiance:
    """The function of a built-in shader or of a plugin, on vectors (3, n)."""
    if choice.plugin is None:
        return _BUILT_IN[choice.name]

    def radiance(context: Context, origin: Array, direction: Array, pixel: NDArray[np.int64], sample: int) -> Array:
        seen = choice.plugin.numpy(PluginContext(context), _rows(origin), _rows(direction), pixel, sample)
        return np.broadcast_to(np.asarray(seen, np.float64), (pixel.size, 3)).T

    return radiance


class Seen(NamedTuple):
    """What n rays found; where `hit` is false the rest means nothing. Vectors and colours are (n, 3).

    `normal` (shading) and `geometric` are unit and on the side of the viewer. `outside` and `inside` are the origins of
    rays that leave on that side and on the other one. `emission` is 0 on a side that does not emit.
    """

    hit: NDArray[np.bool_]
    t: NDArray[np.float64]
    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    geometric: NDArray[np.float64]
    outside: NDArray[np.float64]
    inside: NDArray[np.float64]
    front: NDArray[np.bool_]
    kd: NDArray[np.float64]
    ks: NDArray[np.float64]
    kt: NDArray[np.float64]
    ior: NDArray[np.float64]
    emission: NDArray[np.float64]


class PluginContext:
    """The scene as shader plugins see it. `options` are the shader's own; `light_count` is the number of lights."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.options: Mapping[str, Any] = context.options
        self.light_count = context.lights.count

    def draw(self, pixels: NDArray[np.integer], sample: int, dimension: int) -> NDArray[np.float64]:
        """(n,) numbers of the sampler in [0, 1). Dimensions 0 and 1 have placed the ray in its pixel."""
        return self._context.draw(pixels, sample, dimension)

    def trace(self, origins: ArrayLike, directions: ArrayLike) -> Seen:
        """What rays (n, 3) with unit directions find."""
        context, origin, direction = self._context, _columns(origins), _columns(directions)
        hits = context.closest(origin, direction)
        arrived = np.flatnonzero(hits.primitive_id >= 0)
        surface = context.surface(origin.take(arrived, axis=1), direction.take(arrived, axis=1), hits.take(arrived))
        table, material = context.materials, surface.material

        def spread(values: NDArray) -> NDArray:
            full = np.zeros((hits.t.size, *values.shape[:-1]), values.dtype)
            full[arrived] = values.T
            return full

        colours = [spread(colour.take(material, axis=1)) for colour in (table.kd, table.ks, table.kt)]
        return Seen(
            hits.primitive_id >= 0,
            hits.t,
            spread(surface.point),
            spread(surface.normal),
            spread(surface.geometric),
            spread(surface.leave()),
            spread(surface.leave(inwards=True)),
            spread(surface.front),
            *colours,
            spread(table.ior[material]),
            spread(table.emitted(surface)),
        )

    def occluded(self, origins: ArrayLike, directions: ArrayLike, distances: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """(n,) whether anything lies on the way to lights at these distances, but for the last ulps of the way.

        Sample lights from the origins of the shadow rays, `Seen.outside`: they are not quite the points of the surface.
        """
        origin = _columns(origins)
        distance = np.broadcast_to(np.asarray(distances, np.float64), origin.shape[1])
        offset = self._context.tracer.offset
        distance = distance * (1.0 - offset) - offset * np.abs(origin).max(axis=0)
        self._context.rays += distance.size
        return self._context.tracer.occluded(origin, _columns(directions), distance, self._context.check)

    def sample_light(
        self, light: int, points: ArrayLike, normals: ArrayLike, u0: Array, u1: Array, uc: Array
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """One sample of light number `light` from points with shading normals (n, 3): unit direction (n, 3), distance
        (n,), radiance over pdf (n, 3), 0 for no sample, and pdf per solid angle (n,), inf for lights without size."""
        point = _columns(points)
        chosen = np.full(point.shape[1], light)
        found = self._context.lights.sample(chosen, point, _columns(normals), u0, u1, uc)
        return _rows(found.wi), found.distance, _rows(found.weight), found.pdf

    def sky(self, directions: ArrayLike) -> NDArray[np.float64]:
        """(n, 3) radiance of all environments from unit directions (n, 3)."""
        return _rows(self._context.environment(_columns(directions)))


def _columns(vectors: ArrayLike) -> Array:
    return np.ascontiguousarray(np.asarray(vectors, np.float64).T)


def _rows(vectors: Array) -> NDArray[np.float64]:
    return np.ascontiguousarray(vectors.T)
