"""Races: the contestants of a scene, shader, size, division and machine on one target, and what `statistics.race` says of them.

Beside the targets there is a race in seconds per sample, whose index is None.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.analysis.comparisons import unlabelled
from harness.analysis.model import Verdict, raced_together, seconds_per_sample
from harness.metrics import as_error
from harness.statistics import Bound, Race, Ratio, Reading, crossing_seconds, noise_floor, race, twin_distance
from harness.statistics.convergence import NOISE_ERRORS
from harness.store.results import Contestant, Results

Logs = NDArray[np.float64]
READINGS: tuple[Reading, Reading] = ("interpolated", "first")
CLOCK_SECONDS = 1e-6
"""What a clock resolves, starting and stopping it included."""


class Raced(NamedTuple):
    """What races say of a contestant, by the fields of `Verdict`."""

    speedup: Ratio | None
    quality_speedups: tuple[Ratio | None, ...]
    possible_winner: tuple[bool, ...]
    no_ratio: str


class Races(NamedTuple):
    """`floors` and `separated` are those of `Analysis`; `raced` is by contestant."""

    floors: dict[tuple[str, int | None], float]
    separated: set[tuple[str, int | None]]
    raced: dict[Contestant, Raced]


class Outcome(NamedTuple):
    """A race on one target: for each of its verdicts the ratio, and whether it may be the fastest."""

    ratios: list[Ratio | None]
    possible: list[bool]
    twins_separated: bool


def run_races(results: Results, verdicts: Sequence[Verdict]) -> Races:
    """The noise floors of all scenes, and the ratios and possible winners of all races.

    Contestants with a flag that disqualifies them are left out.
    """
    groups = list(raced_together(verdicts).values())
    logs = {
        index: [_logs([_bounds(results, verdict, index) for verdict in group]) for group in groups]
        for index in (None, *range(len(results.targets)))
    }
    twins = [_twins([verdict.contestant for verdict in group]) for group in groups]
    floors = _floors(groups, twins, list(logs))
    outcomes = {
        index: [
            _outcome(results, group, index, *bounds, pairs, floors[_scene(group), index])
            for group, bounds, pairs in zip(groups, found, twins, strict=True)
        ]
        for index, found in logs.items()
    }
    separated = {
        (_scene(group), index)
        for index, found in outcomes.items()
        for group, outcome in zip(groups, found, strict=True)
        if outcome.twins_separated
    }
    raced: dict[Contestant, Raced] = {}
    for place, group in enumerate(groups):
        own = {
            index: _unresolved(found[place], group) if (_scene(group), index) in separated else found[place]
            for index, found in outcomes.items()
        }
        on_targets = [outcome for index, outcome in own.items() if index is not None]
        for row, verdict in enumerate(group):
            speedup = own[None].ratios[row]
            raced[verdict.contestant] = Raced(
                speedup,
                tuple(outcome.ratios[row] for outcome in on_targets),
                tuple(outcome.possible[row] for outcome in on_targets),
                "" if speedup else _why_no_ratio(verdict, group),
            )
    return Races(floors, separated, raced)


def _scene(group: Sequence[Verdict]) -> str:
    return group[0].contestant.settings.scene


def _floors(
    groups: Sequence[Sequence[Verdict]], twins: Sequence[Sequence[tuple[int, int]]], indices: Sequence[int | None]
) -> dict[tuple[str, int | None], float]:
    """(scene, index of the target) -> noise floor; the first of `indices` is None."""
    distances: dict[int | None, dict[str, list[float]]] = {}
    for group, pairs in zip(groups, twins, strict=True):
        for pair in pairs or [None]:
            own = [_distance([group[row] for row in pair], index) if pair else math.nan for index in indices]
            for index, distance in zip(indices, [own[0], *_filled(own[1:])], strict=True):
                distances.setdefault(index, {}).setdefault(_scene(group), []).append(distance)
    floors: dict[tuple[str, int | None], float] = {}
    for index, scenes in distances.items():
        everyone = [distance for found in scenes.values() for distance in found]
        floors |= {(scene, index): noise_floor(found, everyone) for scene, found in scenes.items()}
    return floors


def _why_no_ratio(verdict: Verdict, group: Sequence[Verdict]) -> str:
    if verdict.disqualified:
        return "flagged, so not ranked"
    if verdict.baseline is None and verdict.contestant.settings.label:
        return "repeats a contestant without results"
    if verdict.baseline is None:
        others = [each for each in group if each is not verdict and not each.contestant.settings.label]
        return "the baseline of its race" if others else "alone in its race"
    return f"{verdict.baseline.name} is flagged, so not ranked"


def _distance(pair: Sequence[Verdict], index: int | None) -> float:
    """|ln ratio| of twins. The reference's noise moves the times of both alike, so these are taken as they are found."""
    return twin_distance(*times_found(pair, index), 0, 1)


def times_found(verdicts: Sequence[Verdict], index: int | None) -> tuple[Logs, Logs]:
    """(k, n) bounds of ln seconds to the target of `index`, or per sample, whatever the noise of the reference."""
    if index is None:
        return _logs([_per_sample(verdict.contestant) for verdict in verdicts])
    times = [zip(verdict.contestant.runs, verdict.warm[index].crossings, strict=True) for verdict in verdicts]
    return _logs([{cell.block: bound for cell, bound in one} for one in times])


