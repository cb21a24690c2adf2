"""numba's list against its tree in small scenes: `python -m tests.benchmarks.list_or_tree [--rounds N] [--precisions ...]`.

Scenes of random triangles, spheres and disks of several counts are traced with either accelerator: camera rays, rays
between random points, and shadow rays between random points. Both take turns in one process; a figure is the least
processor time over the rounds, in nanoseconds per ray, the mean of the three kinds of rays. Printed are these figures, the
constants of the cost model (`engines.numba_cpu.accel.choice`) fitted to them, and at which counts both cost the same. Then
the project's scenes of up to `--most` primitives are rendered with either one, and the choice of `auto` is compared with
what is faster there.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

import engines
from engines.numba_cpu.accel.choice import COSTS, Costs, Counts, counts_of, predicted
from harness.config import paths
from tests.benchmarks.paired import show_processor

TRIANGLES = (4, 8, 16, 32, 64, 96, 128, 192, 256, 384, 500)
FEWER = (2, 4, 8, 16, 32, 64)
COUNTS = (
    *(Counts(n, 0, 0) for n in TRIANGLES),
    *(Counts(0, n, 0) for n in FEWER),
    *(Counts(0, 0, n) for n in FEWER),
    *(Counts(n, n // 4, 0) for n in (8, 32, 96, 192)),
    *(Counts(n, n // 4, n // 4) for n in (8, 32, 96)),
)
RAYS = 1 << 15
NAMES = ("none", "bvh")


class Row(NamedTuple):
    """What a ray costs in a scene of these counts with the list and with the tree, nanoseconds."""

    counts: Counts
    list_ns: float
    tree_ns: float


def random_scene(counts: Counts, rng: np.random.Generator) -> engines.Scene:
    """Shapes in the unit cube, the smaller the more there are."""
    size = (counts.triangles + counts.spheres + counts.analytic) ** (-1 / 3)
    shapes: list[dict[str, Any]] = []
    for _ in range(counts.triangles):
        corners = rng.random(3) + rng.normal(size=(3, 3)) * 0.5 * size
        shapes.append({"triangle": dict(zip("abc", corners.tolist(), strict=True))})
    shapes += [{"sphere": {"center": each.tolist(), "radius": 0.35 * size}} for each in rng.random((counts.spheres, 3))]
    for center, normal in zip(rng.random((counts.analytic, 3)), rng.normal(size=(counts.analytic, 3)), strict=True):
        shapes.append({"disk": {"center": center.tolist(), "normal": normal.tolist(), "radius": 0.5 * size}})
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {
                "type": "perspective",
                "eye": [0.5, 0.5, 3],
                "target": [0.5, 0.5, 0.5],
                "up": [0, 1, 0],
                "fov": 30,
                "resolution": [64, 64],
            },
            "materials": {"white": {"kd": 0.5}},
            "shapes": [{**shape, "material": "white"} for shape in shapes],
            "lights": [{"environment": {"radiance": 1}}],
        }
    )


def rays(rng: np.random.Generator) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Camera rays, row by row, and rays from random points of the cube to others, of which t = 1 is the end."""
    side = int(RAYS**0.5)
    x, y = np.meshgrid(np.linspace(-0.25, 0.25, side), np.linspace(0.25, -0.25, side))
    way = np.stack([x.ravel(), y.ravel(), np.full(side * side, -1.0)], axis=1)
    start, end = rng.random((2, side * side, 3))
    return (np.tile([0.5, 0.5, 3.0], (side * side, 1)), way), (start, end - start)


def least_seconds(calls: Sequence[Callable[[], Any]], rounds: int) -> list[float]:
    """The least processor time of each call over rounds of turns."""
    least = [float("inf")] * len(calls)
    for turn in range(rounds + 1):
        for k in range(len(calls))[:: 1 if turn % 2 else -1]:
            since = time.process_time()
            calls[k]()
            taken = time.process_time() - since
            least[k] = min(least[k], taken) if turn else least[k]
    return least


def measured(counts: Counts, precision: str, rounds: int) -> Row:
    rng = np.random.default_rng(1)
    scene, (camera, between) = random_scene(counts, rng), rays(rng)
    calls: list[Callable[[], Any]] = []
    for name in NAMES:
        renderer: Any = engines.engine("numba").prepare(scene, engines.Settings(accelerator=name, precision=precision))
        calls += [
            lambda renderer=renderer: renderer.trace(*camera),
            lambda renderer=renderer: renderer.trace(*between),
            lambda renderer=renderer: renderer.occluded(*between, 1.0),
        ]
    seconds = least_seconds(calls, rounds)
    each = [sum(seconds[3 * k : 3 * k + 3]) / 3 / len(camera[0]) * 1e9 for k in range(2)]
    return Row(counts, *each)


