"""Runs of known truth, simulated: how often verdicts are wrong, and what they find.

    python -m tests.simulated_runs [RUNS]

prints the figures of the table of docs/how/verdicts.md. A run has a number of scenes, six contestants in each, four twins and
five blocks. `persistent` is the standard deviation of what persists between two equal contestants over all blocks, `noise`
that of a cell; both of ln seconds.
"""

import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from harness.statistics import persistent_spread, race, twin_pairs

SCENES, PERSISTENT, NOISE = (1, 3, 7), (0.0, 0.02, 0.05, 0.10), (0.03, 0.06)
CONTESTANTS, BLOCKS, TWINS = 6, 5, 4
SLOWER = 1.5
RUNS = 4000


class Shares(NamedTuple):
    """`false_differences`: how often `faster` or `slower` is said in a race of equal contestants. Shares of the races: some is
    said (`any_false`), one is named the fastest (`false_winner`), one that takes 1.5 times as long is called slower (`found`).
    Share of the intervals that hold the true ratio: `coverage`."""

    false_differences: float
    any_false: float
    false_winner: float
    coverage: float
    found: float


def twins_by_scene(scenes: int, contestants: int, twins: int) -> list[list[int]]:
    """Of each scene the contestants that have a twin, once for each twin: spread as the planner does."""
    found: list[list[int]] = [[] for _ in range(scenes)]
    for twin in range(twins):
        found[twin % scenes].append(twin // scenes % contestants)
    return found


def simulated(
    scenes: int,
    persistent: float,
    noise: float,
    runs: int,
    *,
    contestants: int = CONTESTANTS,
    twins: int = TWINS,
    blocks: int = BLOCKS,
    seed: int = 1,
) -> Shares:
    """Of each run one race is judged twice, first of equal contestants, then with one that is slower."""
    rng = np.random.default_rng([seed, scenes, round(1e4 * persistent), round(1e4 * noise)])
    originals = twins_by_scene(scenes, contestants, twins)
    against_first = [(row, 0) for row in range(1, contestants)]
    said, some, winners, covered, found = 0, 0, 0, 0, 0
    for run in range(runs):
        pairs, races, judged = [], {}, run % scenes
        for scene, of in enumerate(originals):
            if not of and scene != judged:
                continue
            rows = contestants + len(of)
            logs = rng.normal(0, 0.1, blocks) + rng.normal(0, persistent / math.sqrt(2), (rows, 1))
            logs += rng.normal(0, noise, (rows, blocks))
            ranked = np.arange(rows) < contestants
            pairs += twin_pairs(logs, logs, [(row, contestants + at) for at, row in enumerate(of)], ranked=ranked)
            races[scene] = logs, ranked
        spread = persistent_spread(pairs)
        times, racing = races[judged]
        for factor in (1.0, SLOWER):
            times[1] += math.log(factor)
            judgement = race(times, times, against_first, spread, ranked=racing)
            truths = [1 / factor, *[1.0] * (contestants - 2)]
            covered += sum(ratio.low <= truth <= ratio.high for ratio, truth in zip(judgement.ratios, truths, strict=True))
            if factor == 1.0:
                wrong = sum(ratio.verdict in ("faster", "slower") for ratio in judgement.ratios)
                said, some = said + wrong, some + (wrong > 0)
                winners += int(judgement.possible_winner.sum()) == 1
        found += judgement.ratios[0].verdict == "slower"
    return Shares(said / runs, some / runs, winners / runs, covered / runs / (2 * (contestants - 1)), found / runs)


def main(arguments: Sequence[str]) -> None:
    runs = int(arguments[0]) if arguments else RUNS
    print("| persistent spread | noise of a cell | scenes | false differences | coverage | 1.5-fold found |")
    print("| --- | --- | --- | --- | --- | --- |")
    for persistent in PERSISTENT:
        for noise in NOISE:
            for scenes in SCENES:
                found = simulated(scenes, persistent, noise, runs)
                numbers = f"{found.false_differences:.3f} | {found.coverage:.3f} | {found.found:.3f}"
                print(f"| {100 * persistent:g} % | {100 * noise:g} % | {scenes} | {numbers} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
