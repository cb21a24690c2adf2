"""The renderer: a scene loaded into Mitsuba, and passes over its image by one variant or the other."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.concurrency import CallGuard
from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Hits, OnPass, Settings
from engines.peers.mitsuba import plugins, rays
from engines.peers.mitsuba.description import scene_lacks
from engines.peers.mitsuba.library import LLVM, active
from engines.peers.mitsuba.scalar import Passes, renders_images
from engines.peers.mitsuba.stage import Stage, staged
from engines.peers.mitsuba.wavefront import Wavefront
from engines.scene import Camera, Scene, Shape


class Renderer:
    """One scene with one set of resolved settings."""

    def __init__(self, scene: Scene, settings: Settings, variant: str) -> None:
        self._scene, self._variant = scene, variant
        self.settings = settings
        self.film = Film(*settings.size(scene))
        self._stop = threading.Event()
        self._compile_seconds = 0.0
        self._guard = CallGuard()  # Dr.Jit's threads do not survive a fork
        self._build(scene)

    def _build(self, scene: Scene) -> None:
        begin = perf_counter()
        with self._active():
            stage = staged(scene, self.settings, self._variant)
            waves = self._variant == LLVM and not self._renders_images(stage)
            self._passes = Wavefront(stage) if waves else Passes(stage)
        self._scene, self._stage = scene, stage
        self._build_seconds = perf_counter() - begin

    def _renders_images(self, stage: Stage) -> bool:
        shader = self.settings.shader
        return shader.name == "mitsuba" and renders_images(stage.mi, stage.mi.load_dict(plugins.node(shader.options)))

    def warm_up(self) -> None:
        """Records the kernel of `render` and compiles it, or finds it in Dr.Jit's cache."""
        with self._guard.rendering("warm_up"), self._active():
            begin = perf_counter()
            self._passes.compile()
            self._compile_seconds += perf_counter() - begin if self._variant == LLVM else 0.0

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples per pixel; see `engines.interface.Renderer`. Without `on_pass` a pass may take half a second."""
        with self._guard.rendering():
            self._stop.clear()
            target = self._passes.done + spp
            while self._passes.done < target:
                with self._active():  # rays that other threads trace come between passes
                    samples = self._passes.step(target - self._passes.done, on_pass is not None)
                    whole = self._passes.render(samples)
                if on_pass is not None and whole:
                    self._fill()
                    on_pass(self.film)
                if self._stop.is_set():
                    break
            self._fill()
            return self.film

    def _fill(self) -> None:
        with self._active():
            self._passes.fill(self.film)

    def stop(self) -> None:
        """Ends a running `render` after its pass, which in the scalar variant is cut short and dropped."""
        self._stop.set()
        self._passes.cancel()

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Takes another camera or other shapes: loads the scene anew, and restarts the film."""
        self._require_described("its camera and shapes are those of the file")
        scene = self._scene if camera is None else replace(self._scene, camera=camera)
        scene = scene if shapes is None else replace(scene, shapes=tuple(shapes))
        if lacks := scene_lacks(scene):
            raise Unsupported(lacks)
        with self._guard.updating():
            size = self.settings.size(scene)
            film = self.film if size == (self.film.width, self.film.height) else Film(*size)  # first: it may be refused
            self._build(scene)
            self.film = film
            self.film.clear()

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits; see `engines.interface.Renderer`."""
        self._require_described("single rays are not traced")
        asked = rays.rays_of(origins, directions, t_max)
        with self._guard.tracing(), self._active():
            return rays.trace(self._stage, asked)

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether anything lies in (0, t_max); see `engines.interface.Renderer`."""
        self._require_described("single rays are not traced")
        asked = rays.rays_of(origins, directions, t_max)
        with self._guard.tracing(), self._active():
            return rays.occluded(self._stage, asked)

    def _require_described(self, otherwise: str) -> None:
        if self._scene.native is not None:
            raise Unsupported(f"Mitsuba takes {self._scene.source} as it is: {otherwise}")

    def counters(self) -> Mapping[str, float]:
        """No `rays`, since Mitsuba counts none; nor does it tell the size of its trees."""
        return {
            "build_seconds": self._build_seconds,
            "compile_seconds": self._compile_seconds,
            "accelerator_bytes": 0,
            "bad_samples": self.film.bad_samples,
        }

    def _active(self) -> AbstractContextManager[None]:
        return active(self._variant, self.settings.threads)