def fitted(rows: Iterable[Row]) -> Costs:
    """Least squares of relative errors. What an empty list costs is left out of both sides, as the two have it in common."""
    rows = list(rows)
    n = np.array([row.counts for row in rows], float)
    depth = np.log2(n.sum(axis=1))
    lists, trees = (np.array([row[k] for row in rows]) for k in (1, 2))

    def solved(columns: Any, wanted: Any, weight: Any) -> Any:
        return np.linalg.lstsq(columns * weight[:, None], wanted * weight, rcond=None)[0]

    one = np.ones(len(rows))
    empty, *each = solved(np.column_stack([one, n]), lists, 1 / lists)
    share = n / n.sum(axis=1, keepdims=True)
    several = (n > 0).sum(axis=1) > 1
    columns = [one, depth, depth * share[:, 1], depth * share[:, 2], depth * several]
    tree = solved(np.column_stack(columns), trees - empty, 1 / trees)
    return Costs(*(float(round(x, 2)) for x in (*each, *tree)))


def crossing(costs: Costs, kind: int) -> float:
    """The number of primitives of one kind at which list and tree are predicted to cost the same."""
    counts = [Counts(*(n if k == kind else 0 for k in range(3))) for n in range(1, 5000)]
    return next((sum(one) for one in counts if (both := predicted(one, costs))[0] > both[1]), math.inf)


class Tally:
    """Prints rows of measured and predicted costs, and counts how often the rule takes the faster accelerator."""

    def __init__(self, costs: Costs) -> None:
        self._costs, self._right, self._ratios = costs, 0, []

    def add(self, name: str, counts: Counts, list_ns: float, tree_ns: float) -> None:
        of_list, of_tree = predicted(counts, self._costs)
        chosen = list_ns if of_list <= of_tree else tree_ns
        loss = chosen / min(list_ns, tree_ns)
        self._ratios.append(loss)
        figures = f"{list_ns:9.1f}{tree_ns:9.1f}{list_ns / tree_ns:8.2f}{of_list:10.1f}{of_tree:8.1f}"
        print(f"{name:44}{figures}   {'' if loss == 1 else f'slower: {loss:.2f}'}", flush=True)

    def close(self) -> None:
        right, worst = sum(loss == 1 for loss in self._ratios), max(self._ratios, default=1)
        count = len(self._ratios)
        print(f"the rule takes the faster one in {right} of {count}; elsewhere it loses up to {worst:.2f}\n")


HEADER = f"{'':44}{'list':>9}{'tree':>9}{'ratio':>8}{'predicted':>10}{'':8}"


def synthetic(precision: str, rounds: int) -> None:
    rows = [measured(counts, precision, rounds) for counts in COUNTS]
    print(f"{precision}: nanoseconds per ray\n{HEADER}")
    tally = Tally(COSTS[precision])
    for row in rows:
        named = [f"{n} {kind}" for n, kind in zip(row.counts, Counts._fields, strict=True) if n]
        tally.add(", ".join(named), row.counts, row.list_ns, row.tree_ns)
    tally.close()
    for name, costs in (("in use", COSTS[precision]), ("fitted here", fitted(rows))):
        at = ", ".join(f"{crossing(costs, k):.0f} {kind}" for k, kind in enumerate(Counts._fields))
        print(f"{name}: {costs}\n  list and tree cost the same at {at}")


def of_project(precision: str, rounds: int, most: int) -> None:
    """Renders of the project's scenes, nanoseconds per path."""
    print(f"\n{precision}: nanoseconds per path of depth 6, scenes of up to {most} primitives\n{HEADER}")
    tally = Tally(COSTS[precision])
    for name, file in paths.shipped("scenes").items():
        scene = engines.load_scene(file)
        counts = counts_of(scene)
        if not 0 < sum(counts) <= most:
            continue
        calls = []
        for accelerator in NAMES:
            settings = engines.Settings(
                128,
                128,
                accelerator=accelerator,
                precision=precision,
                sampler="random",
                shader={"name": "path_tracer", "max_depth": 6, "rr_depth": 1000},
            )
            renderer: Any = engines.engine("numba").prepare(scene, settings)
            calls.append(lambda renderer=renderer: renderer.render(4))
        seconds = least_seconds(calls, rounds)
        tally.add(name, counts, *(each / (4 * 128 * 128) * 1e9 for each in seconds))
    tally.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--precisions", nargs="+", choices=list(COSTS), default=list(COSTS))
    parser.add_argument("--most", type=int, default=500, help="primitives of a scene of the project")
    given = parser.parse_args()
    show_processor()
    for precision in given.precisions:
        synthetic(precision, given.rounds)
        of_project(precision, given.rounds, given.most)


if __name__ == "__main__":
    main()
