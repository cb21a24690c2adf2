"""Error over seconds, samples and rays, the Pareto front, and the share of targets reached over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.analysis import Analysis, Verdict, error_targets
from harness.analysis.comparisons import others
from harness.analysis.model import ranked_together
from harness.metrics import metric_title
from harness.report.plots.panels import MOST_CURVES, Panel, facets, reference_noise
from harness.report.plots.style import FAINT, GRID, INK, Palette, log_scales, new_figure, small_multiples
from harness.statistics import ecdf, geometric_interval, pareto_front
from harness.statistics.convergence import NOISE_ERRORS
from harness.statistics.ratios import FEWEST_BLOCKS
from harness.store.results import Contestant, Results, fixed_seconds, point_error

X_LABELS = {"seconds": "warm time [s]", "cold": "cold time [s]", "spp": "samples per pixel", "rays": "rays traced"}


class Band(NamedTuple):
    """A contestant's checkpoints over its seeds: median x and error, the range of seeds, and whether it is noise."""

    x: np.ndarray
    error: np.ndarray
    low: np.ndarray
    high: np.ndarray
    noisy: np.ndarray


def band(results: Results, verdict: Verdict, x: str) -> Band:
    """Checkpoints that at least half of the seeds reached. `x` is a key of `X_LABELS`."""
    rows: dict[int, list[tuple[float, float, float]]] = {}
    for cell in verdict.contestant.done:
        start = fixed_seconds(cell) if x == "cold" else 0.0
        for point in cell.points:
            error, se = point_error(point, results.metric)
            if math.isfinite(error) and (at := getattr(point, "seconds" if x == "cold" else x)):
                rows.setdefault(point.spp, []).append((start + at, error, se))
    enough = [np.array(rows[spp]) for spp in sorted(rows) if 2 * len(rows[spp]) >= len(verdict.contestant.done)]
    medians = np.array([np.median(row, axis=0) for row in enough]).reshape(-1, 3)
    low, high = (np.array([fold(row[:, 1]) for row in enough]) for fold in (np.min, np.max))
    return Band(medians[:, 0], medians[:, 1], low, high, medians[:, 1] <= NOISE_ERRORS * medians[:, 2])


def error_curves(analysis: Analysis, panel: Panel, palette: Palette, x: str) -> Figure | None:
    """Log-log error over `x` with the range of seeds as a band, targets as lines, the reference's noise as an area."""
    bands = {id(v): band(analysis.results, v, x) for v in panel.verdicts}
    positive = [b.error[b.error > 0] for b in bands.values() if (b.error > 0).any()]
    if not positive:
        return None
    parts = facets(panel.verdicts)
    figure, axes = small_multiples(len(parts), 3.7, 4.2 if len(parts) <= 3 else 4.0)
    bottom = min(errors.min() for errors in positive)
    for axis, part in zip(axes, parts, strict=True):
        for verdict in panel.verdicts:
            if verdict not in part.verdicts:
                _grey_curve(axis, bands[id(verdict)])
        for verdict in part.verdicts:
            _curve(axis, bands[id(verdict)], palette, verdict, _curve_label(verdict, x))
        _frame(axis, analysis.results, panel, bottom)
        axis.set_xlabel(X_LABELS[x])
        axis.set_title(part.title, fontsize=9)
    axes[0].set_ylabel(error_label(analysis.results.metric))
    _legend(figure, axes, palette, panel.verdicts)
    return figure


def error_label(metric: str) -> str:
    """The axis label of the quality metric as an error."""
    return {"psnr": "MSE of display values (from PSNR)", "ssim": "1 − SSIM"}.get(metric, metric_title(metric))


