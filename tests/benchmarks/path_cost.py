"""What a path costs, by its greatest depth: `python -m tests.benchmarks.path_cost [--scenes NAME...] [--depths N...]`.

The path tracer without roulette, independent random numbers, float32, robust; Mitsuba is timed by its own render call, on the
same loaded scene. The contestants take turns in one process, in mirrored order. A cost is processor time over paths begun, so
the number of threads divides out: the median over rounds, in nanoseconds. The ratio is the geometric mean over rounds of
Mitsuba's cost over ours, with the 95 % interval of Student's t for the logarithms. At depth 1 a path is a camera ray: what it
begins with, its first hit, and how it enters the film. What deeper paths cost more is scattering, light samples and shadow
rays.
"""

from __future__ import annotations

import argparse
import shlex
import statistics
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import engines
from harness.config import paths
from tests.benchmarks.paired import interval, show_processor
from tests.benchmarks.rooms import ACCELERATORS, PEER, measured, prepared

SCENES, DEPTHS = ("cornell_box", "two_spheres"), (1, 2, 6)
SIZE = 384, 216


class Row(NamedTuple):
    """An engine's cost of a path to a greatest depth."""

    scene: str
    engine: str
    depth: int
    nanoseconds: float
    """Of processor time a path."""
    ratio: tuple[float, float, float] | None
    """Mitsuba's cost over this one, and its interval; None of Mitsuba itself, and where it did not run."""


def rows(
    scenes: Sequence[str] = SCENES, depths: Sequence[int] = DEPTHS, names: Sequence[str] = ("numba", PEER), rounds: int = 4,
    seconds: float = 0.5, size: tuple[int, int] = SIZE, threads: int = 1,
) -> Iterator[Row]:  # fmt: skip
    """The table, row by row. A turn is of as many samples as the first engine takes in about `seconds`."""
    pixels = size[0] * size[1]
    for name in scenes:
        scene = engines.load_scene(paths.find("scenes", name), natively=PEER in names)
        for depth in depths:
            given = argparse.Namespace(size=size, threads=threads, depth=depth)
            calls = {engine: prepared(engine, scene, given) for engine in names}
            spp = 8
            trial = measured({names[0]: calls[names[0]]}, spp, 1)[names[0]][0].processor
            found = measured(calls, max(4, 4 * round(seconds / trial / 4)), rounds)
            costs = {engine: [one.processor / pixels * 1e9 for one in taken] for engine, taken in found.items()}
            for engine, own in costs.items():
                ratio = None
                if engine != PEER and PEER in costs:
                    ratio = interval([theirs / mine for mine, theirs in zip(own, costs[PEER], strict=True)])
                yield Row(name, engine, depth, statistics.median(own), ratio)


def line(row: Row) -> str:
    """A row of the printed table."""
    text = f"{row.scene:14}{row.engine:10}{row.depth:6}{row.nanoseconds:10.1f}"
    if row.ratio:
        mean, low, high = row.ratio
        text += f"{mean:14.2f}   {low:.2f} to {high:.2f}"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=SCENES, metavar="NAME")
    parser.add_argument("--depths", nargs="+", type=int, default=DEPTHS, metavar="N")
    parser.add_argument("--engines", nargs="+", choices=ACCELERATORS, default=["numba", PEER], metavar="NAME")
    parser.add_argument("--size", nargs=2, type=int, default=SIZE, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=4, help="2 or more")
    parser.add_argument("--seconds", type=float, default=0.5, help="of a turn")
    given = parser.parse_args()
    if given.rounds < 2:
        parser.error("--rounds: 2 or more are wanted")
    show_processor()
    print(shlex.join(["python", "-m", "tests.benchmarks.path_cost", *sys.argv[1:]]))
    print(f"{'scene':14}{'engine':10}{'depth':>6}{'ns a path':>10}{'over Mitsuba':>14}   95 % interval")
    for row in rows(
        given.scenes, given.depths, given.engines, given.rounds, given.seconds, tuple(given.size), given.threads
    ):
        print(line(row), flush=True)


if __name__ == "__main__":
    main()
