"""An engine in a process of its own, around the NumPy engine, whose shader's depth says how it is to fail. And one whose
renderer is the package `lantern`, of which `environments` installs versions."""

from __future__ import annotations

import os
import signal
import time
from importlib import metadata, util
from typing import Any

import numpy as np

from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Settings
from engines.numpy_reference import Engine as NumPy
from engines.numpy_reference.renderer import Renderer
from engines.scene import Scene
from tests.harness.fake_engines import truth

KILLED, FOREIGN, REPLACED, SLEEPING = 91, 92, 93, 94
"""Depths of the shader that stand for a failure of `render`."""


class ForeignError(Exception):
    """An error that the other process does not know by name."""


class Failing(Renderer):
    depth = 0

    def render(self, spp: int, on_pass: Any = None) -> Film:
        if self.depth == KILLED:
            os.write(2, b"the last words\n")
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.depth == FOREIGN:
            raise ForeignError("two\nlines")
        if self.depth == SLEEPING:
            print("asleep", flush=True)
            time.sleep(600)
        film = super().render(spp, on_pass)
        if self.depth == REPLACED:
            film.sums, film.squares = film.sums.copy(), np.full_like(film.squares, np.nan)
        return film


class Apart(NumPy):
    """The NumPy engine in a process of its own."""

    name = "apart"
    own_process = True
    process = os.getpid()

    @property
    def version(self) -> str:
        return f"1+{os.getpid()}"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = super().prepare(scene, settings)
        renderer.__class__ = Failing
        renderer.depth = dict(getattr(settings.shader, "options", settings.shader))["max_depth"]
        return renderer


class Lantern:
    """Renders the image of `fake_engines`, with the noise that the package says, in the time that it says."""

    name = "lantern"
    packages = ("lantern",)

    @property
    def version(self) -> str:
        return f"4+{metadata.version('lantern')}" if util.find_spec("lantern") else "4+none"

    def accelerators(self) -> dict[str, dict[str, Any]]:
        return {"auto": {}}

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return None if util.find_spec("lantern") else "the package lantern is not installed"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        if reason := self.why_not(scene, settings):
            raise Unsupported(reason)
        return Lit(settings, *settings.size(scene))


class Lit:
    def __init__(self, settings: Settings, width: int, height: int) -> None:
        import lantern  # type: ignore[import-not-found]

        self.lantern, self.film = lantern, Film(width, height)
        self._generator = np.random.default_rng(settings.seed)

    def warm_up(self) -> None: ...

    def render(self, spp: int, on_pass: Any = None) -> Film:
        for _ in range(spp):
            noise = self._generator.normal(0.0, self.lantern.NOISE, self.film.sums.shape)
            self.film.add(self.lantern.RADIANCE * truth(self.film.width, self.film.height) + noise)
            time.sleep(self.lantern.SECONDS)
        return self.film

    def stop(self) -> None: ...

    def counters(self) -> dict[str, float]:
        return dict.fromkeys(("build_seconds", "compile_seconds", "accelerator_bytes", "bad_samples"), 0.0)


class RaysAlone:
    """Traces rays, with numpy's answers, and renders nothing."""

    name, version = "rays_alone", "1"
    own_process = True

    def accelerators(self) -> dict[str, dict[str, Any]]:
        return {"auto": {}}

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return "it traces rays and renders nothing"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        raise Unsupported(self.why_not(scene, settings))

    def why_not_tracer(self, scene: Scene, settings: Settings) -> str | None:
        return None if scene.shapes else f"nothing is there, says {os.getpid()}"

    def tracer(self, scene: Scene, settings: Settings) -> Any:
        if reason := self.why_not_tracer(scene, settings):
            raise Unsupported(reason)
        return NumPy().prepare(scene, settings)