def pareto(analysis: Analysis, panel: Panel, palette: Palette) -> Figure | None:
    """Every checkpoint as a point of time and error; those that none surely beats are strong, with their intervals."""
    points = [point for verdict in panel.verdicts for point in _pareto_points(analysis.results, verdict)]
    if not points:
        return None
    floor = analysis.floor(panel.scene)
    beaten_by = math.exp(-floor)  # a lead within the noise floor is none
    bounds = np.array([[beaten_by * point.time.low, point.time.high, *point.error[1:3]] for point in points])
    fit = np.array([not point.verdict.disqualified for point in points])
    bounds[~fit] = math.nan
    front = pareto_front(*bounds.T)
    figure = new_figure(7.2, 4.6)
    axis = figure.subplots()
    for verdict in panel.verdicts:
        own = sorted((point.time.value, point.error.value) for point in points if point.verdict is verdict)
        look = palette.look(verdict.contestant)
        axis.plot(*np.array(own).reshape(-1, 2).T, color=look.colour, linestyle=look.line, linewidth=0.8, alpha=0.45)
    named: set[int] = set()
    for point, best in zip(points, front, strict=True):
        look = palette.look(point.verdict.contestant)
        if not best:
            axis.plot(point.time[0], point.error[0], marker=look.marker, color=look.colour, alpha=0.25, markersize=3)
            continue
        axis.errorbar(
            point.time[0],
            point.error[0],
            xerr=_whisker(point.time),
            yerr=_whisker(point.error),
            markersize=5,
            elinewidth=1,
            **look.line_style(),
            label=None if id(point.verdict) in named else point.verdict.contestant.name,
        )
        named.add(id(point.verdict))
    _frame(axis, analysis.results, panel, min(point.error[0] for point in points))
    axis.set_xlabel(X_LABELS["seconds"])
    axis.set_ylabel(error_label(analysis.results.metric))
    words = "dominated by another" if math.isfinite(floor) else "no front: the noise floor was not measured"
    axis.plot([], [], "o", color=FAINT, alpha=0.4, markersize=3, label=words)
    _legend(figure, [axis], palette, panel.verdicts)
    return figure


def target_ecdf(analysis: Analysis, palette: Palette) -> Figure | None:
    """Share of (scene, target, seed) reached by a warm time, for each configuration over its division and machine.

    A scene on which it was not measured, or on which a flag disqualifies it, counts as not reached.
    """
    problems: dict[tuple[str, str], int] = {}
    for (_, _, _, division, machine), group in ranked_together(analysis.verdicts).items():
        most = max(sum(len(quality.crossings) for quality in verdict.warm) for verdict in group)
        problems[division, machine] = problems.get((division, machine), 0) + most
    solvers: dict[Any, list[Verdict]] = {}
    for verdict in analysis.verdicts:
        if not (verdict.contestant.settings.label or verdict.disqualified):
            solvers.setdefault(others(verdict.contestant.settings, "scene", "size"), []).append(verdict)
    if not analysis.results.targets or not solvers:
        return None
    first = {id(verdicts[0]): verdicts for verdicts in solvers.values()}
    parts = facets([verdicts[0] for verdicts in solvers.values()])
    figure, axes = small_multiples(len(parts), 3.7, 4.2 if len(parts) <= 3 else 4.0)
    latest = max((c.end.seconds for v in analysis.verdicts for c in v.contestant.done), default=1.0)
    for axis, part in zip(axes, parts, strict=True):
        for verdict in part.verdicts:
            look = palette.look(verdict.contestant)
            own = [s.high for v in first[id(verdict)] for quality in v.warm for s in quality.crossings]
            settings = verdict.contestant.settings
            times, share = ecdf([*own, *[math.inf] * (problems[settings.division, settings.machine] - len(own))])
            name = verdict.contestant.name
            x = [*times[:1], *times, latest] if times.size else [latest]
            y = [0.0, *share, share[-1]] if times.size else [0.0]
            axis.step(x, y, where="post", markevery=0.15, label=name, **look.line_style())
        log_scales(axis)
        axis.set_ylim(0, 1.02)
        axis.set_xlabel(X_LABELS["seconds"])
        axis.set_title(part.title, fontsize=9)
    axes[0].set_ylabel("share of scenes × targets × seeds reached")
    _legend(figure, axes, palette, [verdicts[0] for verdicts in solvers.values()])
    return figure


class _ParetoPoint(NamedTuple):
    verdict: Verdict
    time: Any
    error: Any


def _pareto_points(results: Results, verdict: Verdict) -> list[_ParetoPoint]:
    """Checkpoints of three seeds or more whose error is above its noise, with intervals over seeds."""
    rows: dict[int, list[tuple[float, float]]] = {}
    for cell in verdict.contestant.done:
        for point in cell.points:
            error, se = point_error(point, results.metric)
            if error > NOISE_ERRORS * se and error > 0 and math.isfinite(error) and point.seconds > 0:
                rows.setdefault(point.spp, []).append((point.seconds, error))
    found = [
        _ParetoPoint(verdict, *(geometric_interval([pair[i] for pair in pairs]) for i in (0, 1)))
        for pairs in rows.values()
        if len(pairs) >= FEWEST_BLOCKS
    ]
    return found


