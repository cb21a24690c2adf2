"""Plots of results: charts, drawn as files for a paper (svg, png, pdf) and in the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.analysis import Analysis
from harness.measure.machine import usable_cores
from harness.report.plots.catalogue import plots_of
from harness.report.plots.chart import Picture, Plot
from harness.report.plots.stability import plots as stability_plots
from harness.report.plots.style import FORMATS, Palette, formats
from harness.store.confined import inside

WORTH_A_SECOND_PROCESS = 6
"""Figures from which on a second process, which needs a second to start, draws every other one."""


def write_plots(analysis: Analysis, folder: Path) -> list[Plot]:
    """Every plot that the results allow, drawn into `folder`/plots in the formats of `$RAYBENCH_PLOTS`. Plots of earlier
    results are removed first."""
    target = inside(folder, "plots", str(folder))
    target.mkdir(exist_ok=True)
    for old in [path for suffix in FORMATS for path in target.glob(f"*.{suffix}")]:
        old.unlink()
    plots = plots_of(analysis)
    write_files(plots, target)
    return plots


def write_files(plots: Sequence[Plot], target: Path) -> None:
    """Draws plots into the folder `target` in the formats of `$RAYBENCH_PLOTS`."""
    suffixes = formats()
    if not suffixes:
        return
    from harness.report.plots.parallel import Beside, draw

    target.mkdir(parents=True, exist_ok=True)
    if len(plots) < WORTH_A_SECOND_PROCESS or len(usable_cores()) < 2:
        draw(plots, target, suffixes)
    else:
        with Beside(plots[1::2], target, suffixes) as beside:
            draw(plots[::2], target, suffixes)
            beside.finish()
