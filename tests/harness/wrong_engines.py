"""Engines that break the contract, each in one way. `WORDS` says what the failed cell of each must say."""

from __future__ import annotations

import copy
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from fake_engines import FakeRenderer, Steady

from engines.film import Film
from engines.interface import Settings
from engines.processes.channel import framed
from engines.scene import Scene

MIB = 1 << 20


class Wrong(Steady):
    """Lets `spoil` change, or replace, what `render` returns."""

    def spoil(self, film: Film) -> Any:
        return film

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        render = renderer.render
        # A copy with arrays of its own: the fake renderer goes on with the film that is right.
        renderer.render = lambda spp, on_pass=None: self.spoil(copy.deepcopy(render(spp)))
        return renderer


class NotANumber(Wrong):
    name = "not_a_number"

    def spoil(self, film: Film) -> Film:
        film.sums[1, 2] = np.nan
        return film


class LateInfinity(Wrong):
    """Is right for three checkpoints."""

    name = "late_infinity"

    def spoil(self, film: Film) -> Film:
        if film.spp >= 8:
            film.sums[1, 2:4, 0] = np.inf
        return film


class TooBright(Wrong):
    """Finite, but not in an image file, and not when it is squared."""

    name = "too_bright"

    def spoil(self, film: Film) -> Film:
        film.sums[1, 2] = 1e200
        return film


class NowAndThen(Wrong):
    """Not finite in the second block alone; its film has counted bad samples, too."""

    name = "now_and_then"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = super().prepare(scene, settings)
        self.second = settings.seed % 2 == 0
        return renderer

    def spoil(self, film: Film) -> Film:
        film.bad_samples = 3
        if self.second:
            film.sums[0, 0, 1] = np.nan
        return film


class OtherSize(Wrong):
    name = "other_size"

    def spoil(self, film: Film) -> Film:
        other = Film(5, 4)
        other.counts += film.spp
        return other


class Objects(Wrong):
    name = "objects"

    def spoil(self, film: Film) -> Film:
        film.sums = film.sums.astype(object)
        return film


class Complex(Wrong):
    name = "complex"

    def spoil(self, film: Film) -> Film:
        film.squares = film.squares.astype(complex)
        return film


class FloatCounts(Wrong):
    name = "float_counts"

    def spoil(self, film: Film) -> Film:
        film.counts = film.counts.astype(float)
        return film


class NegativeCounts(Wrong):
    name = "negative_counts"

    def spoil(self, film: Film) -> Film:
        film.counts = -film.counts
        return film


class SomeMore(Wrong):
    """Renders more samples in one pixel than were asked for."""

    name = "some_more"

    def spoil(self, film: Film) -> Film:
        film.counts[0, 0] += 1
        return film


class BadSamples(Wrong):
    name = "bad_samples"

    def spoil(self, film: Film) -> Film:
        film.bad_samples = -1
        return film


class NoFilm(Wrong):
    name = "no_film"

    def spoil(self, film: Film) -> None:
        return None


class Picture(Wrong):
    """Returns the image itself."""

    name = "picture"

    def spoil(self, film: Film) -> Any:
        return film.mean()


class NoRenderer(Steady):
    name = "no_renderer"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        return None


class NoCounters(Wrong):
    name = "no_counters"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        renderer.counters = lambda: None  # type: ignore[method-assign,return-value]
        return renderer


class EndlessRays(Wrong):
    name = "endless_rays"

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        renderer = FakeRenderer(self, scene, settings)
        renderer.counters = lambda: {"rays": float("nan")}  # type: ignore[method-assign]
        return renderer


class Quitter(Wrong):
    name = "quitter"

    def spoil(self, film: Film) -> Film:
        sys.exit("the licence has expired")


class Unreadable(Wrong):
    """Raises an exception that cannot say what it is."""

    name = "unreadable"

    def spoil(self, film: Film) -> Film:
        class Mute(Exception):
            def __str__(self) -> str:
                raise RuntimeError

        raise Mute


class Surrogate(Wrong):
    """Raises an exception whose text is no UTF-8."""

    name = "surrogate"

    def spoil(self, film: Film) -> Film:
        raise ValueError("no file caf\udce9.obj")


def write_everywhere(data: bytes) -> None:
    """Writes into every pipe and socket that this process has open."""
    for handle in range(3, 64):
        try:
            written = 0
            while written < len(data):
                written += os.write(handle, data[written : written + MIB])
        except OSError:
            continue


