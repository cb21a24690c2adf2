"""Plots of results as files for a paper (svg, png, pdf) and as SVG text for the report."""

from __future__ import annotations

from pathlib import Path

from harness.analysis import Analysis
from harness.measure.machine import usable_cores
from harness.report.plots.drawing import count_figures, draw, draw_stability
from harness.report.plots.style import FORMATS, Palette, Plot, formats
from harness.store.confined import inside

__all__ = ["Palette", "Plot", "draw", "draw_stability", "write_plots"]

WORTH_A_SECOND_PROCESS = 6
"""Figures from which on a second process, which needs a second to start, draws every other one."""


def write_plots(analysis: Analysis, folder: Path) -> list[Plot]:
    """Draws everything that the results allow into `folder`/plots, or nothing for `RAYBENCH_PLOTS=none`. Removes plots of
    earlier results first."""
    from harness.report.plots.parallel import Beside

    target = inside(folder, "plots", str(folder))
    target.mkdir(exist_ok=True)
    for old in [path for suffix in FORMATS for path in target.glob(f"*.{suffix}")]:
        old.unlink()
    if not formats():
        return []
    if count_figures(analysis) < WORTH_A_SECOND_PROCESS or len(usable_cores()) < 2:
        drawn = draw(analysis, target)
    else:
        with Beside(analysis, target, first=1, step=2) as beside:
            drawn = draw(analysis, target, 0, 2) | beside.drawn()
    return [drawn[index] for index in sorted(drawn)]
