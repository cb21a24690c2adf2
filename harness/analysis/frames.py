"""Results as DataFrames: `open_results(folder)`, and the documented tables behind them.

points.csv, ttq.csv and phases.csv are three of them, written to the results folder; the tables for people are made from them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, get_args

import pandas as pd

from harness.analysis.columns import Column, Table
from harness.analysis.model import FLAGS, OF_THE_ESTIMATOR, OF_THE_TIME, Analysis, Verdict
from harness.analysis.verdicts import analyse
from harness.metrics import METRIC_MEANINGS
from harness.store.records import Cell, Machine
from harness.store.results import CHOICES, PHASES, Results, fixed_seconds, load_results

CONTESTANT = Column("contestant", "Engine and those settings that differ within this experiment.")
IDENTITY = [
    Column("scene", "Scene that was rendered."),
    Column("engine", "Engine."),
    Column("engine_version", "The engine's version."),
    Column("accelerator", "Accelerator with its options."),
    Column("shader", "Shader with its options."),
    Column("sampler", "Sampler with its options."),
    Column("precision", "float64 or float32."),
    Column("threads", "Threads.", "count"),
    Column("width", "Pixels.", "count"),
    Column("height", "Pixels.", "count"),
    Column("label", "A/A label, empty for ordinary cells."),
    Column("division", "Division in which it is ranked: closed or open."),
]
SECONDS = Column(
    "seconds",
    "Geometric mean over seeds, Student's 95 % interval. inf if some seed did not reach the target: the time is then above the "
    "lower end. If some seeds had reached it at their first checkpoint, the lower end is 0: the time is below the upper end.",
    "estimate",
)
CELL = [
    Column("cell_id", "Hash of the spec."),
    Column("env_id", "Hash of the machine and library versions."),
    Column("worker", "Address of the Dask worker that measured it; empty without a cluster."),
    *IDENTITY,
    Column("block", "Which repeat of the whole experiment it belongs to.", "count"),
    Column("seed", "Seed of the sampler.", "count"),
]


class ResultFrames:
    """A results folder as four DataFrames; each is made when it is first asked for.

    `points`: one row per checkpoint. `cells`: one row per cell, in any state. `times_to_quality`: one row per contestant,
    target and start (warm or cold). `verdicts`: one row per scene, target and contestant. Two rows belong to one contestant if
    `scene` and `contestant` are equal. `times_to_quality` and `verdicts` read the images of the folder, which takes longer.
    """

    def __init__(self, results: Results) -> None:
        self.results = results

    @cached_property
    def analysis(self) -> Analysis:
        """What is concluded from the results."""
        return analyse(self.results)

    @cached_property
    def points(self) -> pd.DataFrame:
        return points(self.results).frame

    @cached_property
    def cells(self) -> pd.DataFrame:
        return cells(self.results).frame

    @cached_property
    def times_to_quality(self) -> pd.DataFrame:
        return times_to_quality(self.analysis).frame

    @cached_property
    def verdicts(self) -> pd.DataFrame:
        return verdicts(self.analysis).frame

    def columns(self, name: str) -> dict[str, str]:
        """What each column of a frame means: `columns("points")["seconds"]`. Raises `KeyError` for another name."""
        tables = {
            "points": (points, self.results),
            "cells": (cells, self.results),
            "times_to_quality": (times_to_quality, self.analysis),
            "verdicts": (verdicts, self.analysis),
        }
        make, source = tables[name]
        return {name: meaning for column in make(source).columns for name, meaning in column.fields.items()}


def open_results(folder: str | Path) -> ResultFrames:
    """The results in a folder, as DataFrames: that of a run, a merged one, or an archive.

    Raises `engines.errors.ConfigError`, one line, where there is no such folder, where no run has written to it, where its
    events are damaged, and where they are of another version of the format.
    """
    return ResultFrames(load_results(folder))


def points(results: Results) -> Table:
    """One row a checkpoint of every cell that has one."""
    measured = [cell for cell in results.cells if cell.points]
    before = [
        CONTESTANT,
        *CELL,
        Column("state", "done, or timeout where the cell was cut short."),
        Column("order", "Position of the cell in the run.", "count"),
        Column("spp", "Samples per pixel so far.", "count"),
        Column("seconds", "Seconds inside render calls so far (warm).", "number"),
        Column("cold_seconds", "The same with import, load, build and compilation.", "number"),
        Column("rays", "Rays so far.", "number"),
    ]
    after = [
        Column("contended", "Whether other work disturbed the timing.", "flag"),
        Column("image", "The checkpoint's image, relative to the results folder."),
    ]
    names = dict.fromkeys(key for cell in measured for point in cell.points for key in point.metrics)
    metrics = [Column(name, metric_meaning(name), "number") for name in names]
    contestants = _contestants(results)
    rows = []
    for cell in measured:
        shared = {**_cell(cell), "contestant": contestants[cell.cell_id], "contended": cell.machine.contended}
        rows += [
            {**point.metrics, **dict(point), **shared, "cold_seconds": fixed_seconds(cell) + point.seconds}
            for point in cell.points
        ]
    taken = {column.name for column in (*before, *after)}
    columns = [*before, *(column for column in metrics if column.name not in taken), *after]
    return Table("points", "Checkpoints", "One row per checkpoint.", columns, rows)


def times_to_quality(analysis: Analysis) -> Table:
    """One row a contestant, target and start (warm or cold)."""
    table = Table(
        "ttq",
        "Time to quality",
        "One row per contestant, target and start.",
        [
            CONTESTANT,
            *IDENTITY,
            Column("metric", "Metric of the target."),
            Column("target", "Value to reach.", "exact"),
            Column("start", "warm: rendering alone; cold: with import, load, build and compilation."),
            SECONDS,
            Column("reached", "Seeds that reached the target.", "count"),
            Column("at_first", "Of these, how many were there at their first checkpoint (an upper bound).", "count"),
            Column("seeds", "Seeds that were run.", "count"),
        ],
    )
    for verdict in analysis.verdicts:
        who = {**_cell(verdict.contestant.done[0]), "contestant": verdict.contestant.name, "metric": analysis.results.metric}
        for start, times in (("warm", verdict.warm), ("cold", verdict.cold)):
            for target, time in zip(analysis.results.targets, times, strict=True):
                table.rows.append(
                    {
                        **who,
                        "target": target,
                        "start": start,
                        "seconds": (time.value, time.low, time.high),
                        "reached": time.reached,
                        "at_first": time.at_first,
                        "seeds": time.seeds,
                    }
                )
    return table


def cells(results: Results) -> Table:
    """One row a cell, whatever became of it."""
    counters = dict.fromkeys(key for cell in results.cells for key in cell.counters)
    told = {name for cell in results.cells for name in cell.machine.model_fields_set}
    machine = {name: _kind_of(field.annotation) for name, field in Machine.model_fields.items() if name in told}
    columns = [
        CONTESTANT,
        *CELL,
        Column("state", "done, failed, timeout or skipped."),
        Column("order", "Position of the cell in the run.", "count"),
        *(Column(f"{phase}_seconds", f"Seconds of the phase {phase}.", "number") for phase in PHASES),
        Column("warm_build_seconds", "Seconds of the second build, of the renderer that is timed.", "number"),
        *(Column(f"counter_{name}", f"The engine's counter {name}.", "number") for name in counters),
        *(Column(f"machine_{name}", f"The machine during the cell: {name}.", kind) for name, kind in machine.items()),
        Column("message", "Why it has no result."),
    ]
    contestants = _contestants(results)
    rows = [
        {
            **dict(cell.phases),
            "render_seconds": cell.render_seconds,
            **_cell(cell),
            "contestant": contestants[cell.cell_id],
            **{f"counter_{name}": value for name, value in cell.counters.items()},
            **{f"machine_{name}": value for name, value in cell.machine},
            "message": cell.message,
        }
        for cell in results.cells
    ]
    return Table("phases", "Phases", "One row per cell.", columns, rows)


def verdicts(analysis: Analysis) -> Table:
    """One row a scene, target and contestant."""
    flags = "; ".join(f"{name}: {words}" for name, words in FLAGS.items())
    allowed, allowed_open = (", ".join(sorted(names)) for names in (OF_THE_TIME, OF_THE_ESTIMATOR))
    margin = f"{100 * analysis.results.config.same_within:g} %"
    table = Table(
        "verdicts",
        "Verdicts",
        "One row per scene, target and contestant that has a measured cell.",
        [
            IDENTITY[0],
            CONTESTANT,
            Column("metric", "Metric of the target."),
            Column("target", "Value to reach.", "exact"),
            *IDENTITY[1:],
            SECONDS._replace(meaning=f"Seconds of rendering alone (warm) until the target. {SECONDS.meaning}"),
            Column("cold_seconds", "The same with import, load, build and compilation.", "estimate"),
            Column("reached", "Seeds that reached the target.", "count"),
            Column("at_first", "Of these, how many were there at their first checkpoint (an upper bound).", "count"),
            Column("seeds", "Seeds that were run.", "count"),
            Column("failed_cells", "Cells that failed or ran out of time.", "count"),
            Column(
                "baseline",
                "Contestant that it is compared with: the config's pairs name it, it differs in a single factor, "
                "or it is the baseline of the race. Unknown if there is none.",
            ),
            Column("factor", "Factors in which the two differ, joined by `and`."),
            Column("no_ratio", "Why it is compared with none; empty where it is."),
            Column(
                "ratio",
                "Seconds of the baseline over these, paired by block: above 1 is faster. Where a target was not "
                "reached, only an end of the interval is known. Unknown where one of the two has a flag that disqualifies it.",
                "ratio",
            ),
            Column(
                "verdict",
                "faster or slower: beyond the noise floor, with a family-wise error rate of 5 % (Holm). same: "
                f"the 90 % interval lies within {margin}. Else unresolved. Empty where nothing is compared.",
            ),
            Column(
                "noise_floor",
                "Difference from 1 that a ratio must exceed, from the scene's A/A twin; unknown if that was not measured.",
                "percent",
            ),
            Column(
                "possible_winner",
                "Whether it may be the fastest of its scene, shader, size, division and machine, among "
                "those that no flag disqualifies: no test finds it slower than another. False for all if none reached the "
                "target.",
                "flag",
            ),
            Column(
                "flags",
                f"Names joined by spaces. All but {allowed} disqualify, in the open division also all but "
                f"{allowed_open}. {flags}.",
            ),
        ],
    )
    table.rows = [
        {
            **_verdict(verdict, index),
            "metric": analysis.results.metric,
            "target": target,
            "noise_floor": math.expm1(analysis.floor(verdict.contestant.settings.scene, index)),
        }
        for verdict in analysis.verdicts
        for index, target in enumerate(analysis.results.targets)
    ]
    return table


def _verdict(verdict: Verdict, index: int) -> dict[str, Any]:
    """A verdict on the target of `index`."""
    warm, cold, ratio = verdict.warm[index], verdict.cold[index], verdict.quality_speedups[index]
    return {
        **_cell(verdict.contestant.done[0]),
        "contestant": verdict.contestant.name,
        "seconds": (warm.value, warm.low, warm.high),
        "cold_seconds": (cold.value, cold.low, cold.high),
        "reached": warm.reached,
        "at_first": warm.at_first,
        "seeds": warm.seeds,
        "failed_cells": verdict.failures,
        "baseline": verdict.baseline.name if verdict.baseline else None,
        "factor": verdict.factors or None,
        "no_ratio": verdict.no_ratio,
        "ratio": ratio[:3] if ratio else None,
        "verdict": ratio.verdict if ratio else "unresolved" if verdict.baseline else "",
        "possible_winner": verdict.possible_winner[index],
        "flags": " ".join(verdict.flags_of(index)),
    }


def by_contestant(frame: pd.DataFrame, results: Results) -> pd.DataFrame:
    """The rows of `cells` or `points` in the order of the contestants, and of each by block."""
    keys = ["scene", "contestant"]
    order = pd.DataFrame([(c.settings.scene, c.name) for c in results.contestants], columns=keys, dtype="string")
    return order.drop_duplicates().merge(frame.sort_values("block", kind="stable"), on=keys)


def metric_meaning(name: str) -> str:
    """The sentence for a metric column: `relmse_e0.01_se` is looked up as `relmse_se`."""
    base, _, rest = name.partition("_e")
    if rest[:1].isdigit():
        _, _, suffix = rest.partition("_")
        return METRIC_MEANINGS.get(f"{base}_{suffix}" if suffix else base, name)
    return METRIC_MEANINGS.get("mean" if name.startswith("mean_") else name, name)


def _contestants(results: Results) -> dict[str, str]:
    """Cell id -> the name of its contestant."""
    return {cell.cell_id: contestant.name for contestant in results.contestants for cell in contestant.cells}


def _cell(cell: Cell) -> Mapping[str, Any]:
    settings = cell.settings
    texts = {axis: str(getattr(settings, axis)) for axis in CHOICES}
    plain = {column.name: getattr(cell, column.name) for column in CELL if column.name not in texts}
    return {**plain, **texts, "label": settings.label, "state": cell.state, "order": cell.order}


def _kind_of(annotation: Any) -> str:
    """The kind of a column of values of a type, or None."""
    kinds = {bool: "flag", int: "count", float: "number"}
    types = [getattr(kind, "__origin__", kind) for kind in (annotation, *get_args(annotation))]
    return next((kinds[kind] for kind in types if kind in kinds), "text")
