"""Paths per second of our engines and of Mitsuba here: `make speed`, or `python -m tests.benchmarks.speed [SCENE...]`.

SCENE is a name, a YAML file, or an XML file of Mitsuba's, which Mitsuba takes as it is. All render with a path tracer of the
same depth without roulette, with independent random numbers, in float32. Mitsuba is timed by its own render call, warm.
The contestants take turns in one process, in mirrored order; a round is one turn of each and one back. The table gives the
median rate, and the geometric mean over rounds of our paths/s over those of Mitsuba with the same intersection flags, of numba,
which is watertight, over those of Mitsuba with either, with the 95 % interval of Student's t for the logarithms: by processor
time of the process, which other processes disturb least, and by the wall clock.
"""

from __future__ import annotations

import argparse
import math
import shlex
import statistics
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import engines
from harness.config import paths
from tests.benchmarks.adapter_overhead import Seconds, mitsuba_native, seconds_of
from tests.benchmarks.paired import interval, show_processor

SCENES = ("cornell_box", "cornell_mesh", "two_spheres", "living_room")
PEER = "mitsuba"
ROBUST, FAST = ({"name": "embree", "robust": robust} for robust in (True, False))


class Contestant(NamedTuple):
    """`versus`: the labels of the contestants that it is held against."""

    label: str
    engine: str
    accelerator: Any
    versus: tuple[str, ...] = ()


CONTESTANTS = (
    Contestant("numba auto", "numba", "auto", ("mitsuba robust", "mitsuba fast")),
    Contestant("numba bvh", "numba", "bvh", ("mitsuba robust", "mitsuba fast")),
    Contestant("embree robust", "embree", ROBUST, ("mitsuba robust",)),
    Contestant("embree fast", "embree", FAST, ("mitsuba fast",)),
    Contestant("mitsuba robust", PEER, ROBUST),
    Contestant("mitsuba fast", PEER, FAST),
)

Call = Callable[[int], float]
"""Renders so many samples per pixel, and returns their number."""


def prepared(contestant: Contestant, scene: engines.Scene, size: tuple[int, int], threads: int = 2, depth: int = 6) -> Any:
    """A warm renderer. Raises `Unsupported`."""
    settings = engines.Settings(
        *size,
        sampler="random",
        threads=threads,
        precision="float32",
        accelerator=contestant.accelerator,
        shader={"name": "path_tracer", "max_depth": depth, "rr_depth": 1_000_000},
    )
    engine = engines.engine(contestant.engine)
    if reason := engine.why_not(scene, settings):
        raise engines.Unsupported(reason)
    renderer = engine.prepare(scene, settings)
    renderer.warm_up()
    return renderer


def call_of(contestant: Contestant, *where: Any) -> Call:
    renderer = prepared(contestant, *where)

    def render(spp: int) -> float:
        renderer.render(spp)
        return spp

    return mitsuba_native(renderer) if contestant.engine == PEER else render


def measured(calls: dict[str, Call], rounds: int, seconds: float) -> dict[str, list[Seconds]]:
    """Of each contestant, seconds per sample per pixel, round by round; a turn takes about `seconds` seconds."""
    samples: dict[str, int] = {}
    for label, call in calls.items():
        call(2)
        samples[label] = max(1, round(seconds / (seconds_of(lambda call=call: call(2), 2).wall / 2)))
        call(samples[label])
    found: dict[str, list[Seconds]] = {label: [] for label in calls}
    for number in range(rounds):
        order = list(calls)[:: -1 if number % 2 else 1]
        taken: dict[str, list[Seconds]] = {label: [] for label in calls}
        for label in (*order, *order[::-1]):
            spp = samples[label]
            taken[label].append(seconds_of(lambda label=label, spp=spp: calls[label](spp), spp))
        for label, turns in taken.items():
            found[label].append(Seconds(*(sum(clock) / 2 / samples[label] for clock in zip(*turns, strict=True))))
    return found


def show(found: dict[str, list[Seconds]], pixels: int, contestants: list[Contestant]) -> None:
    for clock in Seconds._fields:
        seconds = {label: [getattr(one, clock) for one in rounds] for label, rounds in found.items()}
        for contestant in contestants:
            own = seconds.get(contestant.label)
            if own is None:
                continue
            print(f"  {contestant.label:16}{clock:11}{pixels / statistics.median(own) / 1e6:9.3f}", flush=True)
            for label in contestant.versus:
                if peer := seconds.get(label):
                    mean, low, high = interval([theirs / mine for mine, theirs in zip(own, peer, strict=True)])
                    print(f"{'':38}{mean:12.3f}   {low:.3f} to {high:.3f}  ({label})", flush=True)


def size_of(scene: engines.Scene, pixels: int) -> tuple[int, int]:
    """About so many pixels, in the proportions of the scene's camera."""
    width, height = scene.camera.resolution
    columns = round(math.sqrt(pixels * width / height))
    return columns, round(pixels / columns)


def compare(name: str, given: argparse.Namespace, contestants: list[Contestant]) -> None:
    natively = any(contestant.engine == PEER for contestant in contestants)
    scene = engines.load_scene(paths.find("scenes", name), natively=natively)
    size, calls = size_of(scene, given.pixels), {}
    print(f"{name}: {size[0]} x {size[1]}, depth {given.depth}, {given.threads} threads, {given.rounds} rounds")
    for contestant in contestants:
        try:
            calls[contestant.label] = call_of(contestant, scene, size, given.threads, given.depth)
        except engines.RaybenchError as problem:
            print(f"  {contestant.label}: {problem}")
    show(measured(calls, given.rounds, given.seconds), size[0] * size[1], contestants)


def main() -> None:
    labels = [contestant.label for contestant in CONTESTANTS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), metavar="SCENE", help="names or files")
    parser.add_argument("--contestants", nargs="+", choices=labels, default=labels, metavar="LABEL", help=", ".join(labels))
    parser.add_argument("--pixels", type=int, default=1 << 18, help="of an image")
    parser.add_argument("--depth", type=int, default=6)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=6, help="2 or more")
    parser.add_argument("--seconds", type=float, default=0.5, help="of a turn")
    given = parser.parse_args()
    if given.rounds < 2:
        parser.error("--rounds: 2 or more are expected")
    show_processor()
    print(shlex.join(["python", "-m", "tests.benchmarks.speed", *sys.argv[1:]]))
    print(f"  {'':16}{'clock':11}{'million paths/s':>9}{'over Mitsuba':>14}   95 % interval")
    for name in given.scenes:
        compare(name, given, [contestant for contestant in CONTESTANTS if contestant.label in given.contestants])


if __name__ == "__main__":
    main()
