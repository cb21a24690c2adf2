"""The tables for people: time-to-quality first, then speed-ups, convergence, equivalence, phases, threads, failures."""

from __future__ import annotations

import math

import pandas as pd

from harness.analysis import Analysis, frames, seconds_per_sample
from harness.analysis.columns import Column, Table, rows_of
from harness.analysis.model import FLAGS
from harness.analysis.scaling import thread_families
from harness.metrics import error_words, metric_title
from harness.report.tables.accelerators import accelerators
from harness.report.tables.equivalence import (
    BASELINE,
    CONTENDER,
    SCENE,
    accuracy,
    bias_and_equivalence,
    bias_text,
    equivalence,
    equivalence_text,
    who,
)
from harness.report.tables.scaling import scaling
from harness.statistics import Estimate, Speedup, amdahl_fit, parallel_speedups
from harness.store.results import PHASES

RENAMED = {"contestant": "contender", "seconds": "warm_seconds", "ratio": "speedup"}
"""Columns of DataFrames by the names that these tables give them."""

IN_OTHER_COLUMNS = ("biased", "biased_image", "biased_tile", "other_image")


def all_tables(analysis: Analysis) -> list[Table]:
    """Every table, the verdicts first. Most are kept without rows: that nothing failed is worth saying."""
    makers = (time_to_quality, speedups, convergence, equivalence, bias_and_equivalence, phases, threads, failures)
    where_asked = [table for table in (accelerators(analysis), scaling(analysis), accuracy(analysis)) if table.rows]
    return [*(make(analysis) for make in makers), *where_asked]


def time_to_quality(analysis: Analysis) -> Table:
    """One row a contender and target."""
    results = analysis.results
    table = Table(
        "time_to_quality", "Time to quality",
        f"Median over seeds with a 95 % bootstrap interval; targets are in {metric_title(results.metric)}, errors "
        f"{error_words(results.metric)}. A target not reached within the budget is counted, never extrapolated.",
        [SCENE, CONTENDER, Column("target", f"Quality to reach, in {metric_title(results.metric)}.", "exact"),
         Column("warm_seconds", "Seconds of rendering alone until the target.", "estimate", "warm [s]"),
         Column("cold_seconds", "The same with import, scene load, build and compilation.", "estimate", "cold [s]"),
         Column("reached", "Seeds that got there; ≤ says that some were there at their first checkpoint already."),
         Column("speedup", "Warm time of the baseline over this one, paired by block.", "ratio", "speed-up"),
         Column("speedup_verdict", "faster, slower, tie (interval holds 1 or the noise floor) or unknown.",
                title="verdict"),
         Column("bias", "Bias against the reference of the pixels, the image mean or a tile, as a share of the radiance; < "
                "gives the most that it can be."),
         Column("equivalence", "Whether its image equals the baseline's: identical, equivalent, different or unresolved.",
                title="image"),
         Column("failed_cells", "Cells that failed or ran out of time.", "count", "failed"),
         Column("warnings", "What else to know before believing the row.")],
    )  # fmt: skip
    found = frames.verdicts(analysis).frame
    seeds = found.reached.astype("string") + "/" + found.seeds.astype("string")
    found["reached"] = seeds.where(found.at_first == 0, seeds + " ≤")
    found["speedup_verdict"] = found.verdict.mask(found.baseline.isna(), "baseline")
    new = {f"{old}{end}": f"{name}{end}" for old, name in RENAMED.items() for end in ("", "_low", "_high")}
    words = pd.DataFrame(
        [(*who(verdict).values(), bias_text(verdict), equivalence_text(verdict),
          "; ".join(FLAGS[flag] for flag in verdict.flags if flag not in IN_OTHER_COLUMNS))
         for verdict in analysis.verdicts],
        columns=["scene", "contender", "bias", "equivalence", "warnings"], dtype="string",
    )  # fmt: skip
    table.rows = rows_of(found.rename(columns=new).merge(words), table.columns)
    return table


def speedups(analysis: Analysis) -> Table:
    """Against the baseline: throughput, then each target."""
    floors = ", ".join(f"{scene} {100 * math.expm1(floor):.1f} %" for scene, floor in sorted(analysis.floors.items()))
    table = Table(
        "speedups", "Speed-up against the baseline",
        f"Baseline engine: {analysis.baseline_engine or 'none'}. Geometric mean of paired block ratios with a 95 % "
        f"interval. Noise floor from the A/A twin: {floors or 'not measured'}.",
        [SCENE, CONTENDER, BASELINE,
         Column("measure", "What is compared: seconds per sample, or warm seconds to a target."),
         Column("speedup", "Baseline over contender; above 1 the contender is faster.", "ratio", "speed-up"),
         Column("pairs", "Blocks that both have.", "count"),
         Column("verdict", "faster, slower, tie or unknown.")],
    )  # fmt: skip
    for verdict in analysis.verdicts:
        if verdict.baseline is None or verdict.speedup is None:
            continue
        names = ["seconds per sample", *(f"time to {target:g}" for target in analysis.results.targets)]
        for name, speedup in zip(names, [verdict.speedup, *verdict.quality_speedups], strict=True):
            table.rows.append({
                **who(verdict), "baseline": verdict.baseline.name, "measure": name, "speedup": _ratio(speedup),
                "pairs": speedup.pairs, "verdict": speedup.verdict,
            })  # fmt: skip
    return table


