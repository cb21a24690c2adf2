"""Every figure of a results folder, in the report's order, and how they are drawn into files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import matplotlib
from matplotlib.figure import Figure

from harness.analysis import Analysis
from harness.check_results import CheckResult
from harness.report.plots import stability
from harness.report.plots.accelerator_tradeoff import build_against_traverse
from harness.report.plots.bars import phase_bars, quality_bars, thread_speedups
from harness.report.plots.curves import error_curves, pareto, shows_slopes, target_ecdf
from harness.report.plots.panels import Panel, panels
from harness.report.plots.scaling import cost_over_pixels, cost_over_primitives, shows_exponents
from harness.report.plots.style import STYLE, Palette, Plot, Sketch, file_stem, formats, save

OF_A_PANEL = {
    "error-over-time": "error over warm time",
    "error-over-cold-time": "over cold time",
    "error-over-samples": "over samples",
    "error-over-rays": "over rays",
    "time-to-quality": "time to quality",
    "pareto": "Pareto front",
    "phases": "phases",
}
"""How the names of a panel's plots start -> the words by which a reader chooses one."""
OF_ALL_SCENES = (
    "targets-over-time",
    "speed-up-over-threads",
    "build-against-traverse",
    "cost-over-primitives",
    "cost-over-resolution",
)


def draw(analysis: Analysis, target: Path, first: int = 0, step: int = 1) -> dict[int, Plot]:
    """Draws every `step`-th figure from `first` on; plots by their place in the report."""
    drawn = {}
    with matplotlib.rc_context(cast(Any, STYLE)):
        for index, (name, title, description, make) in list(enumerate(_sketches(analysis)))[first::step]:
            figure = make()
            if figure is not None:
                _mark_mixture(analysis, figure, name)
                drawn[index] = Plot(name, title, description, save(figure, target, name))
    return drawn


def count_figures(analysis: Analysis) -> int:
    """How many figures there are at most."""
    return len(_sketches(analysis))


def draw_stability(findings: Sequence[CheckResult], target: Path) -> list[Plot]:
    """Draws the results of the suite, without any results folder."""
    return draw_sketches(stability.sketches(findings), target)


def draw_sketches(sketches: Sequence[Sketch], target: Path) -> list[Plot]:
    """Draws those that their results allow; nothing for `RAYBENCH_PLOTS=none`."""
    if not formats():
        return []
    target.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context(cast(Any, STYLE)):
        figures = [(sketch, sketch.make()) for sketch in sketches]
        return [
            Plot(sketch.name, sketch.title, sketch.description, save(figure, target, sketch.name))
            for sketch, figure in figures
            if figure is not None
        ]


def _mark_mixture(analysis: Analysis, figure: Figure, name: str) -> None:
    """A banner on figures of all scenes where several machines share their axes; panels belong to one machine each."""
    count = len({verdict.contestant.settings.machine for verdict in analysis.verdicts})
    if count > 1 and name in OF_ALL_SCENES:
        figure.suptitle(f"{count} machines: times must not be compared", color="#a6192e", fontsize=9, weight="bold")


def _sketches(analysis: Analysis) -> list[Sketch]:
    """Every plot, in the report's order."""
    palette = Palette(analysis.results)
    exponents = " Numbers in the legend are exponents of the path's time between the two largest scenes."
    found = [sketch for panel in panels(analysis) for sketch in _panel_sketches(analysis, panel, palette)]
    return [
        *found,
        Sketch(
            "targets-over-time",
            "Targets reached over time",
            "Share of all scenes, targets and seeds that each contestant has reached by a given time. "
            "A scene on which it was not measured, or is not ranked, counts as not reached.",
            lambda: target_ecdf(analysis, palette),
        ),
        Sketch(
            "speed-up-over-threads",
            "Speed-up over threads",
            "Speed-up over the fewest threads, with 95 % intervals. Dotted: the ideal. The serial fraction is that of "
            "Amdahl's law.",
            lambda: thread_speedups(analysis, palette),
        ),
        Sketch(
            "build-against-traverse",
            "Accelerators: build against traverse",
            "Time to build an accelerator, and time of a path through it, on logarithmic axes. "
            "Lines join contestants that differ in the accelerator alone. Lower left is better.",
            lambda: build_against_traverse(analysis, palette),
        ),
        Sketch(
            "cost-over-primitives",
            "Cost over the number of primitives",
            "Time of a path (a sample of a pixel), and time to build the accelerator, over the number of primitives of the "
            f"scenes, with 95 % intervals, on logarithmic axes.{exponents if shows_exponents(analysis) else ''}",
            lambda: cost_over_primitives(analysis, palette),
        ),
        Sketch(
            "cost-over-resolution",
            "Cost over resolution and samples",
            "Time of a path over the pixels of the image, and over the samples per pixel so far: flat where cost grows "
            "in proportion.",
            lambda: cost_over_pixels(analysis, palette),
        ),
        *stability.sketches(analysis.results.check_results),
    ]


def _panel_sketches(analysis: Analysis, panel: Panel, palette: Palette) -> Iterator[Sketch]:
    title = panel.title
    words = {"seconds": "time", "cold": "cold time", "spp": "samples", "rays": "rays"}
    for x, word in words.items():
        slopes = " Numbers in the legend are slopes of the RMSE, over samples that all share."
        note = slopes if shows_slopes(x, panel.verdicts) else ""
        yield Sketch(
            file_stem("error-over", word.replace(" ", "-"), title),
            f"{title}: error over {word}",
            f"Error of each contestant over {word}: the median over blocks, on logarithmic axes. Bands: the range "
            "over blocks. Dashed lines: targets. Crosses: errors below three standard errors."
            f"{note}",
            partial(error_curves, analysis, panel, palette, x),
        )
    yield Sketch(
        file_stem("time-to-quality", title),
        f"{title}: time to quality",
        "Seconds that each contestant needs for each target. Full dots: warm. Hollow dots: cold. Whiskers: "
        "95 % intervals. With fewer than three blocks there is one dot per block.",
        partial(quality_bars, analysis, panel, palette),
    )
    yield Sketch(
        file_stem("pareto", title),
        f"{title}: Pareto front of time against error",
        "Checkpoints by warm time and error. Strong markers, with intervals, are on the front: no other checkpoint is "
        "surely better in both, by more than the noise floor.",
        partial(pareto, analysis, panel, palette),
    )
    yield Sketch(
        file_stem("phases", title),
        f"{title}: phases of a cold start",
        "Geometric means of the seconds of import, load, build, compilation and rendering. The whisker at the end of "
        "a phase is the 95 % interval of that phase.",
        partial(phase_bars, panel),
    )