def _per_sample(contestant: Contestant) -> dict[int, Bound]:
    return {block: Bound(seconds, seconds) for block, seconds in seconds_per_sample(contestant).items()}


def _filled(distances: Sequence[float]) -> list[float]:
    """Distances of twins on targets, the easiest first. Where the twins did not get there, or were there at once, that of the
    nearest easier target that was timed stands in, else of the nearest harder one."""
    known = [index for index, distance in enumerate(distances) if math.isfinite(distance)]
    nearest = [max((k for k in known if k <= index), default=known[0] if known else index) for index in range(len(distances))]
    return [distances[index] for index in nearest]


def _outcome(
    results: Results,
    group: Sequence[Verdict],
    index: int | None,
    low: Logs,
    high: Logs,
    twins: Sequence[tuple[int, int]],
    floor: float,
) -> Outcome:
    rows = {verdict.contestant: row for row, verdict in enumerate(group) if not verdict.disqualified}
    compared = [
        (rows[v.contestant], rows[v.baseline])
        for v in group
        if v.contestant in rows and v.baseline is not None and v.baseline in rows
    ]
    ranked = np.array([v.contestant in rows and not v.contestant.settings.label for v in group])
    found = race(
        low,
        high,
        compared,
        floor,
        ranked=ranked,
        twins=twins,
        clock=clock_steps(low),
        margin=results.config.same_within,
        **_readings(results, group, index),
    )
    ratios = {row: ratio for (row, _), ratio in zip(compared, found.ratios, strict=True)}
    return Outcome([ratios.get(row) for row in range(len(group))], found.possible_winner.tolist(), found.twins_separated)


def _unresolved(outcome: Outcome, group: Sequence[Verdict]) -> Outcome:
    """Twins of a race of the scene are separated: nothing is concluded in any of its races."""
    ratios = [ratio._replace(verdict="unresolved") if ratio else None for ratio in outcome.ratios]
    if not any(outcome.possible):
        return outcome._replace(ratios=ratios)
    able = [not verdict.disqualified and not verdict.contestant.settings.label for verdict in group]
    return outcome._replace(ratios=ratios, possible=able)


def _readings(results: Results, group: Sequence[Verdict], index: int | None) -> dict[str, Any]:
    """What a race of samplers of both kinds needs: times by either reading, and which pairs are of different kinds."""
    own = np.array([verdict.warm[index].reading if index is not None else "" for verdict in group])
    if len(set(own)) < 2 or index is None:
        return {}
    read = [[times_read(results, verdict, index, way) for verdict in group] for way in READINGS]
    return {"readings": [_logs(bounds) for bounds in read], "mixed": own[:, None] != own}


def times_read(results: Results, verdict: Verdict, index: int, reading: Reading) -> dict[int, Bound]:
    """Block -> seconds to a target. What the reference's noise may have moved is known less well: by three of its standard
    errors, for times go as the inverse of the error at the most."""
    target = as_error(results.metric, results.targets[index])
    found = {cell.block: crossing_seconds(results.curve(cell), target, reading) for cell in verdict.contestant.runs}
    if verdict.warm[index].reliable:
        return {block: crossing.x for block, crossing in found.items()}
    rooms = {
        block: max(1 - NOISE_ERRORS * crossing.noise, 0.0) if crossing.noise < math.inf else 0.0
        for block, crossing in found.items()
    }
    return {
        block: Bound(x.low * rooms[block], x.high / rooms[block] if rooms[block] else math.inf)
        for block, (x, _, _) in found.items()
    }


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
    logs = _logs([{b: Bound(value, value) for b, value in one.items()} for one in measured])
    return race(*logs, compared, floor, margin=margin, readings=[_logs(bounds) for bounds in readings], mixed=mixed)


def clock_steps(low: Logs) -> Logs:
    """(k,) what the clock resolves over the shortest time of each contestant."""
    shortest = np.min(np.where(np.isfinite(low), low, np.inf), axis=1, initial=np.inf)
    return CLOCK_SECONDS * np.exp(-shortest)


def _twins(contestants: Sequence[Contestant]) -> list[tuple[int, int]]:
    """Places of measured contestants that differ in their label alone: the unlabelled first."""
    places = {c.settings: place for place, c in enumerate(contestants) if c.done}
    found = [(places.get(unlabelled(settings)), place) for settings, place in places.items() if settings.label]
    return [(one, other) for one, other in found if one is not None]


def _bounds(results: Results, verdict: Verdict, index: int | None) -> Mapping[int, Bound]:
    """Block -> seconds to the target of `index`, or seconds per sample."""
    if index is not None:
        return times_read(results, verdict, index, verdict.warm[index].reading)
    return _per_sample(verdict.contestant)


def _logs(bounds: Sequence[Mapping[int, Bound]]) -> tuple[Logs, Logs]:
    """(k, n) lower and upper bounds of ln seconds, NaN where a contestant lacks a block."""
    blocks = sorted({block for one in bounds for block in one})
    ends = np.array([[one.get(block, Bound(math.nan, math.nan)) for block in blocks] for one in bounds], np.float64)
    with np.errstate(divide="ignore"):
        logs = np.log(ends.reshape(len(bounds), len(blocks), 2))
    return logs[..., 0], logs[..., 1]
