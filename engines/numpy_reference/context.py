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
from engines.numpy_reference.interaction import SurfaceInteraction, surface_interaction
from engines.numpy_reference.light_samplers import light_sampler
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.sampler import Sampler
from engines.numpy_reference.scene_lights import Lights
from engines.numpy_reference.vectors import Array, Indices, Mask, dot, norm
from engines.scene import Scene
from engines.scene.light_hierarchy import lit_through


class Stopped(Exception):
    """Raised inside a pass when `stop` was called; the pass is dropped."""


class Context:
    """A scene, ready to be shaded. `options` are the shader's; `rays` counts closest hits and shadows asked for.

    `check` is called every few milliseconds and may raise `Stopped`.
    """

    def __init__(self, scene: Scene, geometry: Geometry, tracer: Tracer, shader: Choice, sampler: Sampler) -> None:
        self.geometry = geometry
        self.materials = Materials(scene.materials)
        self.lights = Lights(scene.lights, geometry, self.materials)
        self.light_sampler = light_sampler(scene, shader, self.lights.count)
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

    def unoccluded(self, surface: SurfaceInteraction, direction: Array, distance: Array) -> Mask:
        """(n,) whether nothing lies between points of a surface and of lights, `distance` (inf too) away from them.

        The ray starts off the surface, on the side of the light, and is aimed anew from there: parallel to the old
        direction it would meet a light that is seen from the side much earlier than it ends.
        """
        self.rays += direction.shape[1]
        origin = surface.spawn(direction)
        side = np.where(dot(surface.geometric, direction) < 0.0, -surface.offset, surface.offset)
        with np.errstate(invalid="ignore"):
            aim = distance * direction - side * surface.geometric
            length = norm(aim)
            aim = np.where(np.isinf(distance), direction, aim / length)
        t_max = length * (1.0 - self.tracer.offset) - surface.offset
        t_max = np.where(np.isinf(distance), np.inf, t_max)
        return ~self.tracer.occluded(origin, aim, t_max, self.check, surface.primitive_id)

    def environment(self, direction: Array) -> Array:
        """(3, n) radiance of all lights at infinity together from unit directions."""
        total = np.zeros(direction.shape)
        for light in self.lights.infinite:
            total += light.Li(direction)
        return total


def _go_on() -> None:
    pass
