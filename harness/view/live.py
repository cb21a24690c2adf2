"""One image, refined while it is looked at.

Three threads: the reading one interrupts what renders, this desk's own renders, and a teller turns films into frames,
answers probes and tells the state, so that rendering waits for none of it.
"""

from __future__ import annotations

import tempfile
import threading
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

import numpy as np
import psutil

from engines.errors import ConfigError, RaybenchError
from engines.film import Film
from engines.registry import engine as engine_of
from engines.scene import CustomCamera, Orthographic, Scene, load_scene
from harness import measure
from harness.settings import engine_settings, require_imports
from harness.view import requests
from harness.view.display import Tone, rgba
from harness.view.library import Library
from harness.view.mailbox import Mailbox
from harness.view.menu import menu
from harness.view.messages import packed, problem
from harness.view.scene_text import scene_yaml
from harness.view.stage import Stage, camera_told
from harness.worker import one_line

REST_SECONDS = 0.15
"""Without a move, after which the large image begins."""
CHUNK_SECONDS = 0.1
FRAME_SECONDS = 0.1
STATE_SECONDS = 0.25
TICK_SECONDS = 0.02
MOST_UNSEEN = 2
"""Frames that are on their way to a page; one that draws slowly gets fewer."""
ASIDES = ("probe", "tone", "save", "yaml", "ack")


