"""What a shader has to work with: the scene's arrays, closest hits and shadows, lights, and random numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.accelerators.tracer import Tracer
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.guiding import GuidedScattering
from engines.numpy_reference.interaction import SurfaceInteraction, surface_interaction
from engines.numpy_reference.light_samplers import light_sampler
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.media import VACUUM, Media, MediumInteraction
from engines.numpy_reference.sampler import Sampler
from engines.numpy_reference.scene_lights import Lights
from engines.numpy_reference.vectors import Array, Indices, Mask, dot, norm
from engines.scene import Scene
from engines.scene.light_hierarchy import lit_through

MOST_NULL_LOBES = 1024
"""Null lobes that a path or a shadow ray crosses at most: rounding must not hold a ray for ever."""
Vertex = SurfaceInteraction | MediumInteraction
"""Where n paths are scattered: on surfaces, or in media."""


class Stopped(Exception):
    """Raised inside a pass when `stop` was called; the pass is dropped."""


class Context:
    """A scene, ready to be shaded. `options` are the shader's; `rays` counts closest hits and shadows asked for.

    `check` is called every few milliseconds and may raise `Stopped`.
    """

    def __init__(self, scene: Scene, geometry: Geometry, tracer: Tracer, shader: Choice, sampler: Sampler) -> None:
        self.geometry = geometry
        self.materials = Materials(scene.materials, geometry)
        self.lights = Lights(scene.lights, geometry, self.materials)
        self.light_sampler = light_sampler(scene, shader, self.lights.count)
        volumetric = shader.plugin is None and shader.name == "volumetric_path_tracer"
        self.media = Media(scene.media if volumetric else (), scene.shapes, geometry)
        """The media, of which shaders that do not render them see none."""
        self.camera_medium = VACUUM
        freely = volumetric or (shader.plugin is None and shader.options.get("transparent_shadows", False))
        self.crosses_freely = freely and self.materials.null_lobes
        """Whether null lobes are no vertices."""
        guided = shader.plugin is None and shader.options.get("guiding", "none") == "sd_tree"
        self.guide = GuidedScattering(self.materials, scene, shader) if guided else None
        """What samples directions in place of the materials alone, where paths are guided."""
        self.lit_through = lit_through(scene)
        """Whether some surface may be lit from behind."""
        self.tracer = tracer
        self.options: Mapping[str, Any] = shader.options
        self.rays = 0
        self.check: Callable[[], None] = _go_on
        self.camera_rays: tuple[Array, Array, Array] | None = None
        """Origins and directions (3, n) of the camera's rays, and the distances (n,) at which it clips them, where it does."""
        self._sampler = sampler

    def draw(self, pixels: NDArray[np.integer], sample: int, dimension: int) -> Array:
        """(n,) numbers in [0, 1): one for each pixel index."""
        return self._sampler.draw(pixels, sample, dimension)

    def closest(self, origin: Array, direction: Array, origin_primitive: Indices | None = None) -> Nearest:
        """Closest hits of rays (3, n) with unit directions: t (inf for a miss) and primitive id (-1 for a miss). The camera's
        own rays end where it clips. `origin_primitive` (n,) are the ids of the primitives that the rays start from, -1 for
        none."""
        self.rays += origin.shape[1]
        t_max = np.full(origin.shape[1], np.inf)
        if self.camera_rays is not None:
            starts, directions, ends = self.camera_rays
            if np.array_equal(origin, starts) and np.array_equal(direction, directions):
                t_max = ends
        return self.tracer.closest(origin, direction, t_max, self.check, origin_primitive)

    def surface(self, origin: Array, direction: Array, hits: Nearest) -> SurfaceInteraction:
        """What lies where rays (3, n), all of which hit, have hit."""
        return surface_interaction(self.geometry, origin, direction, hits, self.tracer.offset, self.materials.placed)

    def unoccluded(self, surface: Vertex, direction: Array, distance: Array) -> Mask:
        """(n,) whether nothing lies between vertices and points of lights, `distance` (inf too) away from them.

        The ray starts off the surface, on the side of the light, and is aimed anew from there: parallel to the old
        direction it would meet a light that is seen from the side much earlier than it ends.
        """
        self.rays += direction.shape[1]
        ray = self._shadow_ray(surface, direction, distance)
        return ~self.tracer.occluded(*ray, self.check, surface.primitive_id)

    def transmittance(self, surface: Vertex, direction: Array, distance: Array, medium: Indices) -> Array:
        """(3, n) the share of light that null lobes and media let pass on the same way: 0 where anything else lies on it.
        Paths arrive at the vertices in `medium` (n,)."""
        share, lanes = np.ones(direction.shape), np.arange(direction.shape[1])
        with np.errstate(invalid="ignore"):
            target = surface.point + distance * direction
        for _ in range(MOST_NULL_LOBES):
            self.rays += lanes.size
            medium = self.media.beyond(surface, direction, medium)
            origin, aim, t_max = self._shadow_ray(surface, direction, distance)
            hits = self.tracer.closest(origin, aim, t_max, self.check, surface.primitive_id)
            met = np.flatnonzero(hits.primitive_id >= 0)
            if self.media.any:
                lead = surface.offset * np.abs(dot(surface.geometric, aim))
                way = np.where(hits.primitive_id >= 0, hits.t + lead, distance)
                share[:, lanes] *= self.media.transmittance(medium, way)
            surface = self.surface(origin.take(met, axis=1), aim.take(met, axis=1), hits.take(met))
            passed = self.materials.transmittance(surface)
            share[:, lanes[met]] *= passed
            on = np.flatnonzero((passed > 0.0).any(axis=0))
            lanes, medium, surface = lanes[met[on]], medium[met[on]], surface.take(on)
            if not lanes.size:
                return share
            # from there to the same place
            endless = np.isinf(distance[met[on]])
            with np.errstate(invalid="ignore"):
                way = target.take(lanes, axis=1) - surface.point
                length = norm(way)
                direction = np.where(endless, aim.take(met[on], axis=1), way / length)
            distance = np.where(endless, np.inf, length)
        share[:, lanes] = 0.0
        return share

    def _shadow_ray(self, surface: Vertex, direction: Array, distance: Array) -> tuple[Array, Array, Array]:
        """Origin, direction (3, n) and length (n,) of the ray to the place that lies so far away."""
        side = np.where(dot(surface.geometric, direction) < 0.0, -surface.offset, surface.offset)
        with np.errstate(invalid="ignore"):
            aim = distance * direction - side * surface.geometric
            length = norm(aim)
            aim = np.where(np.isinf(distance), direction, aim / length)
        t_max = length * (1.0 - self.tracer.offset) - surface.offset
        return surface.spawn(direction), aim, np.where(np.isinf(distance), np.inf, t_max)

    def environment(self, direction: Array) -> Array:
        """(3, n) radiance of all lights at infinity together from unit directions."""
        total = np.zeros(direction.shape)
        for light in self.lights.infinite:
            total += light.Li(direction)
        return total


def _go_on() -> None:
    pass
