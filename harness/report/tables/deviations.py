"""How much each metric differs from seed to seed."""

from __future__ import annotations

import math

import numpy as np

from harness.analysis import Analysis
from harness.analysis.columns import Column, Table
from harness.analysis.equivalence import common_spp
from harness.analysis.measurements import CONTESTANT, SCENE
from harness.metrics import METRICS, metric_name, metric_title
from harness.report.tables.equivalence import who

FEWEST_SEEDS = 3


def deviations(analysis: Analysis) -> Table:
    """One row a contestant of `FEWEST_SEEDS` seeds or more."""
    names = {metric: metric_name(metric, analysis.results.epsilon) for metric in METRICS}
    table = Table(
        "deviations",
        "Metrics over seeds",
        "Standard deviation of each metric over seeds, at the most samples that all seeds of a contestant have.",
        [
            SCENE,
            CONTESTANT,
            Column("spp", "Samples per pixel.", "count"),
            Column("seeds", "Seeds.", "count"),
            *(
                Column(f"{metric}_deviation", f"Standard deviation of {metric_title(name)}.", "number", metric_title(name))
                for metric, name in names.items()
            ),
        ],
    )
    for verdict in analysis.verdicts:
        cells, spp = verdict.contestant.done, common_spp(verdict.contestant)
        if spp is None or len(cells) < FEWEST_SEEDS:
            continue
        points = [next(point for point in cell.points if point.spp == spp) for cell in cells]
        row = {**who(verdict), "spp": spp, "seeds": len(points)}
        for metric, name in names.items():
            values = [math.nan if (value := point.metrics.get(name)) is None else value for point in points]
            row[f"{metric}_deviation"] = float(np.std(values, ddof=1)) if np.isfinite(values).all() else math.nan
        table.rows.append(row)
    return table
