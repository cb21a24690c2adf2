"""Engines for tests of the harness: a known image with noise that depends on seed and sample alone, known times, and
every way to misbehave. Named in experiments as `fake_engines:Steady`."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from engines.errors import Unsupported
from engines.film import Film
from engines.interface import FullPattern, Settings
from engines.scene import Scene

NOISE = 0.5


def truth(width: int, height: int) -> np.ndarray:
    """The image that all samples have as their mean."""
    y, x = np.mgrid[0:height, 0:width]
    return np.stack([0.5 + 0.4 * x / width, 0.5 + 0.4 * y / height, np.full((height, width), 0.5)], axis=2)


class FakeRenderer:
    """Adds truth plus noise, and sleeps `seconds_per_spp` for each sample."""

    def __init__(self, engine: Steady, scene: Scene, settings: Settings) -> None:
        time.sleep(engine.build_seconds)
        width, height = settings.size(scene)
        self.engine, self.seed, self.film = engine, settings.seed, Film(width, height)
        self.compile_seconds = 0.0

    def warm_up(self) -> None:
        time.sleep(self.engine.compile_seconds)
        self.compile_seconds = self.engine.compile_seconds

    def render(self, spp: int, on_pass: Any = None) -> Film:
        height, width = self.film.height, self.film.width
        for _ in range(spp):
            noise = np.random.default_rng([self.seed, self.film.spp]).normal(0.0, NOISE, (height, width, 3))
            self.film.add(truth(width, height) + noise)
            time.sleep(self.engine.seconds_per_spp)
        return self.film

    def counters(self) -> Mapping[str, float]:
        rays = float(self.film.spp * self.film.width * self.film.height)
        return {"rays": rays, "build_seconds": 0.0, "compile_seconds": self.compile_seconds, "bad_samples": 0.0}


class Steady:
    """Does what it is asked, in known time."""

    name, version = "steady", "1"
    build_seconds = compile_seconds = seconds_per_spp = 0.0

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return None

    def accelerators(self) -> Mapping[str, Mapping[str, Any]]:
        return {"none": {}}

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        return FakeRenderer(self, scene, settings)


class Phased(Steady):
    """Takes known times to build, compile and render."""

    name = "phased"
    build_seconds, compile_seconds, seconds_per_spp = 0.05, 0.1, 0.02


class Other(Steady):
    """Equal to Steady under another name, with another accelerator."""

    name = "other"

    def accelerators(self) -> Mapping[str, Mapping[str, Any]]:
        return {"none": {}, "tree": {}}


class Brighter(Steady):
    """Makes an image that is 3 % too bright."""

    name = "brighter"
    factor = 1.03

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        add = renderer.film.add
        renderer.film.add = lambda samples: add(self.factor * samples)
        return renderer


class Apart(Steady):
    """Equal to Steady, but for its random numbers."""

    name = "apart"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        return super().prepare(scene, replace(settings, seed=settings.seed + 77_777))


class Sibling(Steady):
    """Another name for the code of Steady."""

    name, lineage = "sibling", "steady"


class Spotty(Steady):
    """One sample of its first pixel is NaN; the film counts it as black."""

    name = "spotty"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        add = renderer.film.add

        def spoiled(samples: np.ndarray) -> None:
            if renderer.film.spp == 0:
                samples[0, 0] = np.nan
            add(samples)

        renderer.film.add = spoiled
        return renderer


class Picky(Steady):
    name = "picky"

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return "it never feels like it"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        raise Unsupported("it never feels like it")


class Single(Steady):
    name = "single"

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return "it has float32 alone" if settings.precision == "float64" else None


class Broken(Steady):
    """Fails when it renders with the seed of the second block."""

    name = "broken"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        if settings.seed == 2:
            raise ValueError("the tree fell over\nand more")
        return super().prepare(scene, settings)


class Mended(Broken):
    """Broken until the file that RAYBENCH_TEST_MEND names exists."""

    name = "mended"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        mended = os.path.exists(os.environ.get("RAYBENCH_TEST_MEND", ""))
        return Steady.prepare(self, scene, settings) if mended else super().prepare(scene, settings)


class Crashing(Steady):
    """Dies as native code does."""

    name = "crashing"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        os.kill(os.getpid(), signal.SIGSEGV)


class Hanging(Steady):
    """Delivers two checkpoints and then never ends."""

    name = "hanging"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render = renderer.render

        def slow(spp: int, on_pass: Any = None) -> Film:
            if renderer.film.spp >= 2:
                time.sleep(600)
            return render(spp)

        renderer.render = slow
        return renderer


class Chatty(Steady):
    """Prints to stdout, where the worker's protocol lives, and starts a thread on import, so that no fork is safe."""

    name = "chatty"

    def __init__(self) -> None:
        import threading

        print("hello from an engine")
        threading.Thread(target=time.sleep, args=(3600,), daemon=True).start()


class Burning(Steady):
    """Works half a second for a sample, on a thread of its own that then ends."""

    name = "burning"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render = renderer.render

        def burn(spp: int, on_pass: Any = None) -> Film:
            worker = threading.Thread(target=work, args=(0.5 * spp,))
            worker.start()
            worker.join()
            return render(spp)

        renderer.render = burn
        return renderer


def work(seconds: float) -> None:
    """Uses that much time of a processor, on the thread that calls."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


class Patterned(Steady):
    """Its sampler `stratified` has patterns of 4, 16, 64, ... samples. The image says how many strata there were."""

    name = "patterned"

    def full_pattern(self, sampler: Mapping[str, Any], spp: int) -> FullPattern | None:
        if sampler["name"] != "stratified":
            return None
        size = 4
        while size < spp:
            size *= 4
        return FullPattern(size, {"name": "stratified", "strata": size})

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        if settings.sampler["name"] == "stratified":
            renderer.counters = lambda: {"rays": float(renderer.film.spp), "strata": float(settings.sampler["strata"])}
        return renderer
