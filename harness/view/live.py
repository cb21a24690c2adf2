"""One image, refined while it is looked at.

Three threads: the reading one interrupts what renders, this desk's own renders, and a teller (`telling`) turns films into
frames, answers probes and tells the state.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import replace
from time import monotonic, perf_counter
from typing import Any

import numpy as np

from engines.errors import ConfigError, RaybenchError, Unsupported
from engines.interface import Settings
from engines.registry import engine as engine_of
from engines.registry import is_file
from engines.scene import CustomCamera, Orthographic, Scene, load_scene
from harness.config.settings import engine_settings, require_imports
from harness.measure import clock as measure
from harness.processes import one_line
from harness.view import requests
from harness.view.library import Library
from harness.view.mailbox import Mailbox
from harness.view.menu import menu
from harness.view.messages import latest_key, packed, problem
from harness.view.stage import Stage, camera_told
from harness.view.telling import ASIDES, Picture, Teller

REST_SECONDS = 0.15
"""Without a move, after which the large image begins."""
CHUNK_SECONDS = 0.1
"""Of rendering, between two looks at what was asked meanwhile."""


class ViewDesk:
    """A tab with one image."""

    def __init__(self, send: Callable[[bytes], None], library: Library, allow_imports: bool) -> None:
        self._send, self._library, self._allow_imports = send, library, allow_imports
        self._work = Mailbox()
        self._picture = Picture()
        self._teller = Teller(send, self._picture, self._interrupt)
        self._rays_before = 0.0
        self._moved_at: float | None = None
        self._chunk = 1

    # ---- the reading thread ------------------------------------------------------------------------------------------

    def hear(self, request: Any) -> None:
        key = latest_key(request.do, getattr(request, "finger", None))
        if request.do in ASIDES:
            self._teller.hear(request, key)
            return
        self._work.put(request, key)
        self._interrupt()

    def _interrupt(self) -> None:
        """Stops what renders where a request waits. Called again and again: a stop just before a render is not heard."""
        stage = self._picture.stage
        if self._work and self._picture.rendering and stage is not None and stage.large is not None:
            stage.large.stop()

    # ---- the rendering thread ----------------------------------------------------------------------------------------

    def start(self) -> None:
        self._send(packed({"is": "menu", **menu(self._library)}))
        self._teller.start()

    def run(self) -> None:
        while True:
            request = self._work.take(self._patience())
            self._guarded(request)

    def _patience(self) -> float | None:
        """Seconds to wait for a request before going on with what is to be done."""
        if self._picture.state != "busy":
            return None
        return 0.0 if self._moved_at is None else max(0.0, self._moved_at + REST_SECONDS - monotonic())

    def _guarded(self, request: Any) -> None:
        try:
            if request is not None:
                self._picture.seq = max(self._picture.seq, request.seq)
                getattr(self, f"_{request.do}")(request)
            elif self._picture.state == "busy":
                self._go_on()
        except Exception as error:
            if not isinstance(error, RaybenchError):
                traceback.print_exc()
            self._send(problem(one_line(error)))
            self._rest("idle" if self._picture.stage is None else "stopped")

    def _open(self, request: requests.Open) -> None:
        """Loads the scene, shows it coarsely, and goes on to the image."""
        self._busy("loading")
        scene = load_scene(self._library.find(request.scene), allow_imports=self._allow_imports)
        settings, provenance = self._settings(request, scene)
        engine = engine_of(request.part.engine)
        before, offsets = self._picture.stage, {}
        if request.keep and before is not None and before.scene.source == scene.source:
            was, offsets = before.scene, before.offsets
            scene = replace(scene, camera=was.camera, shapes=was.shapes, lights=was.lights)
        lacking = engine.why_not(scene, settings)
        if lacking:
            raise Unsupported(lacking)
        for warning in scene.warnings:
            self._send(packed({"is": "note", "text": warning}))
        before = self._picture.stage = self._picture.film = None  # frees old renderers before new ones are made
        try:
            stage = Stage(scene, engine, settings, self._tell)
        except MemoryError as error:
            raise ConfigError("there is not enough memory for this scene at this size") from error
        stage.offsets = offsets
        self._picture.stage, self._picture.provenance = stage, provenance
        self._picture.wanted, self._picture.seconds = request.spp, 0.0
        self._describe(request.scene, stage)
        self._coarse()
        self._moved_at = monotonic() - REST_SECONDS

    def _settings(self, request: requests.Open, scene: Scene) -> tuple[Settings, dict[str, Any]]:
        """The settings asked for, within the limits, and what a saved image says of them."""
        part = request.part
        require_imports(part.engine, self._allow_imports)
        if is_file(part.engine):
            raise ConfigError(f"{part.engine}: programs that are named in files are not run from a page")
        plain = {
            "shader": part.shader, "sampler": part.sampler, "accelerator": part.accelerator, "precision": part.precision,
            "threads": requests.threads_within(part.threads), "width": request.width, "height": request.height,
        }  # fmt: skip
        settings = engine_settings(plain, request.seed, self._allow_imports)
        width, height = settings.size(scene)
        if width * height > requests.MOST_PIXELS:
            raise ConfigError(f"{width}x{height}: more than {requests.MOST_PIXELS} pixels: choose a smaller size")
        return settings, {
            "scene": request.scene, "scene_hash": scene.content_hash, "engine": part.engine, "settings": plain,
            "seed": request.seed,
        }  # fmt: skip

    def _describe(self, name: str, stage: Stage) -> None:
        told = {"width": stage.width, "height": stage.height, "scene": name, "name": stage.scene.name}
        self._send(packed({"is": "opened", **told}))
        things = [movable._asdict() for movable in stage.movables]
        self._send(packed({"is": "scene", "camera": camera_told(stage.scene.camera), "movables": things}))

    def _camera(self, request: requests.View) -> None:
        stage = self._staged_already()
        camera = stage.scene.camera
        if isinstance(camera, CustomCamera):
            raise ConfigError("the scene's camera is a plugin: it cannot be moved")
        _check_view(request)
        changed = replace(camera, eye=request.eye, target=request.target, up=request.up)
        if isinstance(changed, Orthographic) and request.height is not None:
            changed = replace(changed, height=request.height)
        stage.look(changed)
        self._moving()

    def _drag(self, request: requests.Drag) -> None:
        self._staged_already().drag(request.id, request.x, request.y)
        self._moving()

    def _moving(self) -> None:
        self._picture.seconds = 0.0
        self._busy("moving")
        self._coarse()
        self._moved_at = monotonic()

    def _grab(self, request: requests.Grab) -> None:
        """Says what is there; a render goes on."""
        stage = self._staged_already()
        try:
            found = stage.named(request.id) if request.id else stage.under(request.x, request.y)
        except Unsupported:  # a camera that is a plugin, or an engine that traces no single rays
            found = None
        if found is None:
            self._send(packed({"is": "grabbed", "id": None}))
        else:
            self._send(packed({"is": "grabbed", "id": found[0].id, "name": found[0].name, "x": found[1], "y": found[2]}))

    def _stop(self, request: Any) -> None:
        if self._picture.state == "busy":
            self._rest("stopped")
        else:
            self._teller.state()

    def _resume(self, request: Any) -> None:
        """Goes on with a stopped image."""
        stage = self._staged_already()
        if self._picture.state == "stopped" and (stage.large is None or stage.large.film.spp < self._picture.wanted):
            self._busy("rendering")
        else:
            self._teller.state()

    def _staged_already(self) -> Stage:
        if self._picture.stage is None:
            raise ConfigError("no scene is open")
        return self._picture.stage

    def _coarse(self) -> None:
        """One sample a pixel of the small image, on its way to the page at once."""
        stage = self._staged_already()
        film = stage.small.film
        if film.spp:
            stage.small.update(camera=stage.scene.camera)
        stage.small.render(1)
        self._picture.show(film)
        self._teller.frame(at_once=True)

    def _go_on(self) -> None:
        """A chunk of the large image; first of all what was changed since the last."""
        stage = self._staged_already()
        if self._moved_at is not None or stage.large is None:
            renderer = stage.settle()
            if renderer.film.counts.any():
                renderer.update(camera=stage.scene.camera)
            self._moved_at, self._picture.seconds, self._picture.rays = None, 0.0, 0.0
            self._rays_before = measure.counters(renderer).get("rays", 0.0)
            self._chunk = 1
        renderer = stage.large
        assert renderer is not None
        if self._work:
            return
        self._picture.doing = "rendering"
        left = self._picture.wanted - renderer.film.spp
        if left > 0:
            self._render(renderer, min(left, self._chunk))
        if renderer.film.spp >= self._picture.wanted:
            self._rest("finished")

    def _render(self, renderer: Any, spp: int) -> None:
        done = renderer.film.spp
        self._picture.rendering = True
        start = perf_counter()
        try:
            if self._picture.film is not renderer.film:
                renderer.render(spp, on_pass=self._picture.show)
            else:
                renderer.render(spp)
        finally:
            self._picture.rendering = False
        elapsed = perf_counter() - start
        self._picture.seconds += elapsed
        self._picture.rays = measure.counters(renderer).get("rays", 0.0) - self._rays_before
        if renderer.film.spp:
            self._picture.show(renderer.film)
        rendered = renderer.film.spp - done
        if rendered:
            self._chunk = max(1, min(2 * self._chunk, int(CHUNK_SECONDS * rendered / elapsed)))

    def _busy(self, doing: str) -> None:
        self._picture.state, self._picture.doing = "busy", doing
        self._teller.state()

    def _tell(self, doing: str) -> None:
        self._picture.doing = doing
        self._teller.state()

    def _rest(self, state: str) -> None:
        self._picture.state, self._picture.doing = state, ""
        if self._picture.film is not None:
            self._teller.frame(at_once=True)
        self._teller.state()


def _check_view(request: requests.View) -> None:
    """Refuses a camera without a direction, or one that looks along its `up`."""
    view = np.subtract(request.target, request.eye)
    side = np.cross(view, request.up)
    if not np.linalg.norm(side) > 1e-6 * np.linalg.norm(view) * np.linalg.norm(request.up):
        raise ConfigError("camera: target must differ from eye, and up from the direction of view")
