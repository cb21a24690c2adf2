"""A scene on stage: one renderer for the image, and a small one beside it that answers while the camera moves.

The small renderer has a quarter of the image's width and height. It also traces the rays of a pointer, so that nobody has
to wait for the large one, which may be rendering.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from engines.errors import Unsupported
from engines.interface import Engine, Renderer, Settings
from engines.scene import Camera, CustomCamera, Orthographic, Scene
from harness.measure import clock as measure
from harness.view.movable import Movable, center, movables, moved
from harness.view.pixels import Lens, Vector

COARSE = 4
"""The large image's sides are this many times the small one's."""


class Stage:
    """Prepares both renderers; `tell(doing)` is called before each step that takes time. Raises `RaybenchError`."""

    def __init__(self, scene: Scene, engine: Engine, settings: Settings, tell: Callable[[str], None]) -> None:
        self.width, self.height = settings.size(scene)
        self.scene, self._engine, self._settings, self._tell = scene, engine, settings, tell
        self.offsets: dict[str, Vector] = {}
        self.build_seconds = self.compile_seconds = 0.0
        self._stale: set[str] = set()
        self.small = self._prepared(max(1, self.width // COARSE), max(1, self.height // COARSE))
        self.large: Renderer | None = None

    def _prepared(self, width: int, height: int) -> Renderer:
        self._tell("building and compiling")
        settings = replace(self._settings, width=width, height=height)
        renderer, build, compilation = measure.prepare(self._engine, self.scene, settings)
        self.build_seconds, self.compile_seconds = build, self.compile_seconds + compilation
        return renderer

    # ---- changes -----------------------------------------------------------------------------------------------------

    def look(self, camera: Camera) -> None:
        """Changes the camera of the small renderer; the large one follows in `settle`."""
        Lens(camera, self.width, self.height)
        self.scene = replace(self.scene, camera=camera)
        self._stale.add("camera")
        self.small.update(camera=camera)

    def drag(self, name: str, x: float, y: float) -> None:
        """Puts the middle of a thing under a pixel, in the plane through it that faces the camera."""
        movable = self.movable(name)
        before = center(self.scene, movable)
        offset = self.lens.beside(before, x, y) - before
        if not np.isfinite(offset).all() or np.abs(offset).max() > 1e7:
            return
        self.scene = moved(self.scene, movable, offset)
        self.offsets[name] = self.offsets.get(name, np.zeros(3)) + offset
        if movable.is_shape:
            self._stale.add("shapes")
            self.small.update(shapes=self.scene.shapes)
        else:  # lights are no part of `update`
            self._stale.add("lights")
            self.small = self._prepared(max(1, self.width // COARSE), max(1, self.height // COARSE))

    def settle(self) -> Renderer:
        """The large renderer with everything that was changed, its film empty if anything was."""
        if self.large is None or "lights" in self._stale:
            self.large = None  # frees the old one first
            self.large = self._prepared(self.width, self.height)
        elif self._stale:
            self._tell("building")
            camera = self.scene.camera if "camera" in self._stale else None
            self.large.update(camera=camera, shapes=self.scene.shapes if "shapes" in self._stale else None)
            self.build_seconds = float(self.large.counters().get("build_seconds", self.build_seconds))
        self._stale.clear()
        return self.large

    # ---- questions ---------------------------------------------------------------------------------------------------

    @property
    def lens(self) -> Lens:
        return Lens(self.scene.camera, self.width, self.height)

    @property
    def movables(self) -> list[Movable]:
        return movables(self.scene)

    def movable(self, name: str) -> Movable:
        found = next((movable for movable in self.movables if movable.id == name), None)
        if found is None:
            raise Unsupported(f"there is nothing called {name!r} that could be dragged")
        return found

    def under(self, x: float, y: float) -> tuple[Movable, float, float] | None:
        """The thing at a pixel, and where its middle is; None for what cannot be dragged."""
        origin, direction = self.lens.ray(x, y)
        hit = int(self.small.trace(origin[None], direction[None]).shape[0])
        for movable in self.movables:
            if movable.id == f"shape:{hit}":
                return self._placed(movable)
        return None

    def named(self, name: str) -> tuple[Movable, float, float] | None:
        return self._placed(self.movable(name))

    def _placed(self, movable: Movable) -> tuple[Movable, float, float] | None:
        place = self.lens.place(center(self.scene, movable))
        return None if place is None else (movable, *place)

    def handles(self) -> list[dict[str, Any]]:
        """Where point lights are on the image: they are dragged by a mark."""
        if isinstance(self.scene.camera, CustomCamera):
            return []
        points = [movable for movable in self.movables if movable.kind == "point"]
        placed = [self._placed(movable) for movable in points]
        return [{"id": found[0].id, "x": found[1], "y": found[2]} for found in placed if found]


def camera_told(camera: Camera) -> dict[str, Any] | None:
    """A camera for the page; None for a plugin, which it cannot move."""
    if isinstance(camera, CustomCamera):
        return None
    window = camera.height if isinstance(camera, Orthographic) else None
    fov = None if isinstance(camera, Orthographic) else (camera.fov, camera.fov_axis)
    return {"eye": camera.eye, "target": camera.target, "up": camera.up, "height": window, "fov": fov}
