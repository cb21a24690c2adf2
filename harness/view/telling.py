"""What a tab with one image is told: frames, the state line, and answers to what does not change the image.

A thread of its own does it, so that rendering waits neither for tone mapping nor for a page that draws slowly.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import psutil

from engines.errors import ConfigError, RaybenchError
from engines.film import Film
from engines.temporary import TemporaryFolder
from harness.processes import one_line
from harness.view import requests
from harness.view.display import Tone, rgba
from harness.view.mailbox import Mailbox
from harness.view.messages import packed, problem
from harness.view.scene_text import scene_yaml
from harness.view.stage import Stage, camera_told

FRAME_SECONDS = 0.12
"""From one frame to the next while something renders."""
FRAME_SHARE = 2
"""That pause is at least this many times what a frame costs: large ones take cores from the render."""
STATE_SECONDS = 0.25
TICK_SECONDS, IDLE_TICK_SECONDS = 0.02, 0.1
MOST_UNSEEN = 2
"""Frames that are on their way to a page; one that draws slowly gets fewer."""
ASIDES = ("probe", "tone", "save", "yaml", "ack")


@dataclass
class Picture:
    """What is shown and how far it is. The rendering thread writes it, the teller reads it."""

    stage: Stage | None = None
    film: Film | None = None
    """The large renderer's, or the small one's while things move."""
    version: int = 0
    """Rises with what is shown."""
    state: str = "idle"
    doing: str = ""
    seq: int = 0
    wanted: int = 0
    seconds: float = 0.0
    """Spent in `render` since the large film was empty."""
    rays: float = 0.0
    rendering: bool = False
    provenance: dict[str, Any] = field(default_factory=dict)

    def show(self, film: Film) -> None:
        self.film = film
        self.version += 1

    def large_film(self) -> Film | None:
        """The film at full resolution, once there is one."""
        stage = self.stage
        return stage.large.film if stage is not None and stage.large is not None else None


class Teller:
    """Tells a page about a picture. `tick` is called some fifty times a second while it is busy."""

    def __init__(self, send: Callable[[bytes], None], picture: Picture, tick: Callable[[], None]) -> None:
        self._send, self._picture, self._tick = send, picture, tick
        self._asides = Mailbox()
        self._look = Tone()
        self._framing = threading.Lock()
        self._unseen = 0
        self._shown = -1
        """The version that was sent last."""

    def start(self) -> None:
        threading.Thread(target=self._run, daemon=True).start()

    def hear(self, request: Any, key: Any) -> None:
        """An aside: it is answered while something renders."""
        self._asides.put(request, key)

    def _run(self) -> None:
        framed = stated = pause = 0.0
        while True:
            request = self._asides.take(TICK_SECONDS if self._picture.state == "busy" else IDLE_TICK_SECONDS)
            try:
                if request is not None:
                    getattr(self, f"_{request.do}")(request)
                self._tick()
                now = monotonic()
                partly = self._picture.rendering and self._picture.film is self._picture.large_film()
                if (self._picture.version != self._shown or partly) and now - framed >= pause and self.frame():
                    framed, pause = now, max(FRAME_SECONDS, FRAME_SHARE * (monotonic() - now))
                if self._picture.state == "busy" and now - stated >= STATE_SECONDS:
                    self.state()
                    stated = now
            except Exception as error:
                if not isinstance(error, RaybenchError):
                    traceback.print_exc()
                self._send(problem(one_line(error)))

    def frame(self, at_once: bool = False) -> bool:
        """Sends what is shown; False where there is nothing yet, or the page has frames enough to draw. Two threads call it:
        the later frame is of the later film."""
        with self._framing:
            film, stage, version = self._picture.film, self._picture.stage, self._picture.version
            if film is None or stage is None or (self._unseen >= MOST_UNSEEN and not at_once):
                return False
            coarse = (film.width, film.height) != (stage.width, stage.height)
            if not coarse and not film.counts.any():
                return False
            self._unseen += 1
            told = {"width": film.width, "height": film.height, "spp": film.spp, "coarse": coarse}
            told |= {"seq": self._picture.seq, "handles": stage.handles()}
            self._send(packed({"is": "frame", **told}, rgba(film, self._look)))
            self._shown = version
            return True

    def state(self) -> None:
        """Sends the state line."""
        now, film = self._picture, self._picture.large_film()
        told: dict[str, Any] = {"is": "state", "state": now.state, "doing": now.doing, "seq": now.seq}
        told |= {"seconds": now.seconds, "wanted": now.wanted, "memory_bytes": psutil.Process().memory_info().rss}
        if now.stage is not None:
            told |= {"build_seconds": now.stage.build_seconds, "compile_seconds": now.stage.compile_seconds}
        if film is not None and now.film is film:
            seconds = now.seconds or None
            told |= {"spp": film.spp, "samples_per_second": float(film.counts.sum()) / seconds if seconds else None,
                     "rays_per_second": now.rays / seconds if seconds and now.rays else None,
                     "bad_samples": film.bad_samples}  # fmt: skip
        self._send(packed(told))

    # ---- asides ------------------------------------------------------------------------------------------------------

    def _ack(self, request: Any) -> None:
        self._unseen = max(0, self._unseen - 1)

    def _tone(self, request: requests.Tone) -> None:
        self._look = Tone(request.mapper, request.exposure)
        self._picture.version += 1

    def _probe(self, request: requests.Probe) -> None:
        """The pixel's mean, the variance of that mean and its standard error, each by channel."""
        film = self._picture.large_film()
        if film is None or request.x >= film.width or request.y >= film.height:
            return
        at = request.y, request.x
        count = int(film.counts[at])
        mean, variance = film.sums[at] / max(count, 1), np.full(3, np.nan)
        if count > 1:
            variance = np.maximum(film.squares[at] / count - mean**2, 0.0) / (count - 1)
        told = {"x": request.x, "y": request.y, "spp": count, "mean": mean.tolist(), "variance": variance.tolist()}
        self._send(packed({"is": "probe", **told, "error": np.sqrt(variance).tolist()}))

    def _save(self, request: requests.Save) -> None:
        """Sends the image as a file, with all that made it in the header."""
        stage, film = self._picture.stage, self._picture.large_film()
        if stage is None or film is None or not film.counts.any():
            raise ConfigError("there is no image to save yet")
        name = f"{Path(stage.scene.source).stem}.{request.kind}"
        told = {
            **self._picture.provenance, "camera": camera_told(stage.scene.camera),
            "moved": {key: offset.tolist() for key, offset in stage.offsets.items()}, "spp": film.spp,
            "render_seconds": self._picture.seconds, "tone_mapper": self._look.name, "exposure": self._look.exposure,
        }  # fmt: skip
        with TemporaryFolder() as folder:
            path = Path(folder, name)
            film.save(path, provenance=told, tone_mapper=self._look)
            self._send(packed({"is": "file", "name": name}, path.read_bytes()))

    def _yaml(self, request: Any) -> None:
        stage = self._picture.stage
        if stage is None:
            raise ConfigError("no scene is open")
        self._send(packed({"is": "yaml", "text": scene_yaml(Path(stage.scene.source), stage.scene.camera, stage.offsets)}))
