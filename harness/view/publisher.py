"""Sends frames and the state of one image to the page, and answers requests that do not change the image.

It has a thread of its own, so that the render waits neither for tone mapping nor for a page that draws slowly.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from engines.errors import ConfigError
from engines.film import Film
from engines.temporary import TemporaryFolder
from harness.view import requests
from harness.view.coalescing_queue import CoalescingQueue
from harness.view.display import Tone, rgba
from harness.view.error_map import EPSILON, ErrorReference, false_colours, reference_from_file, view_of
from harness.view.interactive_scene import InteractiveScene, camera_fields
from harness.view.library import Library
from harness.view.messages import failure_message, packed, state_message
from harness.view.yaml_export import scene_yaml

FRAME_SECONDS = 0.12
"""From one frame to the next during a render, at least."""
FRAME_SHARE = 2
"""The time between frames is at least this many times that of making one, which takes a core from the render."""
STATE_SECONDS = 0.25
TICK_SECONDS, IDLE_TICK_SECONDS = 0.02, 0.1
MAX_UNACKNOWLEDGED = 2
"""Frames that the page has not acknowledged yet, at most; a slow page gets fewer frames."""
ANSWERED_AT_ONCE = ("probe", "tone", "reference", "save", "yaml", "ack")


@dataclass
class ViewState:
    """What is shown, and its progress. The rendering thread writes it, the publisher reads it."""

    interactive: InteractiveScene | None = None
    film: Film | None = None
    """The film of the full renderer, or that of the preview during moves."""
    version: int = 0
    """Increases with every change of the film."""
    state: str = "idle"
    activity: str = ""
    seq: int = 0
    target_spp: int = 0
    seconds: float = 0.0
    """Time inside `render` since the full film was empty."""
    rays: float = 0.0
    rendering: bool = False
    provenance: dict[str, Any] = field(default_factory=dict)

    def show(self, film: Film) -> None:
        self.film = film
        self.version += 1

    def full_film(self) -> Film | None:
        """The film at full resolution, once there is one."""
        interactive = self.interactive
        return interactive.full.film if interactive is not None and interactive.full is not None else None


class Publisher:
    """Publishes a `ViewState`. `tick` is called some fifty times a second during a render."""

    def __init__(self, send: Callable[[bytes], None], view: ViewState, tick: Callable[[], None], library: Library) -> None:
        self._send, self._view, self._tick, self._library = send, view, tick, library
        self._requests = CoalescingQueue()
        self._tone = Tone()
        self._show = "image"
        self._reference: ErrorReference | None = None
        self._frame_lock = threading.Lock()
        self._unacknowledged = 0
        self._shown = -1
        """The version that was sent last."""

    def start(self) -> None:
        threading.Thread(target=self._run, daemon=True).start()

    def receive(self, request: Any, key: Any) -> None:
        """Queues a request of `ANSWERED_AT_ONCE`, which is answered during a render."""
        self._requests.put(request, key)

    def _run(self) -> None:
        last_frame = last_state = pause = 0.0
        while True:
            request = self._requests.take(TICK_SECONDS if self._view.state == "busy" else IDLE_TICK_SECONDS)
            try:
                if request is not None:
                    getattr(self, f"_on_{request.type}")(request)
                self._tick()
                now = monotonic()
                partly = self._view.rendering and self._view.film is self._view.full_film()
                if (self._view.version != self._shown or partly) and now - last_frame >= pause and self.frame():
                    last_frame, pause = now, max(FRAME_SECONDS, FRAME_SHARE * (monotonic() - now))
                if self._view.state == "busy" and now - last_state >= STATE_SECONDS:
                    self.state()
                    last_state = now
            except Exception as error:
                self._send(failure_message(error))

    def frame(self, at_once: bool = False) -> bool:
        """Sends the film as a frame. False where there is none, or where the page has not acknowledged earlier frames.

        Two threads call it; a later frame is of a later film.
        """
        with self._frame_lock:
            film, interactive, version = self._view.film, self._view.interactive, self._view.version
            if film is None or interactive is None or (self._unacknowledged >= MAX_UNACKNOWLEDGED and not at_once):
                return False
            preview = (film.width, film.height) != (interactive.width, interactive.height)
            if not preview and not film.counts.any():
                return False
            self._unacknowledged += 1
            fields = {"width": film.width, "height": film.height, "spp": film.spp, "preview": preview}
            fields |= {"seq": self._view.seq, "handles": interactive.handles()}
            pixels = None if preview else self._error_map(film, interactive, fields)
            self._send(packed({"type": "frame", **fields}, pixels or rgba(film, self._tone)))
            self._shown = version
            return True

    def _error_map(self, film: Film, interactive: InteractiveScene, fields: dict[str, Any]) -> bytes | None:
        """The error map where it is expected and there is a reference of this view; adds its mean to `fields`."""
        reference = self._reference
        if self._show != "error" or reference is None:
            return None
        if reference.view != view_of(interactive):
            self._reference = None
            self._send(packed({"type": "reference", "name": None, "why": "its view is not that of the image any more"}))
            return None
        error = reference.error((film.sums / np.maximum(film.counts, 1)[:, :, None]).astype(np.float32))
        fields |= {"error": float(error.mean(dtype=np.float64)), "epsilon": EPSILON}
        return false_colours(error)

    def state(self) -> None:
        """Sends the state: activity, times and rates."""
        now, film = self._view, self._view.full_film()
        fields: dict[str, Any] = {"render_seconds": now.seconds, "target_spp": now.target_spp}
        if now.interactive is not None:
            fields |= {"build_seconds": now.interactive.build_seconds, "compile_seconds": now.interactive.compile_seconds}
        if film is not None and now.film is film:
            seconds = now.seconds or None
            fields |= {
                "spp": film.spp,
                "samples_per_second": float(film.counts.sum()) / seconds if seconds else None,
                "rays_per_second": now.rays / seconds if seconds and now.rays else None,
                "bad_samples": film.bad_samples,
            }
        self._send(state_message(now.state, now.seq, activity=now.activity, **fields))

    # ---- requests ------------------------------------------------------------------------------------------------------

    def _on_ack(self, request: Any) -> None:
        self._unacknowledged = max(0, self._unacknowledged - 1)

    def _on_tone(self, request: requests.ToneRequest) -> None:
        self._tone, self._show = Tone(request.mapper, request.exposure), request.show
        self._view.version += 1

    def _on_reference(self, request: requests.ReferenceRequest) -> None:
        """Keeps the image as the reference of the error map, or reads one."""
        interactive, film = self._view.interactive, self._view.full_film()
        if interactive is None or film is None or not film.counts.all():
            raise ConfigError("there is no image to compare yet")
        if request.file is not None:
            self._reference = reference_from_file(self._library.inside(request.file, "reference"), interactive)
        else:
            engine = self._view.provenance.get("engine", "this image")
            mean = film.mean().astype(np.float32)
            self._reference = ErrorReference(mean, view_of(interactive), f"{engine}, {film.spp} samples per pixel")
        self._view.version += 1
        self._send(packed({"type": "reference", "name": self._reference.name}))

    def _on_probe(self, request: requests.ProbeRequest) -> None:
        """Sends the mean of a pixel, the variance of that mean and its standard error, by channel."""
        film = self._view.full_film()
        if film is None or request.x >= film.width or request.y >= film.height:
            return
        at = request.y, request.x
        count = int(film.counts[at])
        mean, variance = film.sums[at] / max(count, 1), np.full(3, np.nan)
        if count > 1:
            variance = np.maximum(film.squares[at] / count - mean**2, 0.0) / (count - 1)
        fields = {"x": request.x, "y": request.y, "spp": count, "mean": mean.tolist(), "variance": variance.tolist()}
        self._send(packed({"type": "probe", **fields, "error": np.sqrt(variance).tolist()}))

    def _on_save(self, request: requests.SaveRequest) -> None:
        """Sends the image as a file, with its provenance in the header."""
        interactive, film = self._view.interactive, self._view.full_film()
        if interactive is None or film is None or not film.counts.any():
            raise ConfigError("there is no image to save yet")
        name = f"{Path(interactive.scene.source).stem}.{request.kind}"
        provenance = {
            **self._view.provenance,
            "camera": camera_fields(interactive.scene.camera),
            "moved": {key: offset.tolist() for key, offset in interactive.offsets.items()},
            "spp": film.spp,
            "render_seconds": self._view.seconds,
            "tone_mapper": self._tone.name,
            "exposure": self._tone.exposure,
        }
        with TemporaryFolder() as folder:
            path = Path(folder, name)
            film.save(path, provenance=provenance, tone_mapper=self._tone)
            self._send(packed({"type": "file", "name": name}, path.read_bytes()))

    def _on_yaml(self, request: Any) -> None:
        interactive = self._view.interactive
        if interactive is None:
            raise ConfigError("no scene is open")
        source, camera = Path(interactive.scene.source), interactive.scene.camera
        self._send(packed({"type": "yaml", "text": scene_yaml(source, camera, interactive.offsets)}))
