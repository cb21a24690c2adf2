"""Accelerators: what building costs, what it saves, and after how many samples it has paid."""

from __future__ import annotations

from harness.analysis import Analysis
from harness.analysis.accelerator_tradeoff import worths
from harness.analysis.columns import Column, Table
from harness.report.tables.equivalence import CONTENDER, SCENE
from harness.statistics import Estimate


def accelerators(analysis: Analysis) -> Table:
    """One row a contender that has a twin with another accelerator; empty where there is none."""
    table = Table(
        "accelerators", "Accelerators: build against traverse",
        "Contenders that differ in their accelerator alone, each beside the one that is built fastest. Medians over seeds, "
        "paired by block, with 95 % intervals.",
        [SCENE, CONTENDER, Column("build_seconds", "Seconds of the build.", "estimate", "build [s]"),
         Column("path_microseconds", "Warm time of a path: a sample of a pixel.", "estimate", "path [µs]"),
         Column("against", "The accelerator of the same family that is built fastest."),
         Column("speedup", "Its time of a path over this one's.", "estimate", "speed-up"),
         Column("verdict", "faster, slower, tie (interval holds 1 or the noise floor) or unknown."),
         Column("pays_after", "Samples a pixel from which on build and rendering together take less.", "payback",
                "pays after [spp]")],
    )  # fmt: skip
    for found in worths(analysis):
        row = {"scene": found.contender.settings.scene, "contender": found.contender.name,
               "build_seconds": found.build_seconds, "path_microseconds": found.path_microseconds}  # fmt: skip
        if found.against is not None and found.speedup is not None:
            row |= {"against": found.against.settings.accelerator, "speedup": Estimate(*found.speedup[:4]),
                    "verdict": found.speedup.verdict, "pays_after": found.pays_after}  # fmt: skip
        table.rows.append(row)
    return table
