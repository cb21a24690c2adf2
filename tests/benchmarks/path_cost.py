"""What a path costs, by its greatest depth: `python -m tests.benchmarks.path_cost [--scenes NAME...] [--depths N...]`.

The path tracer without roulette, independent random numbers, float32; Mitsuba is timed by its own render call, on the
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
from tests.benchmarks.speed import CONTESTANTS, call_of, measured, size_of

SCENES, DEPTHS, LABELS = ("cornell_box", "two_spheres"), (1, 2, 6), ("numba auto", "mitsuba robust")
PIXELS = 1 << 18


class Row(NamedTuple):
    """A contestant's cost of a path to a greatest depth."""

    scene: str
    contestant: str
    depth: int
    nanoseconds: float
    """Of processor time a path."""
    ratio: tuple[float, float, float] | None
    """The cost of Mitsuba with the same intersection flags over this one, and its interval; None of Mitsuba itself."""


def rows(
    scenes: Sequence[str] = SCENES,
    depths: Sequence[int] = DEPTHS,
    labels: Sequence[str] = LABELS,
    rounds: int = 4,
    seconds: float = 0.5,
    pixels: int = PIXELS,
    threads: int = 1,
) -> Iterator[Row]:
    """The table, row by row. A turn takes about `seconds` seconds."""
    contestants = [contestant for contestant in CONTESTANTS if contestant.label in labels]
    for name in scenes:
        scene = engines.load_scene(paths.find("scenes", name), natively="mitsuba" in {c.engine for c in contestants})
        width, height = size_of(scene, pixels)
        for depth in depths:
            calls = {one.label: call_of(one, scene, (width, height), threads, depth) for one in contestants}
            found = measured(calls, rounds, seconds)
            costs = {label: [one.processor / (width * height) * 1e9 for one in taken] for label, taken in found.items()}
            for contestant in contestants:
                own, peer = costs[contestant.label], costs.get(contestant.versus)
                ratio = interval([theirs / mine for mine, theirs in zip(own, peer, strict=True)]) if peer else None
                yield Row(name, contestant.label, depth, statistics.median(own), ratio)


def line(row: Row) -> str:
    """A row of the printed table."""
    text = f"{row.scene:14}{row.contestant:16}{row.depth:6}{row.nanoseconds:12.1f}"
    if row.ratio:
        mean, low, high = row.ratio
        text += f"{mean:14.2f}   {low:.2f} to {high:.2f}"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=SCENES, metavar="NAME")
    parser.add_argument("--depths", nargs="+", type=int, default=DEPTHS, metavar="N")
    labels = [contestant.label for contestant in CONTESTANTS]
    parser.add_argument("--contestants", nargs="+", choices=labels, default=LABELS, metavar="LABEL", help=", ".join(labels))
    parser.add_argument("--pixels", type=int, default=PIXELS, help="of an image")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=4, help="2 or more")
    parser.add_argument("--seconds", type=float, default=0.5, help="of a turn")
    given = parser.parse_args()
    if given.rounds < 2:
        parser.error("--rounds: 2 or more are expected")
    show_processor()
    print(shlex.join(["python", "-m", "tests.benchmarks.path_cost", *sys.argv[1:]]))
    print(f"{'scene':14}{'contestant':16}{'depth':>6}{'ns per path':>12}{'over Mitsuba':>14}   95 % interval")
    for row in rows(given.scenes, given.depths, given.contestants, given.rounds, given.seconds, given.pixels, given.threads):
        print(line(row), flush=True)


if __name__ == "__main__":
    main()
