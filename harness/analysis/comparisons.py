"""Whose times are compared with whose, and what follows: DataFrames made of `crossings`.

A race is a group of contestants whose times are compared, each with a baseline, in one measure: in seconds to a target, or in
seconds per sample. `statistics.race` judges it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.analysis.axes import unlabelled
from harness.analysis.baselines import Baselines
from harness.analysis.crossings import READINGS, Logs, logs
from harness.analysis.model import CONTESTANT_KEYS, PER_SAMPLE, Frame, Verdict, raced_together
from harness.statistics import UNKNOWN_SPREAD, Bound, PersistentSpread, Race, TwinPair, persistent_spread, race, twin_pairs
from harness.store.results import Results

CLOCK_SECONDS = 1e-6
"""What a clock resolves, starting and stopping it included."""
PAIRS = ["race", *CONTESTANT_KEYS, "baseline", "factor", "no_ratio", "ranked"]
RATIOS = ["ratio", "ratio_low", "ratio_high", "blocks", "verdict"]
Spreads = Mapping[tuple[str, str], PersistentSpread]
"""(scene, contestant) -> the persistent spread of its machine."""


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
        return f"flagged, so not ranked: {verdict.why_not_ranked}"
    if baseline is not None and baseline.disqualified:
        return f"{baseline.contestant.name} is flagged, so not ranked: {baseline.why_not_ranked}"
    if baseline is not None:
        return ""
    if verdict.contestant.settings.label:
        return "repeats a contestant without results"
    others = [each for each in group if each is not verdict and not each.contestant.settings.label]
    return "the baseline of its race" if others else "alone in its race"


def persistent_spreads(crossings: Frame, verdicts: Sequence[Verdict]) -> Spreads:
    """Of each machine, from the seconds per sample of all its A/A twins, whatever their scene. Twins render the same images, so
    that their times to a target differ by their speed alone."""
    groups = raced_together(verdicts)
    times = own_times(crossings, groups.values())
    found: dict[str, list[TwinPair]] = {}
    for number, (race_of_group, group) in enumerate(groups.items()):
        settings = [verdict.contestant.settings for verdict in group]
        rows = {each: row for row, each in enumerate(settings)}
        twins = [(rows[unlabelled(each)], row) for each, row in rows.items() if each.label and unlabelled(each) in rows]
        low, high = logs(times[number, PER_SAMPLE], len(group))
        ranked = np.array([not each.label for each in settings])
        found.setdefault(race_of_group.machine, []).extend(twin_pairs(low, high, twins, ranked=ranked, clock=clock_steps(low)))
    spreads = {machine: persistent_spread(pairs) for machine, pairs in found.items()}
    return {(v.contestant.settings.scene, v.contestant.name): spreads[v.contestant.settings.machine] for v in verdicts}


def measures(crossings: Frame) -> list[str]:
    """Seconds per sample, then the targets as they were given: the easiest first."""
    return [PER_SAMPLE, *(measure for measure in crossings.measure.unique() if measure != PER_SAMPLE)]


def by_race(crossings: Frame, pairs: Frame) -> Mapping[tuple[int, str], Frame]:
    """(race, measure) -> its rows of `crossings`, with the column `row`: the place of the contestant in its race. Of `pairs`
    the columns `race`, `scene` and `contestant` are read."""
    places = pairs[[*CONTESTANT_KEYS, "race"]].assign(row=pairs.groupby("race").cumcount())
    raced = crossings.merge(places, on=CONTESTANT_KEYS)
    return defaultdict(lambda: raced[:0], iter(raced.groupby(["race", "measure"], sort=False)))


def own_times(crossings: Frame, groups: Iterable[Sequence[Verdict]]) -> Mapping[tuple[int, str], Frame]:
    """As `by_race`, of groups of verdicts in the order given, each curve in its own reading."""
    members = [(n, v.contestant.settings.scene, v.contestant.name) for n, group in enumerate(groups) for v in group]
    return by_race(crossings[crossings.own], pd.DataFrame(members, columns=["race", *CONTESTANT_KEYS]))


def comparisons(crossings: Frame, pairs: Frame, spreads: Spreads, margin: float) -> Frame:
    """One row a contestant and measure.

    Columns: those of `pairs`; `measure`; `ratio`, of the seconds of the baseline to its own, with `ratio_low`, `ratio_high`,
    `blocks` and `verdict` as in `statistics.Ratio`, unknown where it is compared with none; `possible_winner`;
    `persistent_spread` of the machine, a share, unknown where no twin was measured; `twins`, of how many.
    `margin`: the largest share by which times that count as the same may differ.
    """
    times = by_race(crossings, pairs)
    rows = [
        row
        for number, members in pairs.groupby("race")
        for row in _race({each: times[number, each] for each in measures(crossings)}, members, spreads, margin)
    ]
    return pd.DataFrame(rows, columns=[*PAIRS, "measure", *RATIOS, "possible_winner", "persistent_spread", "twins"])


def _race(times_in: Mapping[str, Frame], members: Frame, spreads: Spreads, margin: float) -> Iterator[tuple[Any, ...]]:
    """The rows of one race in each measure. `times_in`: measure -> rows of `by_race`."""
    count, first = len(members), members.iloc[0]
    spread = spreads.get((first.scene, first.contestant), UNKNOWN_SPREAD)
    place = {key: row for row, key in enumerate(zip(members.scene, members.contestant, strict=True))}
    compared = [
        (place[row.scene, row.contestant], place[row.scene, row.baseline]) for row in members.itertuples() if row.no_ratio == ""
    ]
    for measure, times in times_in.items():
        low, high = _sure(times[times.own], count)
        found = race(
            low,
            high,
            compared,
            spread,
            ranked=members.ranked.to_numpy(bool),
            clock=clock_steps(low),
            margin=margin,
            pools=members.scene.factorize()[0],
            **({} if measure == PER_SAMPLE else _readings(times, count)),
        )
        ratios = {row: ratio for (row, _), ratio in zip(compared, found.ratios, strict=True)}
        for row, member in enumerate(members.itertuples(index=False)):
            ratio = ratios.get(row, (math.nan, math.nan, math.nan, 0, ""))
            yield *member, measure, *ratio, found.possible_winner[row], spread.share, spread.twins


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
    spread: PersistentSpread,
    margin: float,
    readings: Sequence[Sequence[Mapping[int, Bound]]] = (),
    mixed: NDArray[np.bool_] | None = None,
) -> Race:
    """The race of contestants of which each has block -> a positive number, of which less is better. `margin`: the largest
    difference, as a share, that counts as the same. `readings`: the numbers of all as found in other ways, see
    `statistics.race`."""
    own = _arrays([{block: Bound(value, value) for block, value in one.items()} for one in measured])
    return race(*own, compared, spread, margin=margin, readings=[_arrays(bounds) for bounds in readings], mixed=mixed)


def _arrays(found: Sequence[Mapping[int, Bound]]) -> tuple[Logs, Logs]:
    rows = [(place, block, *bound) for place, one in enumerate(found) for block, bound in one.items()]
    return logs(pd.DataFrame(rows, columns=["row", "block", "low", "high"]), len(found))


def clock_steps(low: Logs) -> Logs:
    """(k,) what the clock resolves over the shortest time of each contestant."""
    shortest = np.min(np.where(np.isfinite(low), low, np.inf), axis=1, initial=np.inf)
    return CLOCK_SECONDS * np.exp(-shortest)
