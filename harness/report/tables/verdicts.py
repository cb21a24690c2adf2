"""The tables for people: time-to-quality first, then speed-ups, convergence, equivalence, phases, threads, failures."""

from __future__ import annotations

import pandas as pd

from harness.analysis import Analysis, frames, measurements, seconds_per_sample
from harness.analysis.columns import Column, Table, rows_of
from harness.analysis.measurements import CONTESTANT, IDENTITY, SCENE
from harness.analysis.model import FLAGS
from harness.analysis.scaling import serial_fraction_of, thread_families
from harness.metrics import error_words, metric_title
from harness.report.tables.accelerators import accelerators
from harness.report.tables.by_axis import by_axis, say_why, why_blank
from harness.report.tables.deviations import deviations
from harness.report.tables.equivalence import accuracy, bias_and_equivalence, bias_text, equivalence, equivalence_text, who
from harness.report.tables.evidence import evidence, share_text
from harness.report.tables.model import reached_text, some
from harness.report.tables.rays import rays
from harness.report.tables.scaling import scaling
from harness.statistics import Estimate, parallel_speedups
from harness.store.results import PHASES

SPEEDUP = {f"ratio{end}": f"speedup{end}" for end in ("", "_low", "_high")}
RENAMED = SPEEDUP | {f"seconds{end}": f"warm_seconds{end}" for end in ("", "_low", "_high")}
"""Columns of DataFrames by the names that these tables give them."""
MOST_NAMES = 6
"""Contestants that a sentence names."""
IN_OTHER_COLUMNS = ("biased", "biased_image", "biased_tile", "other_image", "equivalence_unresolved")
"""Flags that need no mention among the warnings."""


def all_tables(analysis: Analysis) -> list[Table]:
    """Every table, the verdicts first. Most are kept without rows: that nothing failed is worth saying. Where all cells trace
    rays, that of rays alone."""
    makers = (time_to_quality, by_axis, speedups, convergence, equivalence, bias_and_equivalence, phases, threads, failures)
    asked = deviations(analysis), accelerators(analysis), scaling(analysis), accuracy(analysis), rays(analysis.results)
    where_asked = [table for table in asked if table.rows]
    only_rays = analysis.results.ray_cells and not analysis.results.cells
    return [*(make(analysis) for make in ([] if only_rays else makers)), *where_asked]


def time_to_quality(analysis: Analysis) -> Table:
    """One row a contestant and target."""
    results = analysis.results
    table = Table(
        "time_to_quality",
        "Time to quality",
        f"Geometric mean over seeds with Student's 95 % interval; targets are in {metric_title(results.metric)}, errors "
        f"{error_words(results.metric)}. Nothing is extrapolated: >, < are bounds. Where there is no speed-up, the "
        "column of the baseline says why; beside a baseline a dash means that neither of the two reached the target. "
        f"{evidence(analysis)}",
        [
            SCENE,
            CONTESTANT,
            *_division(analysis),
            Column("target", f"Quality to reach, in {metric_title(results.metric)}.", "exact"),
            Column("warm_seconds", "Seconds of rendering alone until the target.", "estimate", "warm [s]"),
            Column("cold_seconds", "The same with import, scene load, build and compilation.", "estimate", "cold [s]"),
            Column("reached", "Seeds that reached the target; ≤ means that some had reached it at their first checkpoint."),
            Column("speedup", "Warm time of the baseline over this one, paired by block; 95 % interval.", "ratio", "speed-up"),
            Column("speedup_verdict", "faster, slower, same or unresolved.", title="verdict"),
            Column(
                "baseline",
                "Contestant that it is compared with, and in brackets the settings in which the two differ; or why "
                "there is none.",
            ),
            Column(
                "bias",
                "Bias against the reference of the pixels, the image mean or a tile, as a share of the radiance; < "
                "gives the most that it can be.",
            ),
            Column(
                "equivalence",
                "Whether its image equals that of the image baseline, which bias_and_equivalence names: identical, equivalent, "
                "different or unresolved.",
                title="image",
            ),
            Column("failed_cells", "Cells that failed or ran out of time.", "count", "failed"),
            Column("warnings", "Flags: what to check before relying on the row."),
        ],
    )
    found = frames.verdicts(analysis).frame
    found["reached"] = [reached_text(row) for row in found.itertuples()]
    found["speedup_verdict"] = found.verdict
    found["baseline"] = (found.baseline + " (" + found.factor + ")").where(found.no_ratio == "", found.no_ratio)
    found["warnings"] = [
        "; ".join(FLAGS[flag] for flag in flags.split() if flag not in IN_OTHER_COLUMNS) for flags in found["flags"]
    ]
    words = pd.DataFrame(
        [(*who(verdict).values(), bias_text(verdict), equivalence_text(verdict)) for verdict in analysis.verdicts],
        columns=["scene", "contestant", "bias", "equivalence"],
        dtype="string",
    )
    table.rows = rows_of(found.rename(columns=RENAMED).merge(words), table.columns)
    by_name = {(verdict.contestant.settings.scene, verdict.contestant.name): verdict for verdict in analysis.verdicts}
    of_rows = [by_name[row["scene"], row["contestant"]] for row in table.rows]
    reasons = [why_blank(analysis.at(of.contestant, row["target"])) for of, row in zip(of_rows, table.rows, strict=True)]
    say_why(table, reasons, "speedup", "speedup_verdict")
    say_why(table, ["there are no images of two seeds, or no reference"] * len(of_rows), "bias")
    itself, missing = "it is itself the image baseline, or alone", "there are no images to compare"
    say_why(table, [itself if verdict.image_baseline is None else missing for verdict in of_rows], "equivalence")
    return table