class ViewDesk:
    """A tab with one image."""

    def __init__(self, send: Callable[[bytes], None], library: Library, allow_imports: bool) -> None:
        self._send, self._library, self._allow_imports = send, library, allow_imports
        self._work, self._asides = Mailbox(), Mailbox()
        self._stage: Stage | None = None
        self._film: Film | None = None
        """What is shown: the large renderer's film, or the small one's while things move."""
        self._version = 0
        self._tone = Tone()
        self._wanted = 0
        self._seconds = 0.0
        self._rays = self._rays_before = 0.0
        self._state, self._doing, self._seq = "idle", "", 0
        self._moved_at: float | None = None
        self._rendering = False
        self._chunk = 1
        self._unseen = 0
        self._provenance: dict[str, Any] = {}

    # ---- the reading thread ------------------------------------------------------------------------------------------

    def hear(self, request: Any) -> None:
        key = (request.do, getattr(request, "finger", 0)) if request.do in requests.LATEST else None
        if request.do in ASIDES:
            self._asides.put(request, key)
            return
        self._work.put(request, key)
        self._interrupt()

    def _interrupt(self) -> None:
        stage = self._stage
        if stage is not None and stage.large is not None and self._rendering:
            stage.large.stop()

    # ---- the rendering thread ----------------------------------------------------------------------------------------

    def run(self) -> None:
        self._send(packed({"is": "menu", **menu(self._library)}))
        threading.Thread(target=self._tell_forever, daemon=True).start()
        while True:
            request = self._work.take(self._patience())
            self._guarded(request)

    def _patience(self) -> float | None:
        """Seconds to wait for a request before going on with what is to be done."""
        if self._state != "busy":
            return None
        return 0.0 if self._moved_at is None else max(0.0, self._moved_at + REST_SECONDS - monotonic())

    def _guarded(self, request: Any) -> None:
        try:
            if request is not None:
                self._seq = max(self._seq, request.seq)
                getattr(self, f"_{request.do}")(request)
            elif self._state == "busy":
                self._go_on()
        except Exception as error:
            if not isinstance(error, RaybenchError):
                traceback.print_exc()
            self._send(problem(one_line(error)))
            self._rest("idle" if self._stage is None else "stopped")

    def _open(self, request: requests.Open) -> None:
        """Loads the scene, shows it coarsely, and goes on to the image."""
        self._busy("loading")
        before, self._stage, self._film = self._stage, None, None
        try:
            self._stage = self._staged(request, before if request.keep else None)
        except MemoryError as error:
            raise ConfigError("there is not enough memory for this scene at this size") from error
        del before
        self._wanted = request.spp
        self._describe(request)
        self._tell_scene()
        self._coarse()
        self._moved_at = monotonic() - REST_SECONDS

    def _staged(self, request: requests.Open, before: Stage | None) -> Stage:
        part = request.part
        require_imports(part.engine, self._allow_imports)
        if part.engine.endswith((".yaml", ".yml")):
            raise ConfigError(f"{part.engine}: programs that are named in files are not run from a page")
        path = self._library.find(request.scene)
        scene = load_scene(path, allow_imports=self._allow_imports)
        plain = {"shader": part.shader, "sampler": part.sampler, "accelerator": part.accelerator,
                 "precision": part.precision, "threads": requests.threads_within(part.threads),
                 "width": request.width, "height": request.height}  # fmt: skip
        for kind in ("shader", "sampler", "accelerator"):
            if not isinstance(plain[kind].get("name"), str):
                raise ConfigError(f"{kind}: the key 'name' is wanted")
        settings = engine_settings(plain, request.seed, self._allow_imports)
        width, height = settings.size(scene)
        if width * height > requests.MOST_PIXELS:
            raise ConfigError(f"{width}x{height}: more than {requests.MOST_PIXELS} pixels: choose a smaller size")
        for warning in scene.warnings:
            self._send(packed({"is": "note", "text": warning}))
        kept = before is not None and before.scene.source == scene.source
        stage = Stage(_kept(scene, before) if kept and before else scene, engine_of(part.engine), settings, self._tell)
        if kept and before is not None:
            stage.offsets = dict(before.offsets)
        self._provenance = {"scene": request.scene, "scene_hash": scene.content_hash, "engine": part.engine,
                            "settings": plain, "seed": request.seed}  # fmt: skip
        return stage

    def _describe(self, request: requests.Open) -> None:
        assert self._stage is not None
        told = {"width": self._stage.width, "height": self._stage.height, "scene": request.scene}
        self._send(packed({"is": "opened", **told, "name": self._stage.scene.name}))

    def _tell_scene(self) -> None:
        assert self._stage is not None
        things = [movable._asdict() for movable in self._stage.movables]
        self._send(packed({"is": "scene", "camera": camera_told(self._stage.scene.camera), "movables": things}))

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
        self._busy("moving")
        self._coarse()
        self._moved_at = monotonic()

    def _grab(self, request: requests.Grab) -> None:
        """Says what is there; a render goes on."""
        stage = self._staged_already()
        found = stage.named(request.id) if request.id else stage.under(request.x, request.y)
        if found is None:
            self._send(packed({"is": "grabbed", "id": None}))
        else:
            self._send(packed({"is": "grabbed", "id": found[0].id, "name": found[0].name, "x": found[1], "y": found[2]}))

    def _stop(self, request: Any) -> None:
        if self._state == "busy":
            self._rest("stopped")
        else:
            self._tell_state()

    def _resume(self, request: Any) -> None:
        """Goes on with a stopped image."""
        stage = self._staged_already()
        if self._state == "stopped" and (stage.large is None or stage.large.film.spp < self._wanted):
            self._busy("rendering")
        else:
            self._tell_state()

    def _staged_already(self) -> Stage:
        if self._stage is None:
            raise ConfigError("no scene is open")
        return self._stage

    def _coarse(self) -> None:
        """One sample a pixel of the small image, on its way to the page at once."""
        stage = self._staged_already()
        film = stage.small.film
        if film.spp:
            stage.small.update(camera=stage.scene.camera)
        stage.small.render(1)
        self._show(film)
        self._send_frame(fresh=True)

    def _go_on(self) -> None:
        """A chunk of the large image; first of all what was changed since the last."""
        stage = self._staged_already()
        if self._moved_at is not None or stage.large is None:
            renderer = stage.settle()
            if renderer.film.counts.any():
                renderer.update(camera=stage.scene.camera)
            self._moved_at, self._seconds, self._rays = None, 0.0, 0.0
            self._rays_before = measure.counters(renderer).get("rays", 0.0)
            self._chunk = 1
        renderer = stage.large
        assert renderer is not None
        if self._work:
            return
        self._doing = "rendering"
        left = self._wanted - renderer.film.spp
        if left > 0:
            self._render(renderer, min(left, self._chunk))
        if renderer.film.spp >= self._wanted:
            self._rest("finished")

    def _render(self, renderer: Any, spp: int) -> None:
        done = renderer.film.spp
        self._rendering = True
        start = perf_counter()
        try:
            if self._film is not renderer.film:
                renderer.render(spp, on_pass=self._show)
            else:
                renderer.render(spp)
        finally:
            self._rendering = False
        elapsed = perf_counter() - start
        self._seconds += elapsed
        self._rays = measure.counters(renderer).get("rays", 0.0) - self._rays_before
        self._show(renderer.film)
        rendered = renderer.film.spp - done
        if rendered:
            self._chunk = max(1, min(2 * self._chunk, int(CHUNK_SECONDS * rendered / elapsed)))

    def _show(self, film: Film) -> None:
        self._film = film
        self._version += 1

    def _busy(self, doing: str) -> None:
        self._state, self._doing = "busy", doing
        self._tell_state()

    def _tell(self, doing: str) -> None:
        self._doing = doing
        self._tell_state()

    def _rest(self, state: str) -> None:
        self._state, self._doing = state, ""
        if self._film is not None:
            self._send_frame(fresh=True)
        self._tell_state()

    # ---- the telling thread ------------------------------------------------------------------------------------------

    def _tell_forever(self) -> None:
        framed = stated = 0.0
        version = -1
        while True:
            request = self._asides.take(TICK_SECONDS)
            try:
                if request is not None:
                    getattr(self, f"_aside_{request.do}")(request)
                if self._work:
                    self._interrupt()  # a stop that came just before a render began was not heard by it
                now = monotonic()
                partly = self._rendering and now - framed > 2 * FRAME_SECONDS
                if (self._version != version or partly) and now - framed >= FRAME_SECONDS and self._send_frame():
                    framed, version = now, self._version
                if self._state == "busy" and now - stated >= STATE_SECONDS:
                    self._tell_state()
                    stated = now
            except Exception as error:
                if not isinstance(error, RaybenchError):
                    traceback.print_exc()
                self._send(problem(one_line(error)))

    def _send_frame(self, fresh: bool = False) -> bool:
        """Sends what is shown, unless the page has frames enough to draw."""
        film, stage = self._film, self._stage
        if film is None or stage is None or (self._unseen >= MOST_UNSEEN and not fresh):
            return False
        if film.width == stage.width and not film.counts.any():
            return False
        self._unseen += 1
        told = {"width": film.width, "height": film.height, "spp": film.spp, "seq": self._seq}
        told["coarse"] = film.width != stage.width
        self._send(packed({"is": "frame", **told, "handles": stage.handles()}, rgba(film, self._tone)))
        return True

    def _tell_state(self) -> None:
        stage, film = self._stage, self._film
        told: dict[str, Any] = {"is": "state", "state": self._state, "doing": self._doing, "seq": self._seq}
        told |= {"seconds": self._seconds, "wanted": self._wanted, "memory_bytes": psutil.Process().memory_info().rss}
        large = stage.large if stage is not None else None
        if stage is not None:
            told |= {"build_seconds": stage.build_seconds, "compile_seconds": stage.compile_seconds}
        if large is not None and film is large.film:
            samples = float(large.film.counts.sum())
            seconds = max(self._seconds, 1e-9)
            told |= {"spp": large.film.spp, "samples_per_second": samples / seconds if self._seconds else None,
                     "rays_per_second": self._rays / seconds if self._rays else None,
                     "bad_samples": large.film.bad_samples}  # fmt: skip
        self._send(packed(told))

    def _aside_ack(self, request: Any) -> None:
        self._unseen = max(0, self._unseen - 1)

    def _aside_tone(self, request: requests.Tone) -> None:
        self._tone = Tone(request.mapper, request.exposure)
        self._version += 1

    def _aside_probe(self, request: requests.Probe) -> None:
        """The pixel's mean, the variance of that mean and its standard error, all a channel."""
        stage = self._stage
        film = stage.large.film if stage is not None and stage.large is not None else None
        if film is None or request.x >= film.width or request.y >= film.height:
            return
        count = int(film.counts[request.y, request.x])
        mean = film.sums[request.y, request.x] / max(count, 1)
        variance = np.full(3, np.nan)
        if count > 1:
            variance = np.maximum(film.squares[request.y, request.x] / count - mean**2, 0.0) / (count - 1)
        told = {"x": request.x, "y": request.y, "spp": count, "mean": mean.tolist(), "variance": variance.tolist()}
        self._send(packed({"is": "probe", **told, "error": np.sqrt(variance).tolist()}))

    def _aside_save(self, request: requests.Save) -> None:
        stage = self._stage
        if stage is None or stage.large is None or not stage.large.film.counts.any():
            raise ConfigError("there is no image to save yet")
        name = f"{Path(stage.scene.source).stem}.{request.kind}"
        camera = camera_told(stage.scene.camera)
        moves = {key: offset.tolist() for key, offset in stage.offsets.items()}
        told = {**self._provenance, "camera": camera, "moved": moves, "spp": stage.large.film.spp,
                "render_seconds": self._seconds, "tone_mapper": self._tone.name, "exposure": self._tone.exposure}  # fmt: skip
        with tempfile.TemporaryDirectory(prefix="raybench-") as folder:
            path = Path(folder, name)
            stage.large.film.save(path, provenance=told, tone_mapper=self._tone)
            self._send(packed({"is": "file", "name": name}, path.read_bytes()))

    def _aside_yaml(self, request: Any) -> None:
        stage = self._staged_already()
        text = scene_yaml(Path(stage.scene.source), stage.scene.camera, stage.offsets)
        self._send(packed({"is": "yaml", "text": text}))


def _kept(scene: Scene, before: Stage) -> Scene:
    """The scene with the camera and the moved things of an earlier stage on which the same file was."""
    return replace(scene, camera=before.scene.camera, shapes=before.scene.shapes, lights=before.scene.lights)


def _check_view(request: requests.View) -> None:
    """Refuses a camera without a direction, or one that looks along its `up`."""
    view = np.subtract(request.target, request.eye)
    side = np.cross(view, request.up)
    if not np.linalg.norm(side) > 1e-6 * np.linalg.norm(view) * np.linalg.norm(request.up):
        raise ConfigError("camera: target must differ from eye, and up from the direction of view")
