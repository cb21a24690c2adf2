"""Accelerators: what building costs, what it saves, and the break-even number of samples."""

from __future__ import annotations

from harness.analysis import Analysis
from harness.analysis.accelerator_tradeoff import break_evens
from harness.analysis.columns import Column, Table
from harness.analysis.measurements import CONTESTANT, SCENE
from harness.report.tables.evidence import spread_text


def accelerators(analysis: Analysis) -> Table:
    """One row a contestant of which there is one with another accelerator; empty where there is none."""
    return Table(
        "accelerators",
        "Accelerators: build against traverse",
        "Contestants that differ in their accelerator alone, each beside the one that is built fastest. Geometric means "
        f"over seeds with 95 % intervals; ratios paired by block. {spread_text(analysis)}",
        [
            SCENE,
            CONTESTANT,
            Column("build_seconds", "Seconds of the build.", "estimate", "build [s]"),
            Column("path_microseconds", "Warm time of a path: a sample of a pixel.", "estimate", "path [µs]"),
            Column("baseline", "The accelerator that is built fastest, all else equal."),
            Column("speedup", "Time of a path with that accelerator over the time with this one.", "estimate", "speed-up"),
            Column("verdict", "faster, slower, same or unresolved."),
            Column(
                "break_even_spp",
                "Samples per pixel from which build and rendering together take less time with this one; "
                "known where the verdict is faster or slower.",
                "break_even",
                "break-even [spp]",
            ),
        ],
        [found._asdict() for found in break_evens(analysis)],
    )