def _division(analysis: Analysis) -> list[Column]:
    """A column where some contestant is not of the closed division."""
    some = any(verdict.contestant.settings.division != "closed" for verdict in analysis.verdicts)
    return IDENTITY[-1:] * some


def speedups(analysis: Analysis) -> Table:
    """Against the contestant that each is compared with: throughput, then each target."""
    table = Table(
        "speedups",
        "Speed-up",
        "Every contestant against the baseline of its race: the one that the config's `baseline` names, else the one that has "
        f"the first value, as written, of every axis. {_without_ratio(analysis)}A dash: neither of the two reached the target "
        "in all blocks that both have. Geometric mean of paired block ratios with Student's 95 % interval, its variance "
        "moderated by that of the scene and increased by the persistent spread; the family-wise error rate of a scene and "
        f"target is 5 % (Holm). {evidence(analysis)}",
        [
            SCENE,
            CONTESTANT,
            Column("baseline", "Contestant that it is compared with."),
            Column("factor", "Settings, and options of choices, in which the two differ.", title="differs in"),
            Column("measure", "What is compared: seconds per sample, or warm seconds to a target."),
            Column("speedup", "Baseline over contestant; above 1 the contestant is faster.", "ratio", "speed-up"),
            Column("pairs", "Blocks that both have.", "count"),
            Column("persistent_spread", "Difference that persists between equal contestants, from A/A twins; in the interval."),
            Column("verdict", "faster, slower, same or unresolved."),
        ],
    )
    found = measurements.by_contestant(analysis.comparisons, analysis.results)
    found = found[found.no_ratio == ""]
    reasons = [why_blank(row) for row in found.itertuples()]
    found = found.rename(columns=SPEEDUP | {"blocks": "pairs"})
    found["persistent_spread"] = found.persistent_spread.map(share_text)
    table.rows = rows_of(found, table.columns)
    say_why(table, reasons, "speedup", "verdict")
    return table


def _without_ratio(analysis: Analysis) -> str:
    """A sentence on the contestants that have no ratio, by reason."""
    found = measurements.by_contestant(analysis.comparisons, analysis.results)
    reasons = found[found.no_ratio != ""].groupby("no_ratio", sort=False).contestant.unique()
    texts = [f"{some(names, MOST_NAMES)} ({why})" for why, names in reasons.items()]
    return f"Without a ratio: {'; '.join(texts)}. " if texts else ""


