"""How seconds to each target changed over the revisions of a renderer: from many results folders of one experiment.

A folder is one session of one revision, or of several that it measured in the same blocks (`revision` of the experiment).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import takewhile
from typing import Any, NamedTuple

from engines.errors import ConfigError
from harness.analysis import Analysis, analyse
from harness.analysis.calibration import plural
from harness.analysis.columns import Column, Table
from harness.analysis.model import FLAGS, OF_THE_TIME, PER_SAMPLE
from harness.report.tables.changes import TIMES, UNTESTED_THRESHOLD, cautions, judged, matching, sessions_differ
from harness.statistics import (
    UNKNOWN_SPREAD,
    Change,
    Estimate,
    PersistentSpread,
    change_of_pairs,
    change_of_times,
    geometric_interval,
    judge_changes,
)
from harness.statistics.intervals import NOTHING, exp
from harness.store.records import Settings
from harness.store.results import Results

WITHOUT_TWINS = (
    "what differs between two equal builds in all blocks alike is not known there, and one or two such sessions test no step."
)
SHORT = 10
"""Characters of a commit in tables and plots."""


class Measured(NamedTuple):
    """A contestant of one session: seconds to a target by block, infinite where it was not reached, flags of its images, and
    the persistent spread of the machine. `failure` says why no run came to its end, and is empty where one did."""

    session: int
    seconds: Mapping[int, float]
    flags: frozenset[str]
    failure: str
    spread: PersistentSpread


class Line(NamedTuple):
    """What is followed over the revisions: a contestant and a target."""

    key: Settings
    target: float


class Step(NamedTuple):
    """A revision of a line beside the last one before it that did not fail; `new_flags` are those that it lacks."""

    line: Line
    before: str
    after: str
    change: Change
    reached: tuple[bool, bool]
    new_flags: frozenset[str]
    failure: str


def history(sessions: Sequence[Results], threshold: float | None = None) -> Table:
    """One row a scene, contestant, target and revision, in the order in which revisions were first measured.

    Each revision is compared with the one before it: by block where sessions hold both, else between sessions, as `changes`
    does; where all runs of that failed, with the last one before it. All steps hold together at 5 %. A row is a `regression`
    where it is longer by more than `threshold` with its whole interval, where the target is no longer reached, where all runs
    fail now, and where its images have a new flag.

    Raises `ConfigError` where a session has no revision, or another metric than the others.
    """
    sessions_differ([sessions])
    if len(metrics := {results.metric for results in sessions}) > 1:
        raise ConfigError(f"the folders have errors in {' and '.join(sorted(metrics))}: those of one experiment are expected")
    order: dict[str, str] = {}
    lines: dict[Line, dict[str, list[Measured]]] = {}
    names: dict[Settings, str] = {}
    without_twins = 0
    for index, results in enumerate(sorted(sessions, key=_begin)):
        for revision in _revisions(results):
            order.setdefault(revision, _begin(results))
        analysis = analyse(results)
        without_twins += not any(spread.twins for spread in analysis.spreads.values())
        _read(index, analysis, lines, names)
    steps = [step for line, found in lines.items() for step in _steps(line, found, list(order))]
    same_within = sessions[-1].config.same_within
    verdicts = judge_changes([step.change for step in steps], same_within)
    by_step = {
        (step.line, step.after): _judged(step, verdict, same_within, threshold)
        for step, verdict in zip(steps, verdicts, strict=True)
    }
    table = _table(sessions, order, threshold, same_within, without_twins)
    for line in sorted(lines, key=lambda line: (line.key.scene, names[line.key], -line.target)):
        for revision in order:
            if measured := lines[line].get(revision):
                who = {"scene": line.key.scene, "contestant": names[line.key], "target": line.target}
                row = _row(measured) | by_step.get((line, revision), {"verdict": _failure(measured), "regression": False})
                table.rows.append({**who, "revision": shortened(revision), "since": order[revision][:16], **row})
    return table


def regressions(table: Table) -> list[dict[str, Any]]:
    """The rows of a history that regressed at the last revision of their line: earlier steps are known."""
    last = {(row["scene"], row["contestant"], row["target"]): row for row in table.rows}
    return [row for row in last.values() if row["regression"]]


def shortened(revision: str) -> str:
    """A commit's first characters; other texts stay."""
    is_commit = len(revision) >= 2 * SHORT and all(letter in "0123456789abcdef" for letter in revision)
    return revision[:SHORT] if is_commit else revision


