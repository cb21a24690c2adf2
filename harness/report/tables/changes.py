"""What changed between two sides, each of one or more results folders: for regressions.

A folder is one session, in however many runs it was measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from engines.errors import ConfigError
from harness.analysis import analyse, seconds_per_sample
from harness.analysis.axes import matching
from harness.analysis.columns import Column, Table
from harness.analysis.equivalence import common_spp, same_images
from harness.analysis.model import FLAGS, OF_THE_TIME
from harness.metrics import metric_title
from harness.statistics import Change, Estimate, change_of_errors, change_of_times, judge_changes
from harness.statistics.intervals import exp
from harness.statistics.sessions import FEWEST_SESSIONS
from harness.store.records import BROKEN, Settings
from harness.store.results import Contestant, Results, fixed_seconds, point_error

TIMES = {"rise": "slower", "fall": "faster"}
ERRORS = {"rise": "worse", "fall": "better"}
UNTESTED_THRESHOLD = 0.1
"""Share beyond which a time has become longer, where drift is not separated from change and no other share is asked for."""
Sessions = Sequence[tuple[Results, Contestant]]
"""A contestant in each session that measured it."""


class Compared(NamedTuple):
    """A measure of a contestant on both sides; `words` are those for a rise and a fall."""

    old: Sessions
    measure: str
    change: Change
    words: Mapping[str, str]


def changes(before: Sequence[Results], after: Sequence[Results], threshold: float | None = None) -> Table:
    """One row a contestant of both sides and measure: seconds per sample, start-up seconds, error, image.

    Contestants match where scene and settings are equal; the engine's version may differ, and the machine unless a folder holds
    several. With three or more sessions a side times are tested between sessions; else there is no verdict on them, and a
    row says whether the interval within sessions lies beyond `threshold`. A row is a `regression` where something failed,
    where an image is flagged or different now, and where a time or error is higher by more than `threshold`: the lower end of
    its interval is. Without one that is the margin of *same*, and 10 % for times that are not tested.

    Raises `ConfigError` where one measurement stands in two folders of a side.
    """
    sessions_differ([before, after] if len(before) == len(after) == 1 else [[*before, *after]])
    same_within = after[0].config.same_within
    ours, theirs = _by_key(before, after)
    table = _table(before, after, same_within, threshold)
    moved = _moved(before, after)
    common = [key for key in ours if key in theirs and key.scene not in moved]
    compared = [each for key in common for each in _compared(ours[key], theirs[key])]
    verdicts = judge_changes([each.change for each in compared], same_within)
    flags = [_flags_of(side) for side in (before, after)]
    pictured = {key: _image_row(ours[key], theirs[key], flags, len(common)) for key in common}
    table.rows += [_row(each, verdict, same_within, threshold) for each, verdict in zip(compared, verdicts, strict=True)]
    table.rows += [{**_who(ours[key]), **row} for key, row in pictured.items() if row]
    order = [(key.scene, ours[key][0][1].name) for key in common]
    table.rows.sort(key=lambda row: order.index((row["scene"], row["contestant"])))
    table.rows += [{**_who(ours[key]), "verdict": "scene changed"} for key in ours if key in theirs and key.scene in moved]
    gone, new = (sorted(keys, key=Settings.order) for keys in (ours.keys() - theirs.keys(), theirs.keys() - ours.keys()))
    table.rows += [_only_before(ours[key], key, after) for key in gone]
    table.rows += [{**_who(theirs[key]), "verdict": "only after"} for key in new]
    return table


def _table(before: Sequence[Results], after: Sequence[Results], same_within: float, threshold: float | None) -> Table:
    folders = [", ".join(str(results.folder) for results in side) for side in (before, after)]
    limits = f"{100 * same_within:g} %, or {100 * UNTESTED_THRESHOLD:g} % where times are not tested"
    if threshold is not None:
        limits = f"{100 * threshold:g} %"
    note = [f"{folders[0]} before, {folders[1]} after; ratios are after over before.", sessions_text(before, after)]
    return Table(
        "changes",
        "What changed",
        " ".join([*note, *cautions(before, after)]),
        [
            Column("scene", "Scene."),
            Column("contestant", "Engine and the settings that vary."),
            Column(
                "measure",
                "seconds per sample (warm), start-up seconds, error at the most samples that both sides have, or image.",
            ),
            Column("ratio", "After over before, with its 95 % interval.", "estimate"),
            Column("sessions", "Number of sessions before and after."),
            Column(
                "verdict",
                "Times: faster, slower, same or unresolved, with a family-wise error rate of 5 % (Holm). slower or "
                "drift, faster or drift: beyond the threshold, but not tested between sessions. Errors: better, worse, same "
                "or unresolved. Images: flagged now, or identical, equivalent, different or unresolved. Else: failed, scene "
                "changed, only before, only after.",
            ),
            Column(
                "regression",
                "Whether it failed, is flagged now, has another image, or is higher by more than "
                f"{limits} with its whole interval.",
                "flag",
            ),
        ],
    )


def sessions_text(before: Sequence[Results], after: Sequence[Results]) -> str:
    """How times are tested."""
    counts = len(before), len(after)
    if min(counts) >= FEWEST_SESSIONS:
        return f"Times are tested between {counts[0]} and {counts[1]} sessions."
    number = "One session each" if counts == (1, 1) else f"{counts[0]} and {counts[1]} sessions"
    return f"{number}: drift is not separated from change; {FEWEST_SESSIONS} sessions a side would be tested."


def cautions(before: Sequence[Results], after: Sequence[Results]) -> list[str]:
    """What stands in the way of a comparison: other machines, another metric, scenes with other content."""
    machines = {frozenset(set().union(*_seen(results, "env_id").values())) for results in (*before, *after)}
    found = []
    if len(machines) > 1:
        found.append("Measured on different machines or with other library versions: times say nothing about the code.")
    metrics = list(dict.fromkeys(results.metric for results in (*before, *after)))
    if len(metrics) > 1:
        found.append(f"Errors are {' and '.join(map(metric_title, metrics))}: not compared.")
    if moved := _moved(before, after):
        found.append(f"Scenes whose content has changed: {', '.join(moved)}.")
    return found


def _moved(before: Sequence[Results], after: Sequence[Results]) -> list[str]:
    """Scenes of both sides of which not all folders hold the same content."""
    hashes: list[dict[str, set[str]]] = [{}, {}]
    for side, found in zip((before, after), hashes, strict=True):
        for results in side:
            for scene, seen in _seen(results, "scene_hash").items():
                found.setdefault(scene, set()).update(seen)
    return sorted(scene for scene in hashes[0].keys() & hashes[1].keys() if len(hashes[0][scene] | hashes[1][scene]) > 1)


def _seen(results: Results, key: str) -> dict[str, set[str]]:
    """Scene -> the values of a key among its measured cells."""
    found: dict[str, set[str]] = {}
    for cell in results.cells:
        if cell.state == "done":
            found.setdefault(cell.scene, set()).add(getattr(cell, key))
    return found


def sessions_differ(sides: Sequence[Sequence[Results]]) -> None:
    """Refuses folders of one side that share measurements: a session counts once, and copies have no drift."""
    for side in sides:
        seen: dict[tuple[str, str, float], Results] = {}
        for results in side:
            for cell in results.cells:
                if cell.state != "done" or not cell.points:
                    continue
                own = cell.cell_id, cell.time, cell.end.seconds
                if (other := seen.setdefault(own, results)) is not results:
                    raise ConfigError(f"{results.folder}: has measurements of {other.folder}: a session counts once")


def _by_key(*sides: Sequence[Results]) -> list[dict[Settings, list[tuple[Results, Contestant]]]]:
    """The measured contestants of each side by what has to be equal for two to be the same."""
    several = any(len({c.settings.machine for c in results.contestants if c.done}) > 1 for side in sides for results in side)
    found: list[dict[Settings, list[tuple[Results, Contestant]]]] = []
    for side in sides:
        groups: dict[Settings, list[tuple[Results, Contestant]]] = {}
        for results in side:
            for contestant in results.contestants:
                if contestant.done:
                    key = replace(matching(contestant.settings), machine=contestant.settings.machine if several else "")
                    groups.setdefault(key, []).append((results, contestant))
        found.append(groups)
    return found


def _who(sessions: Sessions) -> dict[str, Any]:
    return {"scene": sessions[0][1].settings.scene, "contestant": sessions[0][1].name}


def _only_before(old: Sessions, key: Settings, after: Sequence[Results]) -> dict[str, Any]:
    """A row for what has no measurement after: it failed, or nobody asked for it."""
    cells = [
        cell
        for results in after
        for c in results.contestants
        for cell in c.cells
        if key in (matching(c.settings), replace(matching(c.settings), machine=c.settings.machine))
    ]
    failed = any(cell.state in BROKEN for cell in cells)
    return {**_who(old), "verdict": "failed" if failed else "only before", "regression": failed}


def _compared(old: Sessions, new: Sessions) -> list[Compared]:
    def times(side: Sessions, start: bool) -> list[list[float]]:
        if start:
            return [[fixed_seconds(cell) for cell in c.done] for _, c in side]
        return [list(seconds_per_sample(c).values()) for _, c in side]

    errors = change_of_errors(_errors(old, old, new), _errors(new, old, new), (len(old), len(new)))
    return [
        Compared(old, "seconds per sample", change_of_times(times(old, False), times(new, False)), TIMES),
        Compared(old, "start-up seconds", change_of_times(times(old, True), times(new, True)), TIMES),
        Compared(old, "error", errors, ERRORS),
    ]


def judged(
    change: Change, ends: tuple[float, float], verdict: str, same_within: float, threshold: float | None
) -> tuple[str, bool]:
    """The verdict on a change of a mean between `ends`, or that it may be drift; and whether it is a regression."""
    limit = threshold if threshold is not None else same_within if change.tested else UNTESTED_THRESHOLD
    longer, shorter = ends[0] > math.log1p(limit), ends[1] < -math.log1p(limit)
    if not change.tested and (longer or shorter):
        verdict = f"{TIMES['rise' if longer else 'fall']} or drift"
    return verdict, longer and (verdict == "rise" or not change.tested)


def _row(each: Compared, verdict: str, same_within: float, threshold: float | None) -> dict[str, Any]:
    change = each.change
    low, high = ends = change.interval()
    word, regression = judged(change, ends, verdict, same_within, threshold)
    return {
        **_who(each.old),
        "measure": each.measure,
        "sessions": "{} and {}".format(*change.sessions),
        "ratio": Estimate(exp(change.mean), exp(low), exp(high), min(change.sessions)),
        "verdict": each.words.get(word, word),
        "regression": regression,
    }


def _errors(side: Sessions, old: Sessions, new: Sessions) -> dict[int, float]:
    """Seed -> error of a side at the most samples that all have; empty where metrics differ or samples do not meet."""
    spp = common_spp(*(contestant for _, contestant in (*old, *new)))
    if len({results.metric for results, _ in (*old, *new)}) > 1:
        return {}
    return {
        cell.seed: point_error(point, results.metric)[0]
        for results, contestant in side
        for cell in contestant.done
        for point in cell.points
        if point.spp == spp
    }


def _flags_of(side: Iterable[Results]) -> dict[int, set[str]]:
    """Flags of contestants' images, by the contestant's `id`."""
    verdicts = (verdict for results in side for verdict in analyse(results).verdicts)
    return {id(verdict.contestant): set(verdict.flags) - OF_THE_TIME for verdict in verdicts}


def _image_row(old: Sessions, new: Sessions, flags: Sequence[Mapping[int, set[str]]], comparisons: int) -> dict[str, Any]:
    """What is to be said of the images; empty where there are none and no flag is new."""
    known, now = (
        set().union(*(found.get(id(contestant), ()) for _, contestant in side))
        for side, found in zip((old, new), flags, strict=True)
    )
    image = {"measure": "image", "sessions": f"{len(old)} and {len(new)}"}
    if now - known:
        return {**image, "verdict": f"flagged: {', '.join(FLAGS[flag] for flag in sorted(now - known))}", "regression": True}
    found = same_images(*old[0], *new[0], comparisons)
    return {**image, "verdict": found.verdict, "regression": found.verdict == "different"} if found else {}
