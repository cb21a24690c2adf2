"""The renderer: one scene with one set of settings; fills the film pass by pass, a chunk of pixels at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import Choice
from engines.concurrency import CallGuard
from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Hits, OnPass, Settings
from engines.light_cells import light_cells
from engines.numpy_reference.accelerators.tracer import Tracer
from engines.numpy_reference.bsdf import BSDFS
from engines.numpy_reference.camera import camera_rays, clipped
from engines.numpy_reference.context import Context, Stopped
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.interaction import barycentric
from engines.numpy_reference.light_samplers import SpatialLightSampler
from engines.numpy_reference.lights import LIGHTS
from engines.numpy_reference.media import VACUUM
from engines.numpy_reference.sampler import Sampler
from engines.numpy_reference.shader import shader_function
from engines.numpy_reference.shapes import SHAPES
from engines.numpy_reference.vectors import Array, Indices, norm
from engines.scene import Camera, HomogeneousMedium, Instance, Scene, Shape, Texture, ThinLens, Wrapper
from engines.scene.support import foreign, plugin_without

CHUNK = 32_768
"""Paths that are followed together: bounds the memory of a pass to some tens of megabytes."""


KNOWN: frozenset[type] = frozenset(
    {*BSDFS, *LIGHTS, *SHAPES, Instance, *get_args(Wrapper), *get_args(Texture), *get_args(Camera), HomogeneousMedium}
)
"""The types of scenes that are rendered."""


def require_numpy(scene: Scene, who: str) -> None:
    """Raises `Unsupported` for what `who` (the subject of the message) does not know, and for plugins without a half for
    NumPy."""
    if lacking := foreign(scene, KNOWN, who):
        raise Unsupported(lacking)
    if lacking := plugin_without(scene, "numpy"):
        raise Unsupported(f"{lacking} has no NumPy function (`numpy`)")


class Renderer:
    """Renders on one thread, whatever `settings.threads` says: NumPy's operations on arrays are serial."""

    def __init__(self, scene: Scene, settings: Settings, tracer: Callable[[Geometry, Choice], Tracer] = Tracer) -> None:
        """`settings` with every choice resolved, as `Engine.prepare` passes them; `tracer` makes what finds the hits."""
        self._scene, self._wanted, self._tracer = scene, settings, tracer
        self._sampler = Sampler(settings.sampler, settings.seed)
        self._shade = shader_function(settings.shader)
        self._stop = threading.Event()
        self._guard = CallGuard(after_fork=self._renew_lock)
        self._renew_lock()
        self._rays_rendered, self._rays_queried = 0, 0
        self._build(scene)
        self._film = Film(*settings.size(scene))

    @property
    def film(self) -> Film:
        """What has been rendered so far."""
        return self._film

    @property
    def settings(self) -> Settings:
        """The settings with every choice and default written out; `auto` shows what it took."""
        return replace(
            self._wanted, accelerator=self._context.tracer.accelerator, width=self._film.width, height=self._film.height
        )

    def warm_up(self) -> None:
        """There is nothing to compile."""
        with self._guard.rendering("warm_up"):
            pass

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples to every pixel; `on_pass(film)` after each. `stop` ends it and keeps whole passes only."""
        with self._guard.rendering():
            self._stop.clear()
            self._learn_lights()
            guide = self._context.guide
            for _ in range(spp):
                if guide is not None:
                    guide.drop()  # what a pass that did not end has left
                try:
                    samples = self._pass(self._film.spp)
                except Stopped:
                    break
                self._film.add(samples)
                if guide is not None:
                    guide.commit(self._film.spp)
                if on_pass is not None:
                    on_pass(self._film)
                if self._stop.is_set():
                    break
            return self._film

    def stop(self) -> None:
        """Makes a running `render` return soon, from any thread; without one it does nothing."""
        self._stop.set()

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Takes another camera or other shapes, and restarts the film."""
        with self._guard.updating():
            scene = replace(
                self._scene, camera=camera or self._scene.camera, shapes=self._scene.shapes if shapes is None else tuple(shapes)
            )
            require_numpy(scene, "this engine")
            width, height = self._wanted.size(scene)
            same_size = (width, height) == (self._film.width, self._film.height)
            film = self._film if same_size else Film(width, height)  # first: it may be refused
            if shapes is not None:
                rendered = self._context.rays
                self._build(scene)
                self._rays_rendered += rendered
            self._scene, self._film = scene, film
            self._film.clear()
            if self._context.guide is not None:
                self._context.guide.restart()

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits in (0, t_max) of rays (n, 3), (n, 3). Rays that are not finite, or zero, miss."""
        good, origin, direction, length, far, n = _rays(origins, directions, t_max)
        with self._guard.tracing():
            geometry = self._context.geometry
            nearest = self._context.tracer.closest(origin, direction, far, _go_on)
        self._count(good.size)
        found = np.flatnonzero(nearest.primitive_id >= 0)
        lanes, nearest, rays = (good[found], nearest.take(found), (origin.take(found, axis=1), direction.take(found, axis=1)))
        primitive_id = nearest.primitive_id
        hits = Hits(np.full(n, np.inf), np.full(n, -1), np.full(n, -1), np.zeros((n, 3)), np.zeros(n), np.zeros(n))
        hits.t[lanes] = nearest.t / length[found]
        hits.shape[lanes], hits.primitive[lanes] = geometry.place(primitive_id)
        hits.normal[lanes] = self._context.surface(*rays, nearest).geometric.T
        hits.u[lanes], hits.v[lanes] = barycentric(geometry, *rays, primitive_id)
        return hits

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """(n,) bool: whether anything lies in (0, t_max). Rays that are not finite, or zero, are free."""
        good, origin, direction, _, far, n = _rays(origins, directions, t_max)
        dark = np.zeros(n, bool)
        with self._guard.tracing():
            dark[good] = self._context.tracer.occluded(origin, direction, far, _go_on)
        self._count(good.size)
        return dark

    def _count(self, rays: int) -> None:
        with self._counting:
            self._rays_queried += rays

    def _renew_lock(self) -> None:
        self._counting = threading.Lock()

    def counters(self) -> Mapping[str, float]:
        """Rays traced, seconds of the last build, memory of the tree, and samples that were not finite."""
        return {
            "rays": self._rays_rendered + self._context.rays + self._rays_queried,
            "build_seconds": self._build_seconds,
            "compile_seconds": 0.0,
            "accelerator_bytes": self._context.tracer.nbytes,
            "bad_samples": self._film.bad_samples,
        }

    def _build(self, scene: Scene) -> None:
        begin = perf_counter()
        geometry = Geometry(scene.shapes)
        tracer = self._tracer(geometry, self._wanted.accelerator)
        context = Context(scene, geometry, tracer, self._wanted.shader, self._sampler)
        context.check = self._check
        self._context, self._build_seconds = context, perf_counter() - begin

    def _learn_lights(self) -> None:
        """Traces the rays by which lights are chosen, before the first sample that depends on them."""
        sampler = self._context.light_sampler
        if isinstance(sampler, SpatialLightSampler) and not sampler.learned:
            self._context.light_sampler = SpatialLightSampler(light_cells(self._scene, self.trace), True)

    def _pass(self, sample: int) -> Array:
        """(pixels, 3): one sample of every pixel."""
        pixels = self._film.width * self._film.height
        samples = np.empty((pixels, 3))
        for first in range(0, pixels, CHUNK):
            self._check()
            pixel = np.arange(first, min(first + CHUNK, pixels))
            samples[pixel] = self._shade(self._context, *self._camera_rays(pixel, sample), pixel, sample).T
        return samples

    def _camera_rays(self, pixel: Indices, sample: int) -> tuple[Array, Array]:
        width, height, camera = self._film.width, self._film.height, self._scene.camera
        px = pixel % width + self._context.draw(pixel, sample, 0)
        py = pixel // width + self._context.draw(pixel, sample, 1)
        lens = None
        if isinstance(camera, ThinLens):
            lens = self._context.draw(pixel, sample, 9), self._context.draw(pixel, sample, 17)
        origin, direction = camera_rays(camera, px, py, width, height, lens)
        span = clipped(camera, origin, direction)
        if span is not None:
            origin = span[0]
        medium = getattr(camera, "medium", None)
        self._context.camera_medium = VACUUM if medium is None else medium
        self._context.camera_rays = None if span is None else (origin, direction, span[1])
        return origin, direction

    def _check(self) -> None:
        if self._stop.is_set():
            raise Stopped


def _go_on() -> None:
    pass


def _rays(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> tuple[Indices, Array, Array, Array, Array, int]:
    """Which of n rays can hit (m,), their origins and unit directions (3, m), lengths, t_max in metres (m,); and n."""
    origin, direction = (np.asarray(vectors, np.float64).reshape(-1, 3).T for vectors in (origins, directions))
    n = max(origin.shape[1], direction.shape[1]) if origin.size and direction.size else 0
    origin, direction = np.broadcast_to(origin, (3, n)), np.broadcast_to(direction, (3, n))
    far = np.broadcast_to(np.asarray(t_max, np.float64), (n,))
    scale = np.abs(direction).max(axis=0)
    good = np.flatnonzero(np.isfinite(origin).all(axis=0) & np.isfinite(scale) & (scale > 0.0) & (far > 0.0))
    scaled = direction.take(good, axis=1) / scale[good]
    long = norm(scaled)
    with np.errstate(over="ignore", under="ignore"):
        length = scale[good] * long
        return good, origin.take(good, axis=1), scaled / long, length, far[good] * length, n
