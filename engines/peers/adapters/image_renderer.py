"""The base class of a renderer that returns images: the film and everything around it, and seeds of fewer bits."""

from __future__ import annotations

import hashlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.concurrency import CallGuard
from engines.errors import RendererFailed, Unsupported
from engines.film import Film, Image
from engines.interface import Engine, Hits, OnPass, Settings
from engines.scene import Camera, Scene, Shape

MEANS_ALONE = {
    "render_adds_to_the_film": "the variance within the image of one call is not known, only that between calls",
    "the_parts_of_the_film_belong_together": "a call leaves the means of its samples, neither squares nor halves",
}
"""Keys of claims of `engines.conformance`, with reasons: what a renderer of means of several samples cannot promise."""


WATCHED = 16
"""Samples per pixel between two calls of `on_pass`."""
BITS = 31
"""Of a derived seed: renderers take no more, some of them as a signed number."""


def derive_seed(seed: int, part: int | str = 0) -> int:
    """A seed in [1, 2^31) for `part` of what is rendered under `seed`: another one for every pair, the same one every time.

    All bits of `seed` count. 0 is left out: some renderers take it for a seed of their own choice.
    """
    digest = hashlib.sha256(f"{seed}/{part}".encode()).digest()
    return int.from_bytes(digest[:8], "big") % ((1 << BITS) - 1) + 1


class ImageRenderer(ABC):
    """A scene with resolved settings, rendered by `image`. See `engines.interface.Renderer` for what the methods promise.

    A subclass has `build` and `image`, and where they fit `compile`, `interrupt` and `samples_a_pass`. They are never called
    by two threads at once, but for `interrupt`. `scene`, `settings`, `film` and `seed` may be read; `stopped` is set from
    `stop` on until the next call.
    """

    samples_a_pass: int | None = None
    """Samples per pixel of an `image`, between which `stop` and `on_pass` act; None: all that a call of `render` asks for, or
    at most `WATCHED` for a call with `on_pass`."""

    def __init__(self, engine: Engine, scene: Scene, settings: Settings) -> None:
        """`settings` with every choice resolved. `engine.why_not` is asked before an update."""
        self.engine, self.scene, self.settings = engine, scene, settings
        self.film = Film(*settings.size(scene))
        self.seed = derive_seed(settings.seed)
        self.stopped = threading.Event()
        self._guard = CallGuard()
        self._build_seconds = self._compile_seconds = 0.0
        self._build()

    @abstractmethod
    def build(self, scene: Scene, settings: Settings) -> None:
        """Translates the scene, and builds what rendering needs. `update` calls it again, with another camera or shapes."""

    @abstractmethod
    def image(self, spp: int, offset: int, seed: int) -> Image | tuple[Image, int | NDArray[np.integer]] | None:
        """The mean of `spp` new samples per pixel, (h, w, 3) linear radiance, row 0 at the top. If their true number may differ
        (see `overshoots` in `engines.interface.Engine`), it follows, one number or (h, w). None only after `stop`.

        `offset` is the number of samples in the film, and so of the first new one. `seed`, in [1, 2^31), is the same in all
        calls: a renderer that cannot begin at a sample takes `derive_seed(seed, offset)`, or its samples would repeat.
        """

    def compile(self) -> None:
        """What `warm_up` does: all that a first image costs once. By default an image of one sample per pixel."""
        self.image(1, 0, self.seed)

    def interrupt(self) -> None:  # noqa: B027
        """Ends a running `image`, if it can. Called by `stop` from any thread."""

    def warm_up(self) -> None:
        """`compile`, on the clock of compilation."""
        with self._guard.rendering("warm_up"):
            self.stopped.clear()
            begin = perf_counter()
            self.compile()
            self._compile_seconds += perf_counter() - begin

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples to every pixel, `samples_a_pass` at a time; after `stop`, what is done by then."""
        with self._guard.rendering():
            self.stopped.clear()
            target = self.film.spp + spp
            while self.film.spp < target and not self.stopped.is_set():
                missing = target - self.film.spp
                samples = min(missing, self.samples_a_pass or (missing if on_pass is None else WATCHED))
                image = self.image(samples, self.film.spp, self.seed)
                if image is None:
                    if self.stopped.is_set():
                        break
                    raise RendererFailed(f"{self.engine.name}: the renderer gave no image, and nobody stopped it")
                self.film.add_mean(*(image if isinstance(image, tuple) else (image, samples)))
                if on_pass is not None:
                    on_pass(self.film)
            return self.film

    def stop(self) -> None:
        """Ends a running `render` after its pass, or sooner where the subclass can `interrupt` it."""
        self.stopped.set()
        self.interrupt()

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Builds anew with another camera or other shapes, and restarts the film."""
        given: dict[str, Any] = {"camera": camera, "shapes": None if shapes is None else tuple(shapes)}
        changes = {key: value for key, value in given.items() if value is not None}
        with self._guard.updating():
            changed = replace(self.scene, source="", **changes) if changes else self.scene
            if changes and (reason := self.engine.why_not(changed, self.settings)) is not None:
                raise Unsupported(reason)
            self.film, self.scene = Film(*self.settings.size(changed)), changed
            self._build()

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Raises `Unsupported`: a renderer of images answers no single rays."""
        raise Unsupported(f"{self.engine.name} renders images and answers no single rays")

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Raises `Unsupported`, as `trace` does."""
        raise Unsupported(f"{self.engine.name} renders images and answers no single rays")

    def counters(self) -> Mapping[str, float]:
        """Seconds and bad samples; memory is not known, and rays are not counted. A subclass may add its own."""
        return {
            "build_seconds": self._build_seconds,
            "compile_seconds": self._compile_seconds,
            "accelerator_bytes": 0.0,
            "bad_samples": float(self.film.bad_samples),
        }

    def _build(self) -> None:
        begin = perf_counter()
        self.build(self.scene, self.settings)
        self._build_seconds = perf_counter() - begin