def convergence(analysis: Analysis) -> Table:
    """Slopes, throughput and what was left at the end."""
    metric = analysis.results.metric
    table = Table(
        "convergence", "Convergence and throughput",
        "Slope of log RMSE over log samples: -1/2 is Monte Carlo, steeper is quasi-Monte Carlo, flat is bias.",
        [SCENE, CONTENDER, Column("spp", "Samples per pixel at the last checkpoint.", "estimate"),
         Column("error", f"{metric_title(metric)} at the last checkpoint, {error_words(metric)}.", "estimate"),
         Column("slope", "d log RMSE / d log spp; 95 % interval over seeds.", "estimate"),
         Column("slope_verdict", "monte carlo, steeper, slower, flat or unknown.", title="verdict"),
         Column("samples_per_second", "Samples (paths) of the whole image a second, warm.", "estimate", "samples/s"),
         Column("rays_per_second", "Rays a second, warm.", "estimate", "rays/s"),
         Column("efficiency", "1 / (MSE x warm seconds).", "estimate")],
    )  # fmt: skip
    for verdict in analysis.verdicts:
        slope = verdict.slope
        table.rows.append({
            **who(verdict), "spp": verdict.final_spp, "error": verdict.final_error,
            "slope": Estimate(slope.value, slope.low, slope.high, slope.seeds), "slope_verdict": slope.verdict,
            "samples_per_second": verdict.samples_per_second, "rays_per_second": verdict.rays_per_second,
            "efficiency": verdict.efficiency,
        })  # fmt: skip
    return table


def phases(analysis: Analysis) -> Table:
    """Median seconds of each phase."""
    meanings = {"import": "importing the engine", "load": "loading the scene", "build": "building the accelerator",
                "compile": "compiling", "render": "rendering, all checkpoints"}  # fmt: skip
    columns = [Column(f"{phase}_seconds", f"Seconds of {meanings[phase]}; median over seeds.", "estimate",
                      f"{phase} [s]") for phase in PHASES]  # fmt: skip
    table = Table("phases", "Phases", "Where the time of a cold start goes; medians over seeds, 95 % intervals.",
                  [SCENE, CONTENDER, *columns])  # fmt: skip
    for verdict in analysis.verdicts:
        table.rows.append(who(verdict) | {f"{phase}_seconds": verdict.phases[phase] for phase in PHASES})
    return table


def threads(analysis: Analysis) -> Table:
    """Families of contenders that differ in their thread count alone."""
    table = Table(
        "threads", "Speed-up over threads",
        "Warm seconds per sample, paired by block; serial fraction from Amdahl's law, bootstrap over blocks.",
        [SCENE, CONTENDER, Column("threads", "Threads.", "count"),
         Column("speedup", "Against the fewest threads.", "estimate", "speed-up"),
         Column("efficiency", "Speed-up over threads; 1 is ideal.", "estimate"),
         Column("serial_fraction", "Share of the time that more threads do not shorten.", "estimate")],
    )  # fmt: skip
    for family in thread_families(analysis.results):
        seconds = {contender.settings.threads: seconds_per_sample(contender) for contender in family}
        fit = amdahl_fit(seconds)
        for row, contender in zip(parallel_speedups(seconds), family, strict=True):
            table.rows.append({
                "scene": contender.settings.scene, "contender": contender.name, "threads": row.threads,
                "speedup": row.speedup, "efficiency": row.efficiency, "serial_fraction": fit,
            })  # fmt: skip
    return table


def failures(analysis: Analysis) -> Table:
    """What did not run, and why."""
    table = Table(
        "failures", "Failures, timeouts and skips", "Cells that gave no complete measurement, with the reason.",
        [SCENE, CONTENDER, Column("state", "failed, timeout or skipped."),
         Column("cells", "How many seeds of the contender it concerns.", "count"),
         Column("message", "The reason, as the engine or the harness gave it.")],
    )  # fmt: skip
    found = frames.by_contestant(frames.cells(analysis.results).frame, analysis.results)
    failed = found[found.state != "done"].fillna({"message": ""})
    cases = failed.groupby(["scene", "contestant", "state", "message"], sort=False)
    counted = pd.DataFrame({"cells": cases.size()}).reset_index()
    table.rows = rows_of(counted.rename(columns=RENAMED), table.columns)
    return table


def _ratio(speedup: Speedup | None) -> Estimate | None:
    return None if speedup is None or math.isnan(speedup.ratio) else Estimate(*speedup[:4])
