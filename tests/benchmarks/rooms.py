"""Our engines against Mitsuba on furnished rooms: `python -m tests.benchmarks.rooms SCENE... [--rounds N] [--threads N]`.

SCENE is a name, a YAML file or an XML file of Mitsuba's, which Mitsuba takes as it is. All render with a path tracer of the
same depth without roulette, with independent random numbers, in float32, robust. Mitsuba is timed by its own render call.
The contestants take turns in one process, in mirrored order; a round is one turn of each and one back. The table gives the
median rate, and the geometric mean over rounds of our paths/s over Mitsuba's, with the 95 % interval of Student's t for the
logarithms: by processor time of the process, which other processes disturb least, and by the wall clock.
"""

from __future__ import annotations

import argparse
import shlex
import statistics
import sys
from collections.abc import Callable
from typing import Any

import engines
from harness.config import paths
from tests.benchmarks.adapter_overhead import Seconds, mitsuba_native, seconds_of
from tests.benchmarks.paired import interval, show_processor

PEER = "mitsuba"
ROBUST = {"name": "embree", "robust": True}
ACCELERATORS = {"numba": "auto", "embree": ROBUST, PEER: ROBUST}

Call = Callable[[int], float]
"""Renders so many samples per pixel, and returns their number."""


def prepared(name: str, scene: engines.Scene, given: argparse.Namespace) -> Call:
    """A contestant, warm."""
    settings = engines.Settings(
        *given.size, sampler="random", threads=given.threads, precision="float32", accelerator=ACCELERATORS[name],
        shader={"name": "path_tracer", "max_depth": given.depth, "rr_depth": 1_000_000},
    )  # fmt: skip
    engine = engines.engine(name)
    if reason := engine.why_not(scene, settings):
        raise engines.Unsupported(reason)
    renderer: Any = engine.prepare(scene, settings)
    renderer.warm_up()

    def render(spp: int) -> float:
        renderer.render(spp)
        return spp

    return mitsuba_native(renderer) if name == PEER else render


def measured(calls: dict[str, Call], spp: int, rounds: int) -> dict[str, list[Seconds]]:
    """Of each contestant, seconds a sample per pixel, round by round."""
    for call in calls.values():
        call(spp)
    found: dict[str, list[Seconds]] = {name: [] for name in calls}
    for number in range(rounds):
        order = list(calls)[:: -1 if number % 2 else 1]
        taken: dict[str, list[Seconds]] = {name: [] for name in calls}
        for name in (*order, *order[::-1]):
            taken[name].append(seconds_of(lambda name=name: calls[name](spp), spp))
        for name, turns in taken.items():
            clocks = zip(*turns, strict=True)
            found[name].append(Seconds(*(sum(clock) / 2 / spp for clock in clocks)))
    return found


def show(found: dict[str, list[Seconds]], pixels: int) -> None:
    for clock in Seconds._fields:
        seconds = {name: [getattr(one, clock) for one in rounds] for name, rounds in found.items()}
        for name, own in seconds.items():
            line = f"  {name:10}{clock:11}{pixels / statistics.median(own) / 1e6:9.3f}"
            if name != PEER and PEER in seconds:
                ratios = [peer / mine for mine, peer in zip(own, seconds[PEER], strict=True)]
                mean, low, high = interval(ratios)
                line += f"{mean:14.3f}   {low:.3f} to {high:.3f}"
            print(line, flush=True)


def compare(name: str, given: argparse.Namespace) -> None:
    scene = engines.load_scene(paths.find("scenes", name), natively=PEER in given.engines)
    calls: dict[str, Call] = {}
    for engine in given.engines:
        try:
            calls[engine] = prepared(engine, scene, given)
        except engines.RaybenchError as problem:
            print(f"  {engine}: {problem}")
    width, height = given.size
    print(
        f"{name}: {width} x {height}, {given.spp} spp, depth {given.depth}, {given.threads} threads, {given.rounds} rounds"
    )
    show(measured(calls, given.spp, given.rounds), width * height)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["living_room"], metavar="SCENE")
    parser.add_argument("--engines", nargs="+", choices=ACCELERATORS, default=list(ACCELERATORS), metavar="NAME")
    parser.add_argument("--size", nargs=2, type=int, default=[384, 216], metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--depth", type=int, default=6)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=6, help="2 or more")
    parser.add_argument("--spp", type=int, default=16, help="of a turn")
    given = parser.parse_args()
    if given.rounds < 2:
        parser.error("--rounds: 2 or more are wanted")
    show_processor()
    print(shlex.join(["python", "-m", "tests.benchmarks.rooms", *sys.argv[1:]]))
    print(f"  {'':10}{'clock':11}{'million paths/s':>9}{'over Mitsuba':>14}   95 % interval")
    for name in given.scenes:
        compare(name, given)


if __name__ == "__main__":
    main()
