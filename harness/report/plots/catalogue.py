"""Every plot of a results folder, in the report's order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from harness.analysis import Analysis
from harness.report.plots import rays, stability
from harness.report.plots.accelerator_tradeoff import build_against_traverse
from harness.report.plots.bars import phase_bars, quality_bars, thread_speedups
from harness.report.plots.chart import Chart, Plot
from harness.report.plots.curves import error_curves, pareto, shows_slopes, target_ecdf
from harness.report.plots.panels import Panel, panels
from harness.report.plots.scaling import cost_over_pixels, cost_over_primitives, shows_exponents
from harness.report.plots.style import Palette, file_stem

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

Described = tuple[str, str, str, Chart | None]


def plots_of(analysis: Analysis) -> list[Plot]:
    """Those that the results allow."""
    palette = Palette(analysis.results)
    warning = _mixture(analysis)
    of_panels = [each for panel in panels(analysis) for each in _of_a_panel(analysis, panel, palette)]
    of_all = [(*words, chart and replace(chart, warning=warning)) for *words, chart in _of_all_scenes(analysis, palette)]
    found = [Plot(name, title, text, chart) for name, title, text, chart in (*of_panels, *of_all) if chart is not None]
    return [*found, *rays.plots(analysis.results), *stability.plots(analysis.results.check_results)]


def _mixture(analysis: Analysis) -> str:
    """What plots of all scenes say where several machines share their axes; panels belong to one machine each."""
    count = len({verdict.contestant.settings.machine for verdict in analysis.verdicts})
    return f"{count} machines: times must not be compared" if count > 1 else ""


def _of_all_scenes(analysis: Analysis, palette: Palette) -> list[Described]:
    exponents = " Numbers in the legend are exponents of the path's time between the two largest scenes."
    return [
        (
            "targets-over-time",
            "Targets reached over time",
            "Share of all scenes, targets and seeds that each contestant has reached by a given time. "
            "A scene on which it was not measured, or is not ranked, counts as not reached.",
            target_ecdf(analysis, palette),
        ),
        (
            "speed-up-over-threads",
            "Speed-up over threads",
            "Speed-up over the fewest threads, with 95 % intervals. Dotted: the ideal. The serial fraction is that of "
            "Amdahl's law, fitted up to the usable cores.",
            thread_speedups(analysis, palette),
        ),
        (
            "build-against-traverse",
            "Accelerators: build against traverse",
            "Time to build an accelerator, and time of a path through it, on logarithmic axes. "
            "Lines join contestants that differ in the accelerator alone. Lower left is better.",
            build_against_traverse(analysis, palette),
        ),
        (
            "cost-over-primitives",
            "Cost over the number of primitives",
            "Time of a path (a sample of a pixel), and time to build the accelerator, over the number of primitives of the "
            f"scenes, with 95 % intervals, on logarithmic axes.{exponents if shows_exponents(analysis) else ''}",
            cost_over_primitives(analysis, palette),
        ),
        (
            "cost-over-resolution",
            "Cost over resolution and samples",
            "Time of a path over the pixels of the image, and over the samples per pixel so far: flat where cost grows "
            "in proportion.",
            cost_over_pixels(analysis, palette),
        ),
    ]


def _of_a_panel(analysis: Analysis, panel: Panel, palette: Palette) -> Iterator[Described]:
    title = panel.title
    words = {"seconds": "time", "cold": "cold time", "spp": "samples", "rays": "rays"}
    for x, word in words.items():
        slopes = " Numbers in the legend are slopes of the RMSE, over samples that all share."
        note = slopes if shows_slopes(x, panel.verdicts) else ""
        yield (
            file_stem("error-over", word.replace(" ", "-"), title),
            f"{title}: error over {word}",
            f"Error of each contestant over {word}: the median over blocks, on logarithmic axes. Bands: the range "
            "over blocks. Dashed lines: targets. Crosses: errors below three standard errors."
            f"{note}",
            error_curves(analysis, panel, palette, x),
        )
    yield (
        file_stem("time-to-quality", title),
        f"{title}: time to quality",
        "Seconds that each contestant needs for each target. Full dots: warm. Hollow dots: cold. Whiskers: "
        "95 % intervals. With fewer than three blocks there is one dot per block.",
        quality_bars(analysis, panel, palette),
    )
    yield (
        file_stem("pareto", title),
        f"{title}: Pareto front of time against error",
        "Checkpoints by warm time and error. Strong markers, with intervals, are on the front: no other checkpoint is "
        "surely better in both, in time by more than twice the persistent spread.",
        pareto(analysis, panel, palette),
    )
    yield (
        file_stem("phases", title),
        f"{title}: phases of a cold start",
        "Geometric means of the seconds of import, load, build, compilation and rendering. The whisker at the end of "
        "a phase is the 95 % interval of that phase.",
        phase_bars(panel),
    )
