"""Whose times are compared with whose, and what follows: DataFrames made of `crossings`.

A race is a group of contestants whose times are compared, each with a baseline, in one measure: in seconds to a target, or in
seconds per sample. `statistics.race` judges it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.analysis.baselines import AA, Baselines
from harness.analysis.crossings import READINGS, Logs, logs
from harness.analysis.model import CONTESTANT_KEYS, PER_SAMPLE, Frame, Verdict, raced_together
from harness.statistics import Bound, Race, noise_floor, race, twin_distance
from harness.store.results import Results

CLOCK_SECONDS = 1e-6
"""What a clock resolves, starting and stopping it included."""
PAIRS = ["race", *CONTESTANT_KEYS, "baseline", "factor", "no_ratio", "ranked"]
RATIOS = ["ratio", "ratio_low", "ratio_high", "blocks", "verdict"]
Floors = Mapping[tuple[str, str], float]
"""(scene, measure) -> noise floor as a log ratio; NaN, or not there, where it was not measured."""


def pairs(results: Results, verdicts: Sequence[Verdict]) -> Frame:
    """One row a contestant, in races of one scene, reference, size, division and machine.

    Columns: `race`, a number; `scene` and `contestant`; `baseline`, the contestant that it is compared with, and `factor`, in
    what the two differ, both empty where there is none; `no_ratio`, why it is compared with none, empty where it is; `ranked`,
    whether it may win.
    """
    rows, baselines = [], Baselines(results)
    for number, group in enumerate(raced_together(verdicts).values()):
        members = {verdict.contestant: verdict for verdict in group}
        for contestant, verdict in members.items():
            baseline, factor = baselines.of(contestant, list(members)) or (None, "")
            why_not = why_no_ratio(verdict, None if baseline is None else members[baseline], group)
            ranked = not verdict.disqualified and not contestant.settings.label
            name = baseline.name if baseline is not None else ""
            rows.append((number, contestant.settings.scene, contestant.name, name, factor, why_not, ranked))
    return pd.DataFrame(rows, columns=PAIRS)


def why_no_ratio(verdict: Verdict, baseline: Verdict | None, group: Sequence[Verdict] = ()) -> str:
    """Why a contestant of a race has no ratio to its baseline, or none at all; empty where it has one."""
    if verdict.disqualified:
        return "flagged, so not ranked"
    if baseline is not None:
        return f"{baseline.contestant.name} is flagged, so not ranked" if baseline.disqualified else ""
    if verdict.contestant.settings.label:
        return "repeats a contestant without results"
    others = [each for each in group if each is not verdict and not each.contestant.settings.label]
    return "the baseline of its race" if others else "alone in its race"


def noise_floors(crossings: Frame, pairs: Frame) -> Floors:
    """Of each scene that has A/A twins, from the distances of its own and of all twins of the run. The reference's noise moves
    the times of twins alike, so these are taken as they are found.

    Where twins did not get to a target, or were there at once, their distance on the nearest easier target that was timed
    stands in, else that on the nearest harder one.
    """
    twins = pairs[(pairs.factor == AA) & (pairs.baseline != "")]
    times = by_race(crossings[crossings.own], pairs)
    rows = []
    for twin in twins.itertuples():
        names = pairs[pairs.race == twin.race].contestant.tolist()
        both = [logs(times[twin.race, measure], len(names)) for measure in measures(crossings)]
        rows.append([twin_distance(*ends, names.index(twin.baseline), names.index(twin.contestant)) for ends in both])
    distances = pd.DataFrame(rows, twins.scene, measures(crossings), dtype=float)
    targets = distances.columns[1:]
    distances[targets] = distances[targets].ffill(axis=1).bfill(axis=1)
    return {
        (str(scene), str(measure)): noise_floor(own.tolist(), everyone.tolist())
        for measure, everyone in distances.items()
        for scene, own in everyone.groupby(level=0)
    }


def measures(crossings: Frame) -> list[str]:
    """Seconds per sample, then the targets as they were given: the easiest first."""
    return [PER_SAMPLE, *(measure for measure in crossings.measure.unique() if measure != PER_SAMPLE)]


def by_race(crossings: Frame, pairs: Frame) -> Mapping[tuple[int, str], Frame]:
    """(race, measure) -> its rows of `crossings`, with the column `row`: the place of the contestant in its race. Of `pairs`
    the columns `race`, `scene` and `contestant` are read."""
    places = pairs[[*CONTESTANT_KEYS, "race"]].assign(row=pairs.groupby("race").cumcount())
    raced = crossings.merge(places, on=CONTESTANT_KEYS)
    return defaultdict(lambda: raced[:0], iter(raced.groupby(["race", "measure"], sort=False)))


def comparisons(crossings: Frame, pairs: Frame, floors: Floors, margin: float) -> Frame:
    """One row a contestant and measure.

    Columns: those of `pairs`; `measure`; `ratio`, of the seconds of the baseline to its own, with `ratio_low`, `ratio_high`,
    `blocks` and `verdict` as in `statistics.Ratio`, unknown where it is compared with none; `possible_winner`; `noise_floor`, a
    share; `twins_separated`, whether some A/A twins of the scene differ: nothing is then concluded in any of its races.
    `margin`: the largest share by which times that count as the same may differ.
    """
    times = by_race(crossings, pairs)
    rows = [
        row
        for number, members in pairs.groupby("race")
        for row in _race({each: times[number, each] for each in measures(crossings)}, members, floors, margin)
    ]
    found = pd.DataFrame(rows, columns=[*PAIRS, "measure", *RATIOS, "possible_winner", "noise_floor", "twins_separated"])
    separated = found.groupby(["scene", "measure"]).twins_separated.transform("any").astype(bool)
    decided = found.groupby(["race", "measure"]).possible_winner.transform("any").astype(bool)
    return found.assign(
        twins_separated=separated,
        verdict=found.verdict.mask(separated & (found.no_ratio == ""), "unresolved"),
        possible_winner=found.possible_winner.mask(separated & decided, found.ranked),
    )


def _race(times_in: Mapping[str, Frame], members: Frame, floors: Floors, margin: float) -> Iterator[tuple[Any, ...]]:
    """The rows of one race in each measure. `times_in`: measure -> rows of `by_race`."""
    count, scene = len(members), members.scene.iloc[0]
    place = {name: row for row, name in enumerate(members.contestant)}
    compared = [(place[row.contestant], place[row.baseline]) for row in members.itertuples() if row.no_ratio == ""]
    twins = [(place[row.baseline], place[row.contestant]) for row in members.itertuples() if row.factor == AA and row.baseline]
    for measure, times in times_in.items():
        floor = floors.get((scene, measure), math.nan)
        low, high = _sure(times[times.own], count)
        found = race(
            low,
            high,
            compared,
            floor,
            ranked=members.ranked.to_numpy(bool),
            twins=twins,
            clock=clock_steps(low),
            margin=margin,
            **({} if measure == PER_SAMPLE else _readings(times, count)),
        )
        ratios = {row: ratio for (row, _), ratio in zip(compared, found.ratios, strict=True)}
        for row, member in enumerate(members.itertuples(index=False)):
            ratio = ratios.get(row, (math.nan, math.nan, math.nan, 0, ""))
            yield *member, measure, *ratio, found.possible_winner[row], math.expm1(floor), found.twins_separated


def _sure(times: Frame, count: int) -> tuple[Logs, Logs]:
    return logs(times, count, "sure_low", "sure_high")


def _readings(times: Frame, count: int) -> dict[str, Any]:
    """What a race of samplers of both kinds needs: times by either reading, and which pairs are of different kinds."""
    own, kinds = times[times.own], np.full(count, None)
    kinds[own.row] = own.reading
    if len(set(kinds)) < 2:
        return {}
    return {"readings": [_sure(times[times.reading == way], count) for way in READINGS], "mixed": kinds[:, None] != kinds}


def race_of(
    measured: Sequence[Mapping[int, float]],
    compared: Sequence[tuple[int, int]],
    floor: float,
    margin: float,
    readings: Sequence[Sequence[Mapping[int, Bound]]] = (),
    mixed: NDArray[np.bool_] | None = None,
) -> Race:
    """The race of contestants of which each has block -> a positive number, of which less is better. `margin`: the largest
    difference, as a share, that counts as the same. `readings`: the numbers of all as found in other ways, see
    `statistics.race`."""
    own = _arrays([{block: Bound(value, value) for block, value in one.items()} for one in measured])
    return race(*own, compared, floor, margin=margin, readings=[_arrays(bounds) for bounds in readings], mixed=mixed)


def _arrays(found: Sequence[Mapping[int, Bound]]) -> tuple[Logs, Logs]:
    rows = [(place, block, *bound) for place, one in enumerate(found) for block, bound in one.items()]
    return logs(pd.DataFrame(rows, columns=["row", "block", "low", "high"]), len(found))


def clock_steps(low: Logs) -> Logs:
    """(k,) what the clock resolves over the shortest time of each contestant."""
    shortest = np.min(np.where(np.isfinite(low), low, np.inf), axis=1, initial=np.inf)
    return CLOCK_SECONDS * np.exp(-shortest)
