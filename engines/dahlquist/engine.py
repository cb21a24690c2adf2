"""The port as an engine that can race: it renders five balls as `physical.scene` describes them, and nothing else.

A sample is a frame, drawn anew with its background. The film gets the frame's bytes over 255; where another engine sees
the sky, the port shows its background.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from engines.concurrency import CallGuard
from engines.dahlquist import area_hierarchy, physical
from engines.dahlquist.animation import COLOURS, RADII, REAL, Reals
from engines.dahlquist.frame import SPHERE, Pictures, View
from engines.dahlquist.pictures import formula_background, smooth_probe
from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Hits, OnPass, Settings
from engines.scene import Camera, Perspective, Scene, Shape, Sphere
from engines.scene.support import plugins


class Engine:
    """N. Dahlquist's ray tracer, compiled. Its own rules hold, whatever shader and sampler are asked for."""

    name = "dahlquist"
    version = "1"

    def accelerators(self) -> Mapping[str, Mapping[str, Any]]:
        return {"auto": {}, "area_hierarchy": {}, "none": {}}

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        """None for the five balls, wherever they are, in a square image. Raises `UnknownName` and `ConfigError`."""
        settings.resolved(self.accelerators(), None)
        width, height = settings.size(scene)
        camera = scene.camera
        view = physical.field_of_view()
        fits = (
            isinstance(camera, Perspective)
            and width == height
            and abs(camera.fov - view) < 1e-4
            and (camera.eye, camera.target[:2]) == ((0.0, 0.0, 0.0), (0.0, 0.0))
            and camera.target[2] < 0
            and (camera.principal_point, camera.mirror, camera.clip) == ((0.0, 0.0), False, (0.0, math.inf))
        )
        fits = fits and _are_the_balls(scene) and not plugins(scene)
        return None if fits else "the engine dahlquist renders its own five balls alone"

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        lacking = self.why_not(scene, settings)
        if lacking:
            raise Unsupported(lacking)
        return Renderer(scene, settings)


def _are_the_balls(scene: Scene) -> bool:
    balls = [shape for shape in scene.shapes if isinstance(shape, Sphere)]
    if len(balls) != len(RADII) or len(balls) != len(scene.shapes):
        return False
    radii = [ball.radius * physical.UNITS_A_METRE for ball in balls]
    colours = [np.multiply(scene.materials[ball.material].kd, 255 * physical.FAINTNESS) for ball in balls]
    return np.allclose(radii, RADII, rtol=1e-4) and np.allclose(colours, COLOURS, atol=0.5)


class Renderer:
    """Draws one frame a sample; what is drawn does not depend on the seed."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        from engines.dahlquist.numba_frame import Painter

        width, height = settings.size(scene)
        self.film = Film(width, height)
        self._frame = np.zeros((height, width, 4), np.uint8)
        self._painter = Painter(width, height, Pictures(smooth_probe(), formula_background()), settings.threads)
        chosen = settings.accelerator
        name = chosen if isinstance(chosen, str) else getattr(chosen, "name", None) or chosen["name"]
        self._exact = name == "none"
        self._centres = _centres(scene.shapes)
        self._stopped = False
        self._guard = CallGuard()

    def warm_up(self) -> None:
        with self._guard.rendering("warm_up"):
            self._draw()

    def _draw(self) -> None:
        boxes = area_hierarchy.boxes(self._centres)
        if self._exact:
            boxes = np.tile(area_hierarchy.EVERYWHERE, (len(RADII), 1))
        self._frame.view("<u4")[:] = SPHERE << 24
        self._painter.draw(self._frame, View(self._centres, boxes, True, True, 0, 1))

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Draws `spp` frames; the film takes those of a pass at once."""
        with self._guard.rendering():
            self._stopped, left = False, spp
            while left > 0 and not self._stopped:
                step = 1 if on_pass else left
                for _ in range(step):
                    self._draw()
                self._add(step)
                left -= step
                if on_pass:
                    on_pass(self.film)
            return self.film

    def _add(self, frames: int) -> None:
        radiance = self._frame[:, :, :3] / 255.0
        even = (frames + (self.film.spp % 2 == 0)) // 2
        self.film.sums += frames * radiance
        self.film.squares += frames * radiance**2
        self.film.even_sums += even * radiance
        self.film.counts += frames

    def stop(self) -> None:
        self._stopped = True

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Moves the balls. The camera stays where it is."""
        if camera is not None:
            raise Unsupported("the engine dahlquist has no camera that could move")
        with self._guard.updating():
            if shapes is not None:
                self._centres = _centres(shapes)
            self.film.clear()

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        raise Unsupported("the engine dahlquist draws frames alone: it answers no single rays")

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Any:
        raise Unsupported("the engine dahlquist draws frames alone: it answers no single rays")

    def counters(self) -> dict[str, float]:
        """No `rays`: those that balls reflect are not counted."""
        return {"build_seconds": 0.0, "compile_seconds": 0.0, "accelerator_bytes": 0, "bad_samples": 0}


def _centres(shapes: Sequence[Shape]) -> Reals:
    return physical.from_world([shape.center for shape in shapes if isinstance(shape, Sphere)]).astype(REAL)