class Babbler(Wrong):
    """Writes text where the worker's messages go."""

    name = "babbler"

    def spoil(self, film: Film) -> Film:
        write_everywhere(b"pass 1 of 4\n")
        time.sleep(600)
        return film


class Flooder(Wrong):
    """Writes more than a message may hold, without an end."""

    name = "flooder"

    def spoil(self, film: Film) -> Film:
        write_everywhere(framed(b"x" * (17 * MIB)))
        time.sleep(600)
        return film


class Liar(Wrong):
    """Sends a message of its own making."""

    name = "liar"

    def spoil(self, film: Film) -> Film:
        write_everywhere(framed(b'{"type": "point", "spp": -3, "seconds": NaN}'))
        time.sleep(600)
        return film


class Forger(Wrong):
    """Says that the disk is full, which is no failure of an engine."""

    name = "forger"

    def spoil(self, film: Film) -> Film:
        write_everywhere(framed(b'{"type": "unwritten", "message": "the disk\\nis full"}'))
        time.sleep(600)
        return film


class Closer(Wrong):
    """Closes all files, those of others, too."""

    name = "closer"

    def spoil(self, film: Film) -> Film:
        os.closerange(3, 64)
        return film


class Unsure(Steady):
    """Fails when it is asked what it can do; can do it all the same."""

    name = "unsure"

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        raise ZeroDivisionError("no tree")


class Talkative(Steady):
    """Answers with something that is no sentence."""

    name = "talkative"

    def why_not(self, scene: Scene, settings: Settings) -> Any:
        return True


class Hungry(Wrong):
    """Takes 16 MiB at a time, 1.5 GiB in all, and then never ends."""

    name = "hungry"

    def spoil(self, film: Film) -> Film:
        held = []
        for _ in range(96):
            held.append(np.ones(16 * MIB, np.uint8))
            time.sleep(0.002)
        time.sleep(600)
        return film


class HungryChild(Wrong):
    """Has another process take memory, in a session of its own, which writes its id into a file that
    RAYBENCH_TEST_CHILD names."""

    name = "hungry_child"

    def spoil(self, film: Film) -> Film:
        code = (
            "import os, sys, time; open(sys.argv[1], 'w').write(str(os.getpid()))\n"
            "held = [bytearray(b'x') * (16 << 20) for _ in range(96) if not time.sleep(0.002)]; time.sleep(600)"
        )
        words = [sys.executable, "-c", code, os.environ["RAYBENCH_TEST_CHILD"]]
        subprocess.run(words, start_new_session=True, check=False)
        return film


PIXELS = "of the engine's image at"
WORDS: Mapping[str, str] = {
    "NotANumber": f"1 of 96 pixels {PIXELS} 1 spp are not finite",
    "LateInfinity": f"2 of 96 pixels {PIXELS} 8 spp are not finite",
    "TooBright": f"1 of 96 pixels {PIXELS} 1 spp are not finite",
    "OtherSize": "film.sums is of shape (4, 5, 3): (8, 12, 3) is expected",
    "Objects": "film.sums is of dtype object: floating-point numbers are expected",
    "Complex": "film.squares is of dtype complex128: floating-point numbers are expected",
    "FloatCounts": "film.counts is of dtype float64: integers are expected",
    "NegativeCounts": "film.counts are -1: 1 is expected, the samples requested",
    "SomeMore": "film.counts are 1 to 2: 1 is expected",
    "BadSamples": "film.bad_samples is -1: an integer from 0 on is expected",
    "NoFilm": "render returned NoneType, which lacks sums, squares, even_sums, counts, bad_samples: a Film is expected",
    "Picture": "render returned ndarray, which lacks sums",
    "NoRenderer": "prepare returned NoneType, which lacks warm_up, render, counters: a Renderer is expected",
    "NoCounters": "counters returned NoneType: a mapping to numbers is expected",
    "EndlessRays": "counters have rays = nan: a finite number from 0 on is expected",
    "Quitter": "SystemExit: the licence has expired",
    "Unreadable": "Mute: (its message cannot be read)",
    "Surrogate": "ValueError: no file caf?.obj",
    "Babbler": "it wrote 'pass 1 of 4' where messages are sent",
    "Flooder": "it sent a message of more than 16 MiB: 'xxx",
    "Liar": "its message 'point' has spp = -3: an integer above 0 is expected",
    "Forger": "its film could not be written there, though this process can: the disk is full",
    "Closer": "the engine's process ended with status",
}
