"""Paths a second of our engines over Mitsuba's, from one run: `python tests/benchmarks/peers.py [SCENE...] [--seconds 0.4]`.

Every contestant renders the same scene at the same depth, without roulette, with independent random numbers, in float32.
They take turns, and each ratio is the median over the turns, with the least and the largest beside it.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any, NamedTuple

import engines
from harness.config import paths

SCENES = ("cornell_box", "cornell_mesh", "two_spheres")
SHADER = {"name": "path_tracer", "max_depth": 6, "rr_depth": 1000}


class Contestant(NamedTuple):
    """`versus`: the label of the contestant that it is held against, if any."""

    label: str
    engine: str
    accelerator: Any
    versus: str = ""


CONTESTANTS = (
    Contestant("numba list", "numba", "none", "mitsuba robust"),
    Contestant("numba auto", "numba", "auto", "mitsuba robust"),
    Contestant("numba bvh", "numba", "bvh", "mitsuba robust"),
    Contestant("embree robust", "embree", {"name": "embree", "robust": True}, "mitsuba robust"),
    Contestant("embree fast", "embree", {"name": "embree", "robust": False}, "mitsuba fast"),
    Contestant("mitsuba robust", "mitsuba", {"name": "embree", "robust": True}),
    Contestant("mitsuba fast", "mitsuba", {"name": "embree", "robust": False}),
)
LIST_LIMIT = 200
"""Above so many triangles the list does not run."""


def prepared(contestant: Contestant, scene: engines.Scene, size: tuple[int, int], threads: int) -> Any:
    """A warm renderer, or None where the contestant cannot or should not take the scene."""
    if (
        contestant.accelerator == "none"
        and sum(len(getattr(shape, "faces", ())) for shape in scene.shapes) > LIST_LIMIT
    ):
        return None
    settings = engines.Settings(
        *size, shader=SHADER, sampler="random", accelerator=contestant.accelerator, threads=threads, precision="float32"
    )
    engine = engines.engine(contestant.engine)
    if reason := engine.why_not(scene, settings):
        print(f"  {contestant.label}: {reason}")
        return None
    renderer = engine.prepare(scene, settings)
    renderer.warm_up()
    return renderer


def seconds_of(renderer: Any, spp: int) -> float:
    start = time.perf_counter()
    renderer.render(spp)
    return time.perf_counter() - start


def rates(
    scene: engines.Scene, size: tuple[int, int], threads: int, turns: int, seconds: float
) -> dict[str, list[float]]:
    """Paths a second of each contestant, turn by turn; a turn takes about `seconds` seconds."""
    found = {c.label: prepared(c, scene, size, threads) for c in CONTESTANTS}
    found = {label: renderer for label, renderer in found.items() if renderer is not None}
    samples = {}
    for label, renderer in found.items():
        seconds_of(renderer, 1)
        samples[label] = max(1, round(seconds / (seconds_of(renderer, 2) / 2)))
    measured: dict[str, list[float]] = {label: [] for label in found}
    for turn in range(turns):
        for label in list(found)[:: 1 if turn % 2 else -1]:
            paths = samples[label] * size[0] * size[1]
            measured[label].append(paths / seconds_of(found[label], samples[label]))
    return measured


def show(name: str, measured: dict[str, list[float]]) -> None:
    print(f"{name}\n  {'':16}{'million paths/s':>16}{'over Mitsuba':>14}   least to largest")
    for contestant in CONTESTANTS:
        own, other = measured.get(contestant.label), measured.get(contestant.versus)
        if own is None:
            continue
        line = f"  {contestant.label:16}{statistics.median(own) / 1e6:16.2f}"
        if other:
            ratios = [a / b for a, b in zip(own, other, strict=True)]
            line += f"{statistics.median(ratios):14.2f}   {min(ratios):.2f} to {max(ratios):.2f}  ({contestant.versus})"
        print(line, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help="names or paths")
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=0.4, help="of a turn")
    given = parser.parse_args()
    for name in given.scenes:
        scene = engines.load_scene(paths.find("scenes", name))
        show(name, rates(scene, (given.size, given.size), given.threads, given.turns, given.seconds))


if __name__ == "__main__":
    main()
