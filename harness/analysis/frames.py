"""Results as DataFrames: `open_results(folder)`, and the documented tables behind them.

points.csv, ttq.csv and phases.csv are three of them, written to the results folder; the tables for people are made from them.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from harness.analysis.columns import Column, Table, rows_of
from harness.analysis.measurements import CONTESTANT, IDENTITY, SCENE, cells, of_cell, points
from harness.analysis.model import CONTESTANT_KEYS, FLAGS, NOISY, OF_THE_ESTIMATOR, OF_THE_TIME, Analysis, Frame
from harness.analysis.verdicts import analyse
from harness.store.results import Results, load_results

SECONDS = Column(
    "seconds",
    "Geometric mean over seeds, Student's 95 % interval. inf if some seed did not reach the target: the time is then above the "
    "lower end. If some seeds had reached it at their first checkpoint, the lower end is 0: the time is below the upper end.",
    "estimate",
)


class ResultFrames:
    """A results folder as five DataFrames; each is made when it is first asked for.

    `points`: one row per checkpoint. `cells`: one row per cell, in any state. `times_to_quality`: one row per contestant,
    target and start (warm or cold). `verdicts`: one row per scene, target and contestant. `by_axis`: one row per axis,
    contestant and measure. Two rows belong to one contestant if `scene` and `contestant` are equal. All but `points` and
    `cells` read the images of the folder, which takes longer.
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

    @cached_property
    def by_axis(self) -> pd.DataFrame:
        return by_axis(self.analysis).frame

    def columns(self, name: str) -> dict[str, str]:
        """What each column of a frame means: `columns("points")["seconds"]`. Raises `KeyError` for another name."""
        tables = {
            "points": (points, self.results),
            "cells": (cells, self.results),
            "times_to_quality": (times_to_quality, self.analysis),
            "verdicts": (verdicts, self.analysis),
            "by_axis": (by_axis, self.analysis),
        }
        make, source = tables[name]
        return {name: meaning for column in make(source).columns for name, meaning in column.fields.items()}


def open_results(folder: str | Path) -> ResultFrames:
    """The results in a folder, as DataFrames: that of a run, a merged one, or an archive.

    Raises `engines.errors.ConfigError`, one line, where there is no such folder, where no run has written to it, where its
    events are damaged, and where they are of another version of the format.
    """
    return ResultFrames(load_results(folder))


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
    table.rows = rows_of(_identities(analysis).merge(analysis.times, on=CONTESTANT_KEYS), table.columns)
    return table


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
                "Contestant that it is compared with: the baseline of its race, which the config's `baseline` names, or which "
                "has the first value, as written, of every axis; of an A/A twin what it repeats. Unknown if there is none.",
            ),
            Column("factor", "Settings, and options of choices, in which the two differ, joined by `and`."),
            Column("no_ratio", "Why it is compared with none; empty where it is."),
            Column(
                "ratio",
                "Seconds of the baseline over these, paired by block: above 1 is faster. Where a target was not "
                "reached, only an end of the interval is known. Unknown where one of the two has a flag that disqualifies it.",
                "ratio",
            ),
            Column(
                "verdict",
                "faster or slower, with a family-wise error rate of 5 % (Holm). same: "
                f"the 90 % interval lies within {margin}. Else unresolved. Empty where nothing is compared.",
            ),
            Column(
                "persistent_spread",
                "By how much two equal contestants differ in all blocks alike on this machine, from its A/A twins: a standard "
                "deviation, by which the intervals of ratios are widened. Unknown without twins: all is then unresolved.",
                "percent",
            ),
            Column("twins", "A/A twins of the machine that the persistent spread was found from.", "count"),
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
    found = _identities(analysis).merge(analysis.by_target, on=CONTESTANT_KEYS)
    noisy = np.where(found.reliable, "", f" {NOISY}")
    found["flags"] = (found["flags"] + noisy).str.strip()
    table.rows = rows_of(found.replace({"baseline": "", "factor": ""}, None), table.columns)
    return table


def by_axis(analysis: Analysis) -> Table:
    """One row an axis, contestant and measure; those of the config's pairs come last."""
    table = Table(
        "by_axis",
        "By axis",
        "Contestants that differ in one setting, or one option, alone: each against the one with the first value as the config "
        "writes them. Behind these the config's pairs.",
        [
            Column("axis", "Setting, or option of a shader, sampler or accelerator. Of a pair all in which its sides differ."),
            Column("value", "Value of the contestant."),
            Column("over", "Value of the baseline."),
            SCENE,
            Column("settings", "What the two have in common, of what varies along the axis."),
            CONTESTANT,
            Column("baseline", "Contestant that it is compared with."),
            Column("measure", "What is compared: seconds per sample, or warm seconds to a target."),
            Column("ratio", "Seconds of the baseline over these, paired by block: above 1 is faster.", "ratio", "speed-up"),
            Column("blocks", "Blocks that both have.", "count"),
            Column("verdict", "faster, slower, same or unresolved; empty where nothing is compared."),
            Column("no_ratio", "Why the two are not compared; empty where they are.", title="no speed-up"),
        ],
    )
    table.rows = rows_of(analysis.by_axis, table.columns)
    return table


def _identities(analysis: Analysis) -> Frame:
    """One row a contestant that has a measured cell: what its cells have in common, and what is known of it without targets."""
    columns = [*(column.name for column in (CONTESTANT, *IDENTITY)), "metric", "failed_cells", "flags"]
    rows = [
        {
            **of_cell(verdict.contestant.done[0]),
            "contestant": verdict.contestant.name,
            "metric": analysis.results.metric,
            "failed_cells": verdict.failures,
            "flags": " ".join(verdict.flags),
        }
        for verdict in analysis.verdicts
    ]
    return pd.DataFrame(rows, columns=columns)