def _begin(results: Results) -> str:
    return min((cell.time for cell in results.cells if cell.time), default=results.manifest.time or "")


def _revisions(results: Results) -> list[str]:
    """Of a session, in the order of the experiment."""
    given = results.config.revision
    if isinstance(given, dict):
        return list(given.values())
    machine = results.manifest.machine
    commits = [state.get("commit") for key in ("project", "git") if isinstance(state := machine.get(key), dict)]
    found = given or next(filter(None, commits), None)
    if not found:
        raise ConfigError(f"{results.folder}: has no revision: run it with --set revision=..., or in a git checkout")
    return [found]


def _read(session: int, analysis: Analysis, lines: dict[Line, dict[str, list[Measured]]], names: dict[Settings, str]) -> None:
    """Puts the contestants of a session where they belong."""
    results = analysis.results
    flags = {verdict.contestant: frozenset(verdict.flags) - OF_THE_TIME for verdict in analysis.verdicts}
    own = analysis.crossings[analysis.crossings.own & (analysis.crossings.measure != PER_SAMPLE)]
    rows = dict(iter(own.groupby(["scene", "contestant", "target"])))
    for contestant in results.contestants:
        if contestant.settings.label or not contestant.runs:
            continue
        engine, revision = _of_engine(results, contestant.settings.engine)
        key = replace(matching(contestant.settings), engine=engine)
        if contestant.done or key not in names:
            names[key] = contestant.name.replace(contestant.settings.engine, engine)
        message = next((cell.message or cell.state for cell in contestant.runs if not contestant.done), "")
        failure = f"failed: {message.splitlines()[0]}" if message else ""
        for target in results.targets:
            found = rows.get((contestant.settings.scene, contestant.name, target))
            seconds = {} if found is None else {row.block: _seconds(row) for row in found.itertuples()}
            seconds = {cell.block: math.inf for cell in contestant.runs} | seconds  # where a cell failed
            spread = analysis.spreads.get((contestant.settings.scene, contestant.name), UNKNOWN_SPREAD)
            measured = Measured(session, seconds, flags.get(contestant, frozenset()), failure, spread)
            lines.setdefault(Line(key, target), {}).setdefault(revision, []).append(measured)


def _of_engine(results: Results, engine: str) -> tuple[str, str]:
    """The name under which an engine is followed, and its revision: builds of one renderer have the beginning that their names
    share."""
    given = results.config.revision
    if not isinstance(given, dict):
        return engine, _revisions(results)[0]
    builds = [name for name in results.engines if any(fnmatchcase(name, pattern) for pattern in given)]
    for pattern, revision in given.items():
        if fnmatchcase(engine, pattern):
            return beginning(builds) or "build", revision
    return engine, list(given.values())[-1]


def beginning(names: Sequence[str]) -> str:
    """The whole words and numbers with which all names begin, without a dash or bracket at its end."""
    words = [re.findall(r"[^\W\d_]+|\d+|[\W_]", name) for name in names]
    same = (each[0] for each in takewhile(lambda each: len(set(each)) == 1, zip(*words, strict=False)))
    return "".join(same).rstrip(" -_.(:@/")


def _failure(measured: Sequence[Measured]) -> str:
    """Why all runs of a revision failed; empty where one did not."""
    return measured[0].failure if all(each.failure for each in measured) else ""


def _seconds(row: Any) -> float:
    if row.state == "censored":
        return math.inf
    return float(row.high if row.low <= 0 else math.sqrt(row.low * row.high))