def _whisker(estimate: Any) -> list[list[float]]:
    return [[estimate.value - estimate.low], [estimate.high - estimate.value]]


def shows_slopes(x: str, verdicts: Sequence[Verdict]) -> bool:
    """Whether the legend of their error over `x` has slopes: not every contestant has one, and beyond a few curves there is
    no entry a curve."""
    return x == "spp" and len(verdicts) <= MOST_CURVES and any(not math.isnan(v.slope.value) for v in verdicts)


def _curve_label(verdict: Verdict, x: str) -> str:
    if shows_slopes(x, [verdict]):
        return f"{verdict.contestant.name} ({verdict.slope.value:.2f})"
    return verdict.contestant.name


def _curve(axis: Axes, data: Band, palette: Palette, verdict: Verdict, label: str) -> None:
    look = palette.look(verdict.contestant)
    sure = ~data.noisy & (data.error > 0)
    axis.plot(data.x[sure], data.error[sure], label=label, **look.line_style())
    low = data.low[sure].clip(1e-300)
    axis.fill_between(data.x[sure], low, data.high[sure], color=look.colour, alpha=0.15, linewidth=0)
    noise = data.noisy & (data.error > 0)
    axis.plot(data.x[noise], data.error[noise], marker="x", linestyle="none", color=look.colour, alpha=0.5)


def _grey_curve(axis: Axes, data: Band) -> None:
    sure = ~data.noisy & (data.error > 0)
    axis.plot(data.x[sure], data.error[sure], color=GRID, linewidth=0.8, zorder=0.5)


def _frame(axis: Axes, results: Results, panel: Panel, bottom: float) -> None:
    """Log-log axes, targets, and the noise of the reference where it is in sight."""
    log_scales(axis, y=True)
    for named, target in zip(results.targets, error_targets(results), strict=True):
        axis.axhline(target, color=INK, linewidth=0.8, linestyle=(0, (2, 2)))
        axis.annotate(
            f"{named:g}", (1.0, target), xycoords=("axes fraction", "data"), fontsize=7, ha="right", va="bottom", color=INK
        )
    floor = min([bottom, *error_targets(results)]) * 0.7
    noise = reference_noise(results, panel)
    if noise is not None and noise[0] > floor:
        words = f"noise of the {noise[1]} spp reference"
        axis.axhspan(floor / 2, noise[0], color=FAINT, alpha=0.12, linewidth=0, label=words)
        floor = min(floor, noise[0] / 2)
    axis.set_ylim(bottom=floor)


def _legend(figure: Figure, axes: list[Axes], palette: Palette, verdicts: list[Verdict]) -> None:
    finish_legend(figure, axes, palette, [verdict.contestant for verdict in verdicts])


def finish_legend(figure: Figure, axes: list[Axes], palette: Palette, contestants: list[Contestant]) -> None:
    """An entry a curve beside the plot if they are few; else one a colour, line, marker and width, beneath."""
    if len(contestants) <= MOST_CURVES:
        axes[0].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0)
        return
    handles: list[Artist] = list(palette.key(contestants))
    labels = [str(handle.get_label()) for handle in handles]
    for handle, label in zip(*axes[0].get_legend_handles_labels(), strict=True):
        if label.startswith(("noise of", "dominated", "no front")):
            handles.append(handle)
            labels.append(label)
    figure.legend(handles, labels, loc="outside lower center", ncols=_columns(labels, 72 * figure.get_figwidth()))


def _columns(labels: list[str], width: float) -> int:
    """How many columns of a legend, at most six, fit into `width` points: letters take some 4.6 of them, a handle 40."""
    for count in range(6, 1, -1):
        rows = math.ceil(len(labels) / count)
        columns = [labels[first : first + rows] for first in range(0, len(labels), rows)]
        if sum(40 + 4.6 * max(map(len, column)) for column in columns) <= width:
            return count
    return 1
