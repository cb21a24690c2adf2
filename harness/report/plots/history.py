"""Seconds to each target over the revisions of a renderer, with intervals and the steps that were found."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from harness.analysis.columns import Table
from harness.report.plots.chart import FAINT, LINES, MARKERS
from harness.report.plots.style import ENGINE_COLOURS, OTHER_COLOURS

COLOURS = (*ENGINE_COLOURS.values(), *OTHER_COLOURS)
WORSE, BETTER = "#d55e00", "#009e73"


def history_figure(table: Table) -> Figure:
    """A panel a scene and target, of the rows of `tables.history`, inside `figures.style()`.

    At the upper edge an open triangle: the target was not reached; a cross: all runs failed. Above a point: the step to it,
    where there is a verdict.
    """
    panels = dict.fromkeys((row["scene"], row["target"]) for row in table.rows)
    scenes, targets = dict.fromkeys(scene for scene, _ in panels), sorted({target for _, target in panels}, reverse=True)
    revisions = list(dict.fromkeys(row["revision"] for row in sorted(table.rows, key=lambda row: row["since"])))
    contestants = list(dict.fromkeys(row["contestant"] for row in table.rows))
    width = max(3.2, 1.2 + 0.45 * len(revisions))
    figure = Figure((width * len(targets), 2.6 * len(scenes) + 0.5), layout="constrained")
    axes = figure.subplots(len(scenes), len(targets), sharex=True, squeeze=False)
    for row, scene in enumerate(scenes):
        for column, target in enumerate(targets):
            axis = axes[row][column]
            axis.set_title(f"{scene} to {target:g}")
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter(FuncFormatter(partial(_minor_label, axis)))
            for index, name in enumerate(contestants):
                found = [r for r in table.rows if (r["scene"], r["target"], r["contestant"]) == (scene, target, name)]
                _line(axis, found, revisions, index, name)
            axis.set_xticks(range(len(revisions)), revisions, rotation=60, ha="right")
            axis.set_ylabel("seconds to the target" if column == 0 else "")
    handles, labels = axes[0][0].get_legend_handles_labels()
    if len(contestants) > 1:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(3, len(labels)))
    return figure


def _minor_label(axis: Any, value: float, _: int) -> str:
    """All of an axis that spans less than a decade, 2 and 5 of one that spans more."""
    low, high = axis.get_ylim()
    return f"{value:.2g}" if high < 10 * low or f"{value:.0e}"[0] in "25" else ""


def _line(axis: Any, rows: list[dict[str, Any]], revisions: list[str], index: int, name: str) -> None:
    colour, marker = COLOURS[index % len(COLOURS)], MARKERS[index % len(MARKERS)]
    known = [row for row in rows if math.isfinite(row["seconds"].value)]
    x, y = [revisions.index(row["revision"]) for row in known], [row["seconds"].value for row in known]
    ends = [(max(0.0, s.value - s.low), max(0.0, s.high - s.value)) for s in (row["seconds"] for row in known)]
    errors = [[0.0 if math.isnan(pair[side]) else pair[side] for pair in ends] for side in (0, 1)]
    axis.errorbar(x, y, errors, color=colour, marker=marker, ls=LINES[index % len(LINES)], capsize=2, ms=4, lw=1.2, label=name)
    for row in rows:
        at = revisions.index(row["revision"])
        if not math.isfinite(row["seconds"].value):
            sign = "x" if row["verdict"].startswith("failed") else "^"
            axis.plot([at], [0.97], sign, mfc="none", mec=colour, transform=axis.get_xaxis_transform(), clip_on=False)
            continue
        worse = row["regression"] or row["verdict"] == "slower"
        if worse or row["verdict"] == "faster":
            high = row["seconds"].high if math.isfinite(row["seconds"].high) else row["seconds"].value
            step = f"{row['step'].value:.2f}x" if "step" in row and math.isfinite(row["step"].value) else ""
            axis.annotate(
                f"{step} {'▲' if worse else '▼'}",
                (at, high),
                (0, 4),
                textcoords="offset points",
                ha="center",
                fontsize=7,
                color=WORSE if worse else BETTER,
            )
    axis.grid(visible=True, color=FAINT, alpha=0.3)
