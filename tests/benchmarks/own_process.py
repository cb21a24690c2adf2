"""What a process of its own costs an engine: `python -m tests.benchmarks.own_process [--engine numba] [--size N] [--spp N]`.

The same renders by the engine in this process and in another one, with this Python, take turns in mirrored order. The table
gives the geometric mean over rounds of the seconds there over those here, with the 95 % interval of Student's t for the
logarithms: by processor time of both processes, which others disturb least, and by the wall clock. The last line is of calls
that render nothing.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import engines
from engines import registry
from harness.config import paths
from harness.measure.contention import below
from tests.benchmarks.paired import interval

EMPTY = 200


def seconds(renderer: Any, spp: int) -> tuple[float, float]:
    """Wall and processor time of a call."""
    wall, processor = time.perf_counter(), time.process_time() + below()
    renderer.render(spp)
    return time.perf_counter() - wall, time.process_time() + below() - processor


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--engine", default="numba")
    parser.add_argument("--scene", default="cornell_box")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=20)
    given = parser.parse_args()
    scene = engines.load_scene(paths.find("scenes", given.scene))
    settings = engines.Settings(given.size, given.size, sampler="random", seed=3)
    makers = registry.make(registry.place(given.engine)), engines.engine(f"{given.engine}@{registry.THIS}")
    here, there = (maker.prepare(scene, settings) for maker in makers)
    for renderer in (here, there):
        renderer.warm_up()
        renderer.render(given.spp)
    times = {here: [], there: []}
    for _ in range(given.rounds):
        for renderer in (here, there, there, here):
            times[renderer].append(seconds(renderer, given.spp))
    usual = 1e3 * statistics.median(wall for wall, _ in times[here])
    print(f"{given.engine}, {given.size}x{given.size}, {given.spp} spp: {usual:.1f} ms here")
    for which, name in enumerate(("wall", "processor")):
        rows = [[call[which] for call in times[renderer]] for renderer in (there, here)]
        there_twice, here_twice = ([*map(sum, zip(row[::2], row[1::2], strict=True))] for row in rows)
        ratios = [a / b for a, b in zip(there_twice, here_twice, strict=True)]
        low, middle, high = interval(ratios)
        print(f"  {name:9}  there over here {middle:.4f} ({low:.4f} to {high:.4f})")
    empty = sorted(seconds(there, 0)[0] for _ in range(EMPTY))
    print(f"  an empty call: {1e3 * empty[EMPTY // 2]:.3f} ms, nine of ten below {1e3 * empty[EMPTY * 9 // 10]:.3f} ms")


if __name__ == "__main__":
    main()
