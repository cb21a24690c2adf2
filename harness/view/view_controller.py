"""The page with one image that is refined progressively.

Three threads: the reading thread receives requests and interrupts the render, the main thread renders, and the thread of the
publisher (`publisher`) sends frames and the state, and answers requests that do not change the image.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from time import monotonic, perf_counter
from typing import Any

import numpy as np

from engines.choices import SHADERS, Choice
from engines.errors import ConfigError, Unsupported
from engines.interface import Engine, Settings
from engines.registry import engine as engine_of
from engines.registry import names_a_program
from engines.scene import CustomCamera, Orthographic, Scene, load_scene
from harness.measure import clock
from harness.settings import CHOICES, plugin_or_choice, require_imports
from harness.view import requests
from harness.view.controller import Controller
from harness.view.interactive_scene import InteractiveScene, camera_fields
from harness.view.library import Library
from harness.view.menu import menu
from harness.view.publisher import ANSWERED_AT_ONCE, Publisher, ViewState

REST_SECONDS = 0.15
"""The full image starts after this time without a camera move or drag."""
MAX_PIXELS_BESIDE = 1 << 20
"""Images up to this size are prepared while the old one is still held."""
VOLUMETRIC = "volumetric_path_tracer"
CHUNK_SECONDS = 0.1
"""Render time between two looks at the queue of requests."""


class ViewController(Controller):
    """Runs the page of one image."""

    def __init__(
        self, send: Callable[[bytes], None], library: Library, allow_imports: bool, allow_outside: bool = False
    ) -> None:
        super().__init__(send)
        self._library, self._allow_imports, self._allow_outside = library, allow_imports, allow_outside
        self._view = ViewState()
        self._publisher = Publisher(send, self._view, self._interrupt, library)
        self._rays_before = 0.0
        self._moved_at: float | None = None
        self._chunk = 1

    # ---- the reading thread ------------------------------------------------------------------------------------------

    def receive(self, request: Any) -> None:
        if request.type in ANSWERED_AT_ONCE:
            self._publisher.receive(request, self._key(request))
            return
        super().receive(request)
        self._interrupt()

    def _key(self, request: Any) -> Hashable:
        if request.type == "open":  # one that keeps no edits is not replaced by one that does
            return request.type, request.keep_edits
        return super()._key(request)

    def _interrupt(self) -> None:
        """Stops the render where a request waits. Called repeatedly: a stop just before a render has no effect."""
        interactive = self._view.interactive
        if self._work and self._view.rendering and interactive is not None and interactive.full is not None:
            interactive.full.stop()

    # ---- the rendering thread ----------------------------------------------------------------------------------------

    def start(self) -> None:
        self._message("menu", **menu(self._library))
        self._publisher.start()

    def _wait_seconds(self) -> float | None:
        """How long to wait for a request before the next chunk; None: until one arrives."""
        if self._view.state != "busy":
            return None
        return 0.0 if self._moved_at is None else max(0.0, self._moved_at + REST_SECONDS - monotonic())

    def _step(self) -> None:
        """Handles a request, or renders a chunk."""
        request = self._work.take(self._wait_seconds())
        if request is not None:
            self._view.seq = max(self._view.seq, request.seq)
            self._handle(request)
        elif self._view.state == "busy":
            self._render_chunk()

    def _rest(self) -> None:
        self._set_idle(self._state_of_image())

    def _state_of_image(self) -> str:
        if self._view.interactive is None:
            return "idle"
        film = self._view.full_film()
        return "finished" if film is not None and film.spp >= self._view.target_spp else "stopped"

    def _on_open(self, request: requests.OpenRequest) -> None:
        """Loads the scene and renders a preview; the full image follows."""
        self._set_busy("loading")
        file, parameters = self._library.find(request.scene), self._library.parameters.get(request.scene)
        scene = load_scene(file, self._allow_imports, self._allow_outside, parameters)
        scene = replace(scene, native=None)  # a file that Mitsuba takes as it is could not be edited
        settings, provenance = self._settings(request, scene)
        engine = engine_of(request.settings.engine)
        before, offsets = self._view.interactive, {}
        if request.keep_edits and before is not None and before.scene.source == scene.source:
            edited, offsets = before.scene, before.offsets
            scene = replace(scene, camera=edited.camera, shapes=edited.shapes, lights=edited.lights)
        refusal = engine.why_not(scene, settings)
        if refusal:
            raise Unsupported(refusal)
        for warning in scene.warnings:
            self._message("warning", text=warning)
        shader = Choice.of(request.settings.shader).name
        if scene.media and shader in SHADERS and shader != VOLUMETRIC:
            self._message("warning", text=f"{shader} leaves out the media of the scene; {VOLUMETRIC} renders them")
        before = None
        interactive = self._prepared(scene, engine, settings)
        interactive.offsets = offsets
        self._view.interactive, self._view.provenance = interactive, provenance
        self._view.target_spp, self._view.seconds = request.spp, 0.0
        self._describe(request.scene, interactive)
        self._render_preview()
        self._moved_at = monotonic() - REST_SECONDS

    def _prepared(self, scene: Scene, engine: Engine, settings: Settings) -> InteractiveScene:
        """The new image. The old one stays until that is made, so that it survives an error; large ones are freed before."""
        width, height = settings.size(scene)
        if width * height > MAX_PIXELS_BESIDE:
            self._view.interactive = self._view.film = None
        try:
            return InteractiveScene(scene, engine, settings, self._set_activity)
        except MemoryError as error:
            raise ConfigError("there is not enough memory for this scene at this size") from error

    def _settings(self, request: requests.OpenRequest, scene: Scene) -> tuple[Settings, dict[str, Any]]:
        """The settings of a request within the limits, and the provenance for saved images."""
        asked = request.settings
        require_imports(asked.engine, self._allow_imports)
        if names_a_program(asked.engine):
            raise ConfigError(f"{asked.engine}: external renderers are not run from a page")
        chosen = {kind: getattr(asked, kind) for kind in CHOICES}
        same = {
            "precision": asked.precision,
            "threads": requests.limited_threads(asked.threads),
            "width": request.width,
            "height": request.height,
        }
        plugins = {kind: plugin_or_choice(kind, Choice.of(each), self._allow_imports) for kind, each in chosen.items()}
        settings = Settings(**plugins, **same, seed=request.seed)
        width, height = settings.size(scene)
        if width * height > requests.MAX_PIXELS:
            raise ConfigError(f"{width}x{height}: more than {requests.MAX_PIXELS} pixels: choose a smaller size")
        return settings, {
            "scene": request.scene,
            "scene_hash": scene.content_hash,
            "engine": asked.engine,
            "settings": {**chosen, **same},
            "seed": request.seed,
        }

    def _describe(self, name: str, interactive: InteractiveScene) -> None:
        scene, (width, height) = interactive.scene, (interactive.width, interactive.height)
        self._message("opened", width=width, height=height, scene=name, name=scene.name)
        draggables = [draggable._asdict() for draggable in interactive.draggables]
        self._message("scene", camera=camera_fields(scene.camera), draggables=draggables)

    def _on_camera(self, request: requests.CameraRequest) -> None:
        interactive = self._opened()
        camera = interactive.scene.camera
        if isinstance(camera, CustomCamera):
            raise ConfigError("the scene's camera is a plugin: it cannot be moved")
        _check_camera(request)
        changed = replace(camera, eye=request.eye, target=request.target, up=request.up)
        if isinstance(changed, Orthographic) and request.height is not None:
            changed = changed.scaled(request.height / changed.window()[1])
        interactive.set_camera(changed)
        self._preview_move()

    def _on_drag(self, request: requests.DragRequest) -> None:
        self._opened().drag(request.id, request.x, request.y)
        self._preview_move()

    def _preview_move(self) -> None:
        self._view.seconds = 0.0
        self._set_busy("moving")
        self._render_preview()
        self._moved_at = monotonic()

    def _on_pick(self, request: requests.PickRequest) -> None:
        """Sends the object that is picked; the render continues."""
        interactive = self._opened()
        try:
            picked = interactive.find(request.id) if request.id else interactive.pick(request.x, request.y)
        except Unsupported:  # a camera that is a plugin, or an engine that traces no single rays
            picked = None
        if picked is None:
            self._message("picked", id=None)
        else:
            self._message("picked", id=picked[0].id, name=picked[0].name, x=picked[1], y=picked[2])

    def _on_stop(self, request: Any) -> None:
        if self._view.state == "busy":
            self._set_idle("stopped")
        else:
            self._publisher.state()

    def _on_resume(self, request: Any) -> None:
        """Continues a stopped image."""
        interactive = self._opened()
        if self._view.state == "stopped" and (interactive.full is None or interactive.full.film.spp < self._view.target_spp):
            self._set_busy("rendering")
        else:
            self._publisher.state()

    def _opened(self) -> InteractiveScene:
        if self._view.interactive is None:
            raise ConfigError("no scene is open")
        return self._view.interactive

    def _render_preview(self) -> None:
        """Renders one sample per pixel of the preview and sends it at once."""
        interactive = self._opened()
        film = interactive.preview.film
        if film.spp:
            interactive.preview.update(camera=interactive.scene.camera)
        interactive.preview.render(1)
        self._view.show(film)
        self._publisher.frame(at_once=True)

    def _render_chunk(self) -> None:
        """Renders a chunk of the full image, after applying the changes since the last chunk."""
        interactive = self._opened()
        if self._moved_at is not None or interactive.full is None:
            renderer = interactive.update_full_renderer()
            if renderer.film.counts.any():
                renderer.update(camera=interactive.scene.camera)
            self._moved_at, self._view.seconds, self._view.rays = None, 0.0, 0.0
            self._rays_before = clock.counters(renderer).get("rays", 0.0)
            self._chunk = 1
        renderer = interactive.full
        assert renderer is not None
        if self._work:
            return
        self._view.activity = "rendering"
        left = self._view.target_spp - renderer.film.spp
        if left > 0:
            self._render(renderer, min(left, self._chunk))
        if renderer.film.spp >= self._view.target_spp:
            self._set_idle("finished")

    def _render(self, renderer: Any, spp: int) -> None:
        done = renderer.film.spp
        self._view.rendering = True
        start = perf_counter()
        try:
            if self._view.film is not renderer.film:
                renderer.render(spp, on_pass=self._view.show)
            else:
                renderer.render(spp)
        finally:
            self._view.rendering = False
        elapsed = perf_counter() - start
        self._view.seconds += elapsed
        self._view.rays = clock.counters(renderer).get("rays", 0.0) - self._rays_before
        if renderer.film.spp:
            self._view.show(renderer.film)
        rendered = renderer.film.spp - done
        if rendered:
            self._chunk = max(1, min(2 * self._chunk, int(CHUNK_SECONDS * rendered / elapsed)))

    def _set_busy(self, activity: str) -> None:
        self._view.state, self._view.activity = "busy", activity
        self._publisher.state()

    def _set_activity(self, activity: str) -> None:
        self._view.activity = activity
        self._publisher.state()

    def _set_idle(self, state: str) -> None:
        self._view.state, self._view.activity = state, ""
        if self._view.film is not None:
            self._publisher.frame(at_once=True)
        self._publisher.state()


def _check_camera(request: requests.CameraRequest) -> None:
    """Raises `ConfigError` for a camera without a direction, or one that looks along its `up`."""
    view = np.subtract(request.target, request.eye)
    side = np.cross(view, request.up)
    if not np.linalg.norm(side) > 1e-6 * np.linalg.norm(view) * np.linalg.norm(request.up):
        raise ConfigError("camera: target must differ from eye, and up from the direction of view")
