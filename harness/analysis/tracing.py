"""Rates and error rates of a comparison by rays, as rows of a table; ratios and verdicts are those of races."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.analysis.columns import Column, Table
from harness.statistics import Estimate, Ratio, geometric_interval, noise_floor, proportion_interval, race, twin_distance
from harness.trace.records import Entry, TraceResults

COLUMNS = [
    Column("scene", "Scene."),
    Column("primitives", "Triangles, spheres and other shapes of the scene.", "count"),
    Column("rays", "Set of rays: camera, shadow or incoherent."),
    Column("engine", "Engine; twin: the A/A twin of the baseline."),
    Column("version", "Version of the engine."),
    Column("accelerator", "Accelerator."),
    Column("precision", "Precision setting; empty: the engine's own."),
    Column("threads", "Threads of the engine.", "count"),
    Column("mrays_per_second", "Million rays per second of wall time: geometric mean over blocks.", "estimate", "Mrays/s"),
    Column(
        "mrays_per_cpu_second", "Million rays per second of processor time, of all threads together.", "estimate", "Mrays/cpu s"
    ),
    Column("ratio", "Rate over that of the baseline, paired by blocks; above 1 is faster.", "ratio", "over baseline"),
    Column("verdict", "faster, slower, same or unresolved, as in races."),
    Column("checked", "Rays whose answers were compared with exact ones.", "count"),
    Column("wrong", "Hits of another surface, or at another distance.", "count"),
    Column("missed", "Misses where something is hit.", "count"),
    Column("false_hits", "Hits reported where the ray meets nothing.", "count"),
    Column("error_rate", "Share of answers that are wrong in any way, with its exact interval.", "estimate"),
    Column("hard", "Rays aimed at edges and vertices that triangles share.", "count", "hard rays"),
    Column("leaks", "Hard rays that went through.", "count"),
    Column("leak_rate", "Share of hard rays that went through, with its exact interval.", "estimate"),
    Column("t_median", "Median relative error of the distance of right hits.", "number", "t error: median"),
    Column("t_p999", "The 99.9 % quantile of that error.", "number", "99.9 %"),
    Column("t_worst", "The largest of these errors.", "number", "worst"),
    Column("build_seconds", "Seconds to build tracer and accelerator: median over blocks.", "number", "build [s]"),
    Column("first_call_seconds", "Seconds of the first call, which may compile: median.", "number", "first call [s]"),
    Column("blocks", "Blocks measured.", "count"),
    Column("contended", "Blocks that were disturbed by other work of the machine.", "count"),
    Column("unstable", "Whether answers differed between blocks.", "flag"),
    Column("state", "done, failed, timeout or skipped."),
    Column("message", "Why it was skipped or has failed."),
]


def trace_table(results: TraceResults) -> Table:
    """A row an entry, in the order of the file."""
    same_within = results.experiment.same_within
    rows = [row for group in races(results) for row in _rows(group, same_within)]
    note = (
        "Wrong answers are counted against exact ones, in decimals of 80 digits. 95 % intervals; of 0 errors the end of an "
        "interval is the bound below which the rate lies with 95 % confidence."
    )
    return Table("trace", "Rays per second and wrong answers", note, COLUMNS, rows)


def races(results: TraceResults) -> list[list[Entry]]:
    """Entries by scene, set of rays and threads, in the order of the file."""
    found: dict[Any, list[Entry]] = {}
    for entry in results.entries:
        found.setdefault(entry.race, []).append(entry)
    return list(found.values())


def rates(entry: Entry, cpu: bool = False) -> list[float]:
    """Million rays per second of each block: of wall time, or of processor time as far as that is known."""
    seconds = [(each.cpu_seconds or math.nan) if cpu else each.seconds for each in entry.timings]
    return [1e-6 * entry.count * each.passes / s for each, s in zip(entry.timings, seconds, strict=True)]


def _rows(group: Sequence[Entry], same_within: float) -> list[dict[str, Any]]:
    ratios = _ratios(group, same_within)
    return [_row(entry, ratio) for entry, ratio in zip(group, ratios, strict=True)]


def _ratios(group: Sequence[Entry], same_within: float) -> list[Ratio | None]:
    """The ratio of each to the baseline; None for the baseline itself, and where there is nothing to compare."""
    timed = [index for index, entry in enumerate(group) if entry.timings and entry.state == "done"]
    base = next((i for i in timed if group[i].baseline), None)
    found: list[Ratio | None] = [None] * len(group)
    if base is None or len(timed) < 2:
        return found
    blocks = max(each.block for i in timed for each in group[i].timings) + 1
    times = np.full((len(group), blocks), math.nan)
    for i in timed:
        for each in group[i].timings:
            times[i, each.block] = math.log(each.seconds / each.passes)
    twins = [(base, i) for i in timed if group[i].twin]
    distances = [twin_distance(times, times, *pair) for pair in twins]
    others = [i for i in timed if i != base]
    ranked = np.array([i in timed and not entry.twin for i, entry in enumerate(group)])
    made = race(
        times,
        times,
        [(i, base) for i in others],
        noise_floor(distances, distances),
        ranked=ranked,
        twins=twins,
        margin=same_within,
    )
    for i, ratio in zip(others, made.ratios, strict=True):
        found[i] = ratio
    return found


def _row(entry: Entry, ratio: Ratio | None) -> dict[str, Any]:
    same = ("scene", "primitives", "rays", "version", "accelerator", "precision", "threads", "state", "message", "unstable")
    row: dict[str, Any] = {key: getattr(entry, key) for key in same}
    row["engine"] = f"{entry.engine} (twin)" if entry.twin else entry.engine
    row["verdict"] = "baseline" if entry.baseline else ratio.verdict if ratio else ""
    if ratio:
        row["ratio"] = Estimate(*ratio[:4])
    if entry.timings:
        row |= {
            "mrays_per_second": geometric_interval(rates(entry)),
            "mrays_per_cpu_second": geometric_interval(rates(entry, cpu=True)),
            "build_seconds": float(np.median([each.build_seconds for each in entry.timings])),
            "first_call_seconds": float(np.median([each.first_call_seconds for each in entry.timings])),
            "blocks": len(entry.timings),
            "contended": sum(each.contended for each in entry.timings),
        }
    if entry.answers:
        answers = entry.answers
        row |= {key: value for key, value in answers.model_dump().items() if value is not None}
        row["error_rate"] = proportion_interval(answers.faults, answers.checked)
        row["leak_rate"] = proportion_interval(answers.leaks, answers.hard)
    return row
