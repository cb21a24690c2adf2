"""How cost grows with primitives, pixels and samples: exponents."""

from __future__ import annotations

from harness.analysis import Analysis
from harness.analysis.columns import Column, Table
from harness.analysis.measurements import CONTESTANT
from harness.analysis.scaling import scaling_exponents


def scaling(analysis: Analysis) -> Table:
    """One row a family of contestants and cost; empty where no family has three sizes."""
    return Table(
        "scaling",
        "How cost scales",
        "Exponents k of cost ~ size^k: 0 is constant, 1 proportional. A path is one sample of one pixel, so k = 0 over pixels "
        "and samples means that the whole cost is proportional to them. Slopes of each block, averaged, with a 95 % interval.",
        [
            CONTESTANT,
            Column("cost", "Which cost: warm seconds of a path, or seconds of the build."),
            Column("over", "What grows."),
            Column("smallest", "The smallest size.", "count"),
            Column("largest", "The largest size.", "count"),
            Column("exponent", "Over all sizes, by least squares.", "estimate"),
            Column("exponent_last", "Between the two largest.", "estimate", "at the end"),
        ],
        [found._asdict() for found in scaling_exponents(analysis)],
    )
