"""An engine that works for a known time and clocks itself; as a program, the same passes without any harness.

python busy_engine.py 40      # prints the seconds of 40 passes of one sample a pixel
"""

import sys
from time import perf_counter, process_time

import numpy as np

from engines.film import Film

STEPS = 900
"""Square roots of 20,000 numbers a pass: some 10 ms."""


class Renderer:
    def __init__(self, width, height):
        self.film, self.numbers, self.inside = Film(width, height), np.arange(20_000.0), 0.0
        self.image, self.least = np.full((height, width, 3), 0.5), float("inf")

    def warm_up(self):
        pass

    def render(self, spp, on_pass=None):
        start, worked = perf_counter(), process_time()
        for _ in range(spp):
            for _ in range(STEPS):
                np.sqrt(self.numbers, out=self.numbers)
            self.film.add(self.image)
        self.least = min(self.least, (process_time() - worked) / spp)
        self.inside += perf_counter() - start
        return self.film

    def counters(self):
        return {"rays": 0.0, "inside_seconds": self.inside, "least_cpu_seconds": self.least, "bad_samples": 0.0}


class Busy:
    name, version = "busy", "1"

    def why_not(self, scene, settings):
        return None

    def accelerators(self):
        return {"none": {}}

    def prepare(self, scene, settings):
        return Renderer(*settings.size(scene))


def bare_passes(count):
    """The least processor seconds of `count` passes after one that is discarded."""
    Renderer(16, 12).render(1)
    renderer = Renderer(16, 12)
    for _ in range(count):
        renderer.render(1)
    return renderer.least


if __name__ == "__main__":
    print(bare_passes(int(sys.argv[1])))
