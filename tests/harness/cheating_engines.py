"""Ten engines that cheat, each in one way, and no error to be seen. `FLAGS` names the flag that each must earn."""

from __future__ import annotations

import copy
import hashlib
import os
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from fake_engines import FakeRenderer, Steady, work

from engines.film import Film
from engines.interface import Settings
from engines.scene import Scene

CACHE = "RAYBENCH_TEST_CACHE"


class Cheat(Steady):
    """Lets `changed` change every sample, and `spoil` the film that is returned."""

    def changed(self, samples: np.ndarray) -> np.ndarray:
        return samples

    def spoil(self, film: Film) -> Film:
        return film

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        add, render = renderer.film.add, renderer.render
        renderer.film.add = lambda samples: add(self.changed(samples))
        renderer.render = lambda spp, on_pass=None: self.spoil(copy.deepcopy(render(spp)))
        return renderer


class ClampsSamples(Cheat):
    name = "clamps_samples"

    def changed(self, samples: np.ndarray) -> np.ndarray:
        return np.minimum(samples, 1.2)


class Denoises(Cheat):
    """Replaces every pixel by the mean of nine."""

    name = "denoises"

    def spoil(self, film: Film) -> Film:
        padded = np.pad(film.sums, ((1, 1), (1, 1), (0, 0)), mode="edge")
        height, width = film.counts.shape
        film.sums = sum(padded[y : y + height, x : x + width] for y in range(3) for x in range(3)) / 9
        return film


class ReturnsReference(Cheat):
    """Finds the reference in its cache."""

    name = "returns_reference"

    def spoil(self, film: Film) -> Film:
        from harness.store import reference_files

        with np.load(next(reference_files.cache_folder().glob("*/*/film-*.npz"))) as arrays:
            film.sums = film.spp * arrays["sums"] / arrays["counts"][:, :, None]
        return film


class RendersFewer(Steady):
    """Renders half the samples of large requests."""

    name = "renders_fewer"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render = renderer.render
        renderer.render = lambda spp, on_pass=None: render((spp + 1) // 2)
        return renderer


class CountsTwice(Steady):
    """Counts every sample as two."""

    name = "counts_twice"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render, said = renderer.render, 0

        def half(spp: int, on_pass: Any = None) -> Film:
            nonlocal said
            said += spp
            film = copy.deepcopy(render((said + 1) // 2 - renderer.film.spp))
            scale = said / film.spp
            film.sums, film.squares, film.even_sums = scale * film.sums, scale * film.squares, scale * film.even_sums
            film.counts[...] = said
            return film

        renderer.render = half
        return renderer


class IgnoresSeed(Steady):
    name = "ignores_seed"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        return super().prepare(scene, replace(settings, seed=7))


class KeepsImage(Steady):
    """Keeps what it renders under the first seed in a file, and shows it again under the second."""

    name = "keeps_image"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        kept = Path(os.environ[CACHE]) / "seed"
        if settings.seed == 1:
            kept.write_text("1")
        seed = int(kept.read_text()) if settings.seed == 2 else settings.seed
        return super().prepare(scene, replace(settings, seed=seed))


class WorksBetween(Steady):
    """Has a thread go on after `render` has returned."""

    name = "works_between"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render, count = renderer.render, renderer.counters
        ahead = threading.Thread(target=work, args=(0.0,))

        def rendered(spp: int, on_pass: Any = None) -> Film:
            nonlocal ahead
            film = render(spp)
            ahead = threading.Thread(target=work, args=(0.05,))
            ahead.start()
            return film

        def counters() -> Mapping[str, float]:
            if ahead.ident is not None:
                ahead.join()
            return count()

        renderer.render, renderer.counters = rendered, counters  # type: ignore[method-assign]
        return renderer


class TakesThreads(Steady):
    """Works on four threads, whatever it is allowed."""

    name = "takes_threads"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render, pool = renderer.render, ThreadPoolExecutor(4)

        def rendered(spp: int, on_pass: Any = None) -> Film:
            list(pool.map(hashed, [0.03] * 4))
            return render(spp)

        renderer.render = rendered
        return renderer


def hashed(seconds: float) -> None:
    """Uses that much time of a processor, and lets other threads do the same."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        hashlib.pbkdf2_hmac("sha256", b"password", b"salt", 2000)


class WrongCorner(Cheat):
    """Is too bright in one corner, and too dark elsewhere by as much in all."""

    name = "wrong_corner"

    def changed(self, samples: np.ndarray) -> np.ndarray:
        height, width, _ = samples.shape
        error = np.full_like(samples, -0.03)
        error[: height // 2, : width // 2] = 0.09
        return samples + error


FLAGS: Mapping[str, str] = {
    "ClampsSamples": "biased_image",
    "Denoises": "too_good_per_sample",
    "ReturnsReference": "reference_copied",
    "CountsTwice": "fewer_samples",
    "IgnoresSeed": "ignores_seed",
    "KeepsImage": "stale_image",
    "WorksBetween": "works_between_calls",
    "TakesThreads": "too_many_threads",
    "WrongCorner": "biased_tile",
}
REFUSED: Mapping[str, str] = {"RendersFewer": "the engine's film.counts are 3: 4 is expected, the samples requested"}
