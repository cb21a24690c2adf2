"""A scene that is edited while it is rendered, with two renderers: one for the full image and one for previews.

The preview renderer has a quarter of the image's width and height. It renders while the camera moves, and traces the ray
under the pointer, so that picking does not wait for the full renderer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from engines.errors import Unsupported
from engines.interface import Engine, Renderer, Settings
from engines.scene import Camera, CustomCamera, Orthographic, PerspectiveArctan, Scene
from harness.measure import clock
from harness.view.draggable import Draggable, center, draggables, moved
from harness.view.projection import Projection, Vector

PREVIEW_FACTOR = 4
"""Width and height of the full image are this many times those of the preview."""


class InteractiveScene:
    """Prepares the preview renderer. `report(activity)` is called before each slow step. Raises `RaybenchError`."""

    def __init__(self, scene: Scene, engine: Engine, settings: Settings, report: Callable[[str], None]) -> None:
        self.width, self.height = settings.size(scene)
        self.scene, self._engine, self._settings, self._report = scene, engine, settings, report
        self.offsets: dict[str, Vector] = {}
        self.build_seconds = self.compile_seconds = 0.0
        self._changed: set[str] = set()
        self.preview = self._prepared(max(1, self.width // PREVIEW_FACTOR), max(1, self.height // PREVIEW_FACTOR))
        self.full: Renderer | None = None

    def _prepared(self, width: int, height: int) -> Renderer:
        self._report("building and compiling")
        settings = replace(self._settings, width=width, height=height)
        renderer, build, compilation = clock.prepare(self._engine, self.scene, settings)
        self.build_seconds, self.compile_seconds = build, self.compile_seconds + compilation
        return renderer

    # ---- changes -----------------------------------------------------------------------------------------------------

    def set_camera(self, camera: Camera) -> None:
        """Changes the camera of the preview renderer; `update_full_renderer` changes that of the full renderer."""
        Projection(camera, self.width, self.height)
        self.scene = replace(self.scene, camera=camera)
        self._changed.add("camera")
        self.preview.update(camera=camera)

    def drag(self, name: str, x: float, y: float) -> None:
        """Moves the centre of an object under a pixel, in the plane through it that faces the camera."""
        draggable = self.draggable(name)
        before = center(self.scene, draggable)
        offset = self.projection.point_on_view_plane(before, x, y) - before
        if not np.isfinite(offset).all() or np.abs(offset).max() > 1e7:
            return
        self.scene = moved(self.scene, draggable, offset)
        self.offsets[name] = self.offsets.get(name, np.zeros(3)) + offset
        if draggable.is_shape:
            self._changed.add("shapes")
            self.preview.update(shapes=self.scene.shapes)
        else:  # `update` takes no lights
            self._changed.add("lights")
            self.preview = self._prepared(max(1, self.width // PREVIEW_FACTOR), max(1, self.height // PREVIEW_FACTOR))

    def update_full_renderer(self) -> Renderer:
        """The full renderer with all changes; its film is empty if there were any."""
        if self.full is None or "lights" in self._changed:
            self.full = None  # frees the old one before the new one is made
            self.full = self._prepared(self.width, self.height)
        elif self._changed:
            self._report("building")
            camera = self.scene.camera if "camera" in self._changed else None
            self.full.update(camera=camera, shapes=self.scene.shapes if "shapes" in self._changed else None)
            self.build_seconds = float(self.full.counters().get("build_seconds", self.build_seconds))
        self._changed.clear()
        return self.full

    # ---- picking ---------------------------------------------------------------------------------------------------

    @property
    def projection(self) -> Projection:
        return Projection(self.scene.camera, self.width, self.height)

    @property
    def draggables(self) -> list[Draggable]:
        return draggables(self.scene)

    def draggable(self, name: str) -> Draggable:
        found = next((draggable for draggable in self.draggables if draggable.id == name), None)
        if found is None:
            raise Unsupported(f"no object {name!r} can be dragged")
        return found

    def pick(self, x: float, y: float) -> tuple[Draggable, float, float] | None:
        """The object at a pixel, and the pixel position of its centre; None where nothing can be dragged."""
        projection = self.projection
        origin, direction = projection.ray(x, y)
        hit = int(self.preview.trace(origin[None], direction[None], projection.reach(direction)).shape[0])
        for draggable in self.draggables:
            if draggable.id == f"shape:{hit}":
                return self._with_position(draggable)
        return None

    def find(self, name: str) -> tuple[Draggable, float, float] | None:
        return self._with_position(self.draggable(name))

    def _with_position(self, draggable: Draggable) -> tuple[Draggable, float, float] | None:
        place = self.projection.project(center(self.scene, draggable))
        return None if place is None else (draggable, *place)

    def handles(self) -> list[dict[str, Any]]:
        """Ids and pixel positions of the lights that are dragged by handles."""
        if isinstance(self.scene.camera, CustomCamera):
            return []
        points = [draggable for draggable in self.draggables if not draggable.is_shape]
        placed = [self._with_position(draggable) for draggable in points]
        return [{"id": found[0].id, "x": found[1], "y": found[2]} for found in placed if found]


def camera_fields(camera: Camera) -> dict[str, Any] | None:
    """A camera as plain data for the page; None for a plugin, which cannot be moved."""
    if isinstance(camera, CustomCamera):
        return None
    window = camera.window()[1] if isinstance(camera, Orthographic) else None
    fov = None if isinstance(camera, Orthographic) else (camera.fov, camera.fov_axis)
    mirror = not isinstance(camera, PerspectiveArctan) and camera.mirror
    view = {"eye": camera.eye, "target": camera.target, "up": camera.up, "height": window, "fov": fov}
    return {**view, "mirror": mirror}
