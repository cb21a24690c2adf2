"""An engine that works for a known time and clocks itself; as a program, the same passes without any harness.

python busy_engine.py 40      # prints the seconds of 40 passes of one sample a pixel
"""

import json
import sys
from time import perf_counter

import numpy as np

from engines.film import Film

STEPS = 900
"""Square roots of 20,000 numbers a pass: some 10 ms."""


class Renderer:
    def __init__(self, width, height):
        self.film, self.numbers, self.inside = Film(width, height), np.arange(20_000.0), 0.0
        self.image = np.full((height, width, 3), 0.5)

    def warm_up(self):
        pass

    def render(self, spp, on_pass=None):
        start = perf_counter()
        for _ in range(spp):
            for _ in range(STEPS):
                np.sqrt(self.numbers, out=self.numbers)
            self.film.add(self.image)
        self.inside += perf_counter() - start
        return self.film

    def counters(self):
        return {"rays": 0.0, "inside_seconds": self.inside, "bad_samples": 0.0}


class Busy:
    name, version = "busy", "1"

    def why_not(self, scene, settings):
        return None

    def accelerators(self):
        return {"none": {}}

    def prepare(self, scene, settings):
        return Renderer(*settings.size(scene))


def bare_passes(count):
    """Seconds of each of `count` passes after one that is discarded."""
    renderer, seconds = Renderer(16, 12), []
    renderer.render(1)
    for _ in range(count):
        start = perf_counter()
        renderer.render(1)
        seconds.append(perf_counter() - start)
    return seconds


if __name__ == "__main__":
    print(json.dumps(bare_passes(int(sys.argv[1]))))
