"""The renderer: a scene loaded into Mitsuba, and passes over its image by one variant or the other."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Hits, OnPass, Settings
from engines.mitsuba import rays
from engines.mitsuba.description import camera_lacks
from engines.mitsuba.library import LLVM, activate
from engines.mitsuba.scalar import Passes
from engines.mitsuba.stage import staged
from engines.mitsuba.wavefront import Wavefront
from engines.scene.model import Camera, Scene, Shape


class Renderer:
    """One scene with one set of resolved settings."""

    def __init__(self, scene: Scene, settings: Settings, variant: str) -> None:
        self._scene, self._variant = scene, variant
        self.settings = settings
        self.film = Film(*settings.size(scene))
        self._stop = threading.Event()
        self._rays, self._compile_seconds = 0, 0.0
        self._build()

    def _build(self) -> None:
        begin = perf_counter()
        self._stage = staged(self._scene, self.settings, self._variant)
        self._passes = Wavefront(self._stage) if self._variant == LLVM else Passes(self._stage)
        self._build_seconds = perf_counter() - begin

    def warm_up(self) -> None:
        """Records the kernel of `render` and compiles it, or finds it in Dr.Jit's cache."""
        self._activate()
        begin = perf_counter()
        self._passes.compile()
        self._compile_seconds += perf_counter() - begin if self._variant == LLVM else 0.0

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples a pixel; see `engines.interface.Renderer`. Without `on_pass` a pass may take half a second."""
        self._stop.clear()
        self._activate()
        target = self._passes.done + spp
        while self._passes.done < target:
            first = self._passes.done
            whole = self._passes.render(min(1 if on_pass else self._passes.step(), target - first))
            self._rays += (self._passes.done - first) * self.film.width * self.film.height
            if on_pass is not None and whole:
                self._passes.fill(self.film)
                on_pass(self.film)
                self._activate()
            if self._stop.is_set():
                break
        self._passes.fill(self.film)
        return self.film

    def stop(self) -> None:
        """Ends a running `render` after its pass, which in the scalar variant is cut short and dropped."""
        self._stop.set()
        if isinstance(self._passes, Passes):
            self._passes.cancel()

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Takes another camera or other shapes: loads the scene anew, and restarts the film."""
        if camera is not None:
            if lacks := camera_lacks(camera):
                raise Unsupported(f"Mitsuba has no counterpart of {lacks}")
            self._scene = replace(self._scene, camera=camera)
        if shapes is not None:
            self._scene = replace(self._scene, shapes=tuple(shapes))
        self._build()
        size = self.settings.size(self._scene)
        if size == (self.film.width, self.film.height):
            self.film.clear()
        else:
            self.film = Film(*size)

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits; see `engines.interface.Renderer`."""
        self._activate()
        asked = rays.rays_of(origins, directions, t_max)
        self._rays += asked.n
        return rays.trace(self._stage, asked)

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether anything lies in (0, t_max); see `engines.interface.Renderer`."""
        self._activate()
        asked = rays.rays_of(origins, directions, t_max)
        self._rays += asked.n
        return rays.occluded(self._stage, asked)

    def counters(self) -> Mapping[str, float]:
        """`rays` are those from the camera and those asked for: Mitsuba counts none, and tells no size of its trees."""
        return {
            "rays": self._rays,
            "build_seconds": self._build_seconds,
            "compile_seconds": self._compile_seconds,
            "accelerator_bytes": 0,
            "bad_samples": self.film.bad_samples,
        }

    def _activate(self) -> None:
        activate(self._variant, self.settings.threads)


def renderer(scene: Scene, settings: Settings, variant: str) -> Renderer:
    """A renderer of settings that `Engine.prepare` has resolved."""
    return Renderer(scene, settings, variant)
