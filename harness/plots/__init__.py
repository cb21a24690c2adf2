"""Plots of results as files for a paper (svg, png, pdf) and as SVG text for the report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import matplotlib
from matplotlib.figure import Figure

from harness.analysis import Analysis
from harness.plots.bars import phase_bars, quality_bars, sentinel_drift, thread_speedups
from harness.plots.curves import error_curves, pareto, target_ecdf
from harness.plots.panels import Panel, panels
from harness.plots.style import STYLE, Palette, Plot, file_stem, save

__all__ = ["Palette", "Plot", "write_plots"]


def write_plots(analysis: Analysis, folder: Path) -> list[Plot]:
    """Draws everything that the results allow into `folder`/plots; plots of earlier results are removed first."""
    target = folder / "plots"
    target.mkdir(exist_ok=True)
    for old in [path for suffix in ("svg", "png", "pdf") for path in target.glob(f"*.{suffix}")]:
        old.unlink()
    drawn = []
    with matplotlib.rc_context(cast(Any, STYLE)):
        for name, title, description, figure in _figures(analysis):
            if figure is not None:
                drawn.append(Plot(name, title, description, save(figure, target, name)))
    return drawn


def _figures(analysis: Analysis) -> Iterator[tuple[str, str, str, Figure | None]]:
    """(file stem, title, description, figure or None) of every plot, in the report's order."""
    palette = Palette(analysis.results)
    found = panels(analysis)
    for panel in found:
        yield from _panel_figures(analysis, panel, palette)
    yield ("targets-over-time", "Targets reached over time",
           "Steps that rise with time: the share of all scenes, targets and seeds each contender has reached.",
           target_ecdf(analysis, palette))  # fmt: skip
    yield ("speed-up-over-threads", "Speed-up over threads",
           "Speed-up against the fewest threads, with intervals; dotted: ideal; serial fraction by Amdahl's law.",
           thread_speedups(analysis, palette))  # fmt: skip
    yield ("sentinel", "Drift of the machine",
           "Time of a fixed kernel through the run, as deviation from its median in percent.",
           sentinel_drift(analysis))  # fmt: skip


def _panel_figures(analysis: Analysis, panel: Panel, palette: Palette) -> Iterator[tuple[str, str, str, Figure | None]]:
    title = panel.title
    words = {"seconds": "time", "spp": "samples", "rays": "rays"}
    for x, word in words.items():
        note = " Numbers in the legend are slopes of the RMSE." if x == "spp" else ""
        yield (file_stem("error-over", word, title), f"{title}: error over {word}",
               f"Falling curves on logarithmic axes, the error of each contender over {word}; bands are the range of "
               f"seeds, dashed lines the targets, crosses lie below three standard errors.{note}",
               error_curves(analysis, panel, palette, x))  # fmt: skip
    yield (file_stem("time-to-quality", title), f"{title}: time to quality",
           "For each target, the seconds each contender needs: full dots warm, hollow dots cold, whiskers intervals.",
           quality_bars(analysis, panel, palette))  # fmt: skip
    yield (file_stem("pareto", title), f"{title}: Pareto front of time against error",
           "Checkpoints by warm time and error; full markers with intervals are those that none surely beats in both.",
           pareto(analysis, panel, palette))  # fmt: skip
    yield (file_stem("phases", title), f"{title}: phases of a cold start",
           "Stacked bars of the median seconds of import, load, build, compilation and rendering.",
           phase_bars(panel))  # fmt: skip