def _steps(line: Line, found: Mapping[str, list[Measured]], order: Sequence[str]) -> list[Step]:
    """Each revision with the last one before it that was measured and did not fail."""
    steps: list[Step] = []
    measured = [revision for revision in order if revision in found]
    good = [revision for revision in measured if not _failure(found[revision])]
    for after in measured:
        before = next((each for each in reversed(good) if measured.index(each) < measured.index(after)), None)
        if before is None:
            continue
        old, new = found[before], found[after]
        shared = {each.session: each.seconds for each in old}
        both = [each for each in new if each.session in shared]
        pairs = [
            [(shared[each.session][block], seconds) for block, seconds in each.seconds.items() if block in shared[each.session]]
            for each in both
        ]
        sides = ([list(each.seconds.values()) for each in side] for side in (old, new))
        change = change_of_pairs(pairs, [each.spread for each in both]) if pairs else change_of_times(*sides)
        flags = [frozenset().union(*(each.flags for each in side)) for side in (old, new)]
        reached = _reaches(old), _reaches(new)
        steps.append(Step(line, before, after, change, reached, flags[1] - flags[0], _failure(new)))
    return steps


def _reaches(side: Sequence[Measured]) -> bool:
    """Whether most runs reached the target."""
    reached = [math.isfinite(seconds) for each in side for seconds in each.seconds.values()]
    return 2 * sum(reached) > len(reached)


def _row(measured: Sequence[Measured]) -> dict[str, Any]:
    if _failure(measured):
        return {"sessions": len(measured), "seconds": NOTHING, "reached": f"0/{sum(len(each.seconds) for each in measured)}"}
    reached = [[x for x in each.seconds.values() if math.isfinite(x)] for each in measured]
    several = [geometric_interval(each).value for each in reached if each]
    values = several if len(measured) > 1 else reached[0]
    seconds = geometric_interval(values) if values else Estimate(math.inf, math.nan, math.nan, 0)
    counted = f"{sum(map(len, reached))}/{sum(len(each.seconds) for each in measured)}"
    return {"sessions": len(measured), "seconds": seconds, "reached": counted}


def _judged(step: Step, verdict: str, same_within: float, threshold: float | None) -> dict[str, Any]:
    change = step.change
    low, high = ends = change.interval() if math.isfinite(change.mean) else (math.nan, math.nan)
    word, regression = judged(change, ends, verdict, same_within, threshold)
    word = TIMES.get(word, word)
    if step.failure:
        word, regression = step.failure, True
    elif step.reached == (True, False):
        word, regression = "no longer reached", True
    elif step.reached == (False, True):
        word, regression = "reached now", False
    if step.new_flags:
        word, regression = f"flagged: {', '.join(FLAGS[flag] for flag in sorted(step.new_flags))}", True
    return {
        "step": Estimate(exp(change.mean), exp(low), exp(high), min(change.sessions)),
        "verdict": word,
        "regression": regression,
    }


def _table(
    sessions: Sequence[Results], order: Mapping[str, str], threshold: float | None, same_within: float, without_twins: int
) -> Table:
    untested = f"{100 * same_within:g} %, or {100 * UNTESTED_THRESHOLD:g} % where times are not tested"
    limit = untested if threshold is None else f"{100 * threshold:g} %"
    count = f"{plural(len(sessions), 'session')} of {plural(len(order), 'revision')}"
    note = f"{count}; steps are ratios of seconds to those of the revision before that did not fail."
    twins = f"{plural(without_twins, 'session')} without A/A twins: {WITHOUT_TWINS}"
    return Table(
        "history",
        "Seconds to each target over revisions",
        " ".join([note, *[twins] * (without_twins > 0), *cautions(sessions, sessions)]),
        [
            Column("scene", "Scene."),
            Column("contestant", "Engine and the settings that vary."),
            Column("target", "Target of the error.", "exact"),
            Column("revision", "Revision of the renderer under test, in the order in which they were first measured."),
            Column("since", "When the revision was first measured."),
            Column("sessions", "Sessions (results folders) of the revision.", "count"),
            Column("seconds", "Warm seconds to the target, with the 95 % interval over sessions, or blocks.", "estimate"),
            Column("reached", "Runs that reached the target, of all."),
            Column("step", "Seconds over those of the revision before, with the 95 % interval.", "estimate"),
            Column(
                "verdict",
                "faster, slower, same or unresolved, with a family-wise error rate of 5 % (Holm) over the table: tested by "
                "block where a session with A/A twins holds both revisions, else between sessions, three or more of each. "
                "slower or drift, faster or drift: beyond the threshold, but not tested. Else: failed, no longer reached, "
                "reached now, flagged.",
            ),
            Column("regression", f"Whether it is longer by more than {limit}, failed, no longer reached, or flagged.", "flag"),
        ],
    )