def convergence(analysis: Analysis) -> Table:
    """Slopes, throughput and what was left at the end."""
    metric = analysis.results.metric
    table = Table(
        "convergence",
        "Convergence and throughput",
        "Slope of log RMSE over log samples, fitted over samples that the contestants of a scene share: -1/2 is Monte Carlo.",
        [
            SCENE,
            CONTESTANT,
            Column("spp", "Samples per pixel at the last checkpoint.", "estimate"),
            Column("error", f"{metric_title(metric)} at the last checkpoint, {error_words(metric)}.", "estimate"),
            Column("slope", "d log RMSE / d log spp; 95 % interval over seeds.", "estimate"),
            Column("slope_samples", "Samples per pixel over which it was fitted.", title="over samples"),
            Column(
                "slope_verdict", "monte carlo (interval within -0.5 ± 0.05), steeper, shallower or unknown.", title="verdict"
            ),
            Column("samples_per_second", "Samples (paths) of the whole image per second, warm.", "estimate", "samples/s"),
            Column("rays_per_second", "Rays per second, warm.", "estimate", "rays/s"),
            Column("efficiency", "1 / (MSE x warm seconds).", "estimate"),
        ],
    )
    for verdict in analysis.verdicts:
        slope = verdict.slope
        table.rows.append(
            {
                **who(verdict),
                "spp": verdict.final_spp,
                "error": verdict.final_error,
                "slope": Estimate(slope.value, slope.low, slope.high, slope.seeds),
                "slope_verdict": slope.verdict,
                "slope_samples": f"{slope.first} to {slope.last}" if slope.last else "",
                "samples_per_second": verdict.samples_per_second,
                "rays_per_second": verdict.rays_per_second,
                "efficiency": verdict.efficiency,
            }
        )
    return table


def phases(analysis: Analysis) -> Table:
    """Mean seconds of each phase."""
    meanings = {
        "import": "importing the engine",
        "load": "loading the scene",
        "build": "building the accelerator",
        "compile": "compiling",
        "render": "rendering, all checkpoints",
    }
    columns = [Column(f"{phase}_seconds", f"Seconds of {meanings[phase]}.", "estimate", f"{phase} [s]") for phase in PHASES]
    table = Table(
        "phases",
        "Phases",
        "Where the time of a cold start goes; geometric means over seeds, 95 % intervals.",
        [SCENE, CONTESTANT, *columns],
    )
    for verdict in analysis.verdicts:
        table.rows.append(who(verdict) | {f"{phase}_seconds": verdict.phases[phase] for phase in PHASES})
    return table


def threads(analysis: Analysis) -> Table:
    """Families of contestants that differ in their thread count alone."""
    table = Table(
        "threads",
        "Speed-up over threads",
        "Warm seconds per sample, paired by block. The serial fraction is Amdahl's, one fit a block, over thread counts up to "
        "the usable cores. 95 % intervals.",
        [
            SCENE,
            CONTESTANT,
            Column("threads", "Threads.", "count"),
            Column("speedup", "Against the fewest threads.", "estimate", "speed-up"),
            Column("efficiency", "Speed-up over threads; 1 is ideal.", "estimate"),
            Column("serial_fraction", "Share of the time that more threads do not shorten.", "estimate"),
        ],
    )
    for family in thread_families(analysis.results):
        seconds = {contestant.settings.threads: seconds_per_sample(contestant) for contestant in family}
        fit = serial_fraction_of(analysis.results, family)
        for row, contestant in zip(parallel_speedups(seconds), family, strict=True):
            table.rows.append(
                {
                    "scene": contestant.settings.scene,
                    "contestant": contestant.name,
                    "threads": row.threads,
                    "speedup": row.speedup,
                    "efficiency": row.efficiency,
                    "serial_fraction": fit,
                }
            )
    return table


def failures(analysis: Analysis) -> Table:
    """What did not run, and why."""
    table = Table(
        "failures",
        "Failures, timeouts and skips",
        "Cells that gave no complete measurement, with the reason.",
        [
            SCENE,
            CONTESTANT,
            Column("state", "failed, timeout or skipped."),
            Column("cells", "How many seeds of the contestant it concerns.", "count"),
            Column("message", "The reason, as the engine or the harness gave it."),
        ],
    )
    found = measurements.by_contestant(analysis.cells.frame, analysis.results)
    failed = found[found.state != "done"].fillna({"message": ""})
    cases = failed.groupby(["scene", "contestant", "state", "message"], sort=False)
    counted = pd.DataFrame({"cells": cases.size()}).reset_index()
    table.rows = rows_of(counted, table.columns)
    return table
