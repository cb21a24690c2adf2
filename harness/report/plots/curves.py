"""Error over seconds, samples and rays, the Pareto front, and the share of targets reached over time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from harness.analysis import Analysis, Verdict, error_targets
from harness.analysis.axes import others
from harness.analysis.model import ranked_together
from harness.metrics import metric_title
from harness.report.plots.chart import FAINT, GRID, Axis, Chart, Entry, Guide, Look, Series, Subplot, interval
from harness.report.plots.panels import Panel, facets, reference_noise
from harness.report.plots.style import MOST_CURVES, Palette, curve_legend, small_multiples
from harness.statistics import Estimate, ecdf, geometric_interval, pareto_front
from harness.statistics.convergence import NOISE_ERRORS
from harness.statistics.ratios import FEWEST_BLOCKS
from harness.store.records import Cell
from harness.store.results import Results, fixed_seconds, point_error

X_LABELS = {"seconds": "warm time [s]", "cold": "cold time [s]", "spp": "samples per pixel", "rays": "rays traced"}
HOVER_NAMES = {"cold": "cold seconds", "rays": "rays"}


class Band(NamedTuple):
    """A contestant's checkpoints over its seeds, (n,) each: samples per pixel, medians of x, error and warm seconds, the range
    of errors over seeds, and whether the error is noise."""

    spp: np.ndarray
    x: np.ndarray
    error: np.ndarray
    seconds: np.ndarray
    low: np.ndarray
    high: np.ndarray
    noisy: np.ndarray


def band(results: Results, verdict: Verdict, x: str) -> Band:
    """Checkpoints that more than half of the seeds reached. `x` is a key of `X_LABELS`.

    A seed that ended before a checkpoint counts as infinitely far in the medians of x and seconds: those of the others alone,
    the faster ones, could go back in time. A seed that passed it, with other checkpoints, counts by interpolation. Patterns of
    a sampler are rendered one by one: where a larger one took less time, the smaller one is left out.
    """
    seeds = [_usable(results, cell, x) for cell in verdict.contestant.done]
    counts = Counter(spp for rows in seeds for spp in rows)
    spp = np.array(sorted(each for each, count in counts.items() if 2 * count >= len(seeds)), int)
    place, seconds = (_median_reached(seeds, spp, column) for column in (0, 3))
    errors = [np.array([rows[each][1:3] for rows in seeds if each in rows]) for each in spp]
    error, se = np.array([np.median(each, axis=0) for each in errors]).reshape(-1, 2).T
    low, high = (np.array([fold(each[:, 0]) for each in errors]) for fold in (np.min, np.max))
    found = Band(spp, place, error, seconds, low, high, error <= NOISE_ERRORS * se)
    later = np.minimum.accumulate(np.append(place, math.inf)[::-1])[::-1][1:]
    return Band(*(values[place < later] for values in found))


def _usable(results: Results, cell: Cell, x: str) -> dict[int, tuple[float, float, float, float]]:
    """Of each checkpoint that has a finite error and an x: samples -> x, error, its standard error, warm seconds."""
    start, rows = fixed_seconds(cell) if x == "cold" else 0.0, {}
    for point in cell.points:
        error, se = point_error(point, results.metric)
        if math.isfinite(error) and (at := getattr(point, "seconds" if x == "cold" else x)):
            rows[point.spp] = start + at, error, se, point.seconds
    return dict(sorted(rows.items()))


def _median_reached(seeds: Sequence[Mapping[int, tuple[float, ...]]], spp: np.ndarray, column: int) -> np.ndarray:
    """The median over seeds of where each has so many samples; infinite where no more than half of them do."""
    nowhere = np.full(len(spp), math.inf)
    reached = [
        np.interp(spp, [*rows], [row[column] for row in rows.values()], right=math.inf) if rows else nowhere for rows in seeds
    ]
    return np.median(reached, axis=0) if reached else np.zeros(0)


def error_curves(analysis: Analysis, panel: Panel, palette: Palette, x: str) -> Chart | None:
    """Log-log error over `x` with the range of seeds as a band, targets as lines, the reference's noise as an area."""
    bands = {id(v): band(analysis.results, v, x) for v in panel.verdicts}
    positive = [b.error[b.error > 0] for b in bands.values() if (b.error > 0).any()]
    if not positive:
        return None
    guides, low = _guides(analysis.results, panel, min(errors.min() for errors in positive))
    y = Axis(error_label(analysis.results.metric), low=low)
    subplots = []
    for part in facets(panel.verdicts):
        grey = [_grey_curve(bands[id(v)]) for v in panel.verdicts if v not in part.verdicts]
        own = [s for v in part.verdicts for s in _curve(bands[id(v)], palette, v, x)]
        subplots.append(Subplot(Axis(X_LABELS[x]), y, [*grey, *own], title=part.title, guides=guides))
    height = 4.2 if len(subplots) <= 3 else 4.0
    return small_multiples(subplots, 3.7, height, **_legend(palette, panel.verdicts))


def error_label(metric: str) -> str:
    """The axis label of the quality metric as an error."""
    return {"psnr": "MSE of display values (from PSNR)", "ssim": "1 − SSIM"}.get(metric, metric_title(metric))


def pareto(analysis: Analysis, panel: Panel, palette: Palette) -> Chart | None:
    """Every checkpoint as a point of time and error; those that none surely beats are strong, with their intervals."""
    points = [point for verdict in panel.verdicts for point in _pareto_points(analysis.results, verdict)]
    if not points:
        return None
    spread = math.sqrt(analysis.spread(panel.verdicts[0].contestant).variance)
    beaten_by = math.exp(-2 * spread)  # by a smaller lead equal contestants may differ
    bounds = np.array([[beaten_by * point.time.low, point.time.high, *point.error[1:3]] for point in points])
    fit = np.array([not point.verdict.disqualified for point in points])
    bounds[~fit] = math.nan
    front = pareto_front(*bounds.T)
    lines, faint, strong = [], [], []
    for verdict in panel.verdicts:
        own = sorted((point for point in points if point.verdict is verdict), key=lambda p: (p.time.value, p.error.value))
        look = palette.look(verdict.contestant)
        places = np.array([(point.time.value, point.error.value) for point in own]).reshape(-1, 2)
        thin = look._replace(marker="", width=0.8)
        lines.append(Series(places[:, 0], places[:, 1], thin, verdict.contestant.name, opacity=0.45))
        best = {id(point) for point, best in zip(points, front, strict=True) if best}
        beaten = [point for point in own if id(point) not in best]
        faint.append(_checkpoints(beaten, look._replace(filled=True, size=3), verdict, joined=False, opacity=0.25))
        if leading := [point for point in own if id(point) in best]:
            ends: dict[str, Any] = {
                "x_interval": interval([point.time for point in leading]),
                "y_interval": interval([point.error for point in leading]),
                "label": verdict.contestant.name,
            }
            strong.append(_checkpoints(leading, look._replace(size=5), verdict, joined=False, **ends))
    guides, low = _guides(analysis.results, panel, min(point.error.value for point in points))
    words = "dominated by another" if math.isfinite(spread) else "no front: the persistent spread was not measured"
    legend = _legend(palette, panel.verdicts, Entry(words, Look(FAINT, "none", "o", size=3)))
    axes = Axis(X_LABELS["seconds"]), Axis(error_label(analysis.results.metric), low=low)
    return Chart([Subplot(*axes, [*lines, *faint, *strong], guides=guides)], 7.2, 4.6, **legend)


def target_ecdf(analysis: Analysis, palette: Palette) -> Chart | None:
    """Share of (scene, target, seed) reached by a warm time, for each configuration over its division and machine.

    A scene on which it was not measured, or on which a flag disqualifies it, counts as not reached.
    """
    problems: dict[tuple[str, str], int] = {}
    for (_, _, _, division, machine), group in ranked_together(analysis.verdicts).items():
        most = max(len(verdict.contestant.runs) for verdict in group) * len(analysis.results.targets)
        problems[division, machine] = problems.get((division, machine), 0) + most
    solvers: dict[Any, list[Verdict]] = {}
    for verdict in analysis.verdicts:
        if not (verdict.contestant.settings.label or verdict.disqualified):
            solvers.setdefault(others(verdict.contestant.settings, "scene", "size"), []).append(verdict)
    if not analysis.results.targets or not solvers:
        return None
    first = {id(verdicts[0]): verdicts for verdicts in solvers.values()}
    latest = max((c.end.seconds for v in analysis.verdicts for c in v.contestant.done), default=1.0)
    y = Axis("share of scenes × targets × seeds reached", "linear", 0, 1.02)
    subplots = []
    for part in facets([verdicts[0] for verdicts in solvers.values()]):
        curves = []
        for verdict in part.verdicts:
            times = [
                analysis.crossings_of(v.contestant, target).query("own").high
                for v in first[id(verdict)]
                for target in analysis.results.targets
            ]
            own = [seconds for each in times for seconds in each]
            settings, name = verdict.contestant.settings, verdict.contestant.name
            times, share = ecdf([*own, *[math.inf] * (problems[settings.division, settings.machine] - len(own))])
            steps = np.array([*times[:1], *times, latest] if times.size else [latest], float)
            reached = np.array([0.0, *share, share[-1]] if times.size else [0.0])
            hover = {"reached": [f"{100 * one:.0f} %" for one in reached], "seconds": steps}
            curves.append(Series(steps, reached, palette.look(verdict.contestant), name, name, hover, step=True))
        subplots.append(Subplot(Axis(X_LABELS["seconds"]), y, curves, title=part.title))
    height = 4.2 if len(subplots) <= 3 else 4.0
    return small_multiples(subplots, 3.7, height, **_legend(palette, [verdicts[0] for verdicts in solvers.values()]))


class _ParetoPoint(NamedTuple):
    verdict: Verdict
    spp: int
    time: Estimate
    error: Estimate


def _pareto_points(results: Results, verdict: Verdict) -> list[_ParetoPoint]:
    """Checkpoints of three seeds or more whose error is above its noise, with intervals over seeds."""
    rows: dict[int, list[tuple[float, float]]] = {}
    for cell in verdict.contestant.done:
        for point in cell.points:
            error, se = point_error(point, results.metric)
            if error > NOISE_ERRORS * se and error > 0 and math.isfinite(error) and point.seconds > 0:
                rows.setdefault(point.spp, []).append((point.seconds, error))
    return [
        _ParetoPoint(verdict, spp, *(geometric_interval([pair[i] for pair in pairs]) for i in (0, 1)))
        for spp, pairs in rows.items()
        if len(pairs) >= FEWEST_BLOCKS
    ]


def _checkpoints(points: Sequence[_ParetoPoint], look: Look, verdict: Verdict, **options: Any) -> Series:
    times, errors = ([getattr(point, name).value for point in points] for name in ("time", "error"))
    hover = {"samples": [point.spp for point in points], "error": errors, "seconds": times}
    return Series(np.array(times), np.array(errors), look, verdict.contestant.name, hover=hover, **options)


def shows_slopes(x: str, verdicts: Sequence[Verdict]) -> bool:
    """Whether the legend of their error over `x` has slopes: not every contestant has one, and beyond a few curves there is
    no entry a curve."""
    return x == "spp" and len(verdicts) <= MOST_CURVES and any(not math.isnan(v.slope.value) for v in verdicts)


def _curve_label(verdict: Verdict, x: str) -> str:
    if shows_slopes(x, [verdict]):
        return f"{verdict.contestant.name} ({verdict.slope.value:.2f})"
    return verdict.contestant.name


def _curve(data: Band, palette: Palette, verdict: Verdict, x: str) -> list[Series]:
    """The line with its band, and crosses where the error is noise."""
    look, name = palette.look(verdict.contestant), verdict.contestant.name
    texts = [f"{e:.3g} ({low:.3g} to {high:.3g})" for e, low, high in zip(data.error, data.low, data.high, strict=True)]
    columns: dict[str, Any] = {"samples": data.spp, "error": np.array(texts, object), "seconds": data.seconds}
    if x in HOVER_NAMES:
        columns[HOVER_NAMES[x]] = data.x

    def part(chosen: np.ndarray, look: Look, **options: Any) -> Series:
        hover = {column: values[chosen] for column, values in columns.items()}
        return Series(data.x[chosen], data.error[chosen], look, name, hover=hover, **options)

    sure, noise = ~data.noisy & (data.error > 0), data.noisy & (data.error > 0)
    ends = np.column_stack([data.low[sure].clip(1e-300), data.high[sure]])
    line = part(sure, look, label=_curve_label(verdict, x), y_interval=ends, area=True)
    crosses = part(noise, Look(look.colour, "none", "x"), opacity=0.5)
    return [line, crosses] if noise.any() else [line]


def _grey_curve(data: Band) -> Series:
    sure = ~data.noisy & (data.error > 0)
    return Series(data.x[sure], data.error[sure], Look(GRID, width=0.8), behind=True)


def _guides(results: Results, panel: Panel, bottom: float) -> tuple[list[Guide], float]:
    """Targets, the noise of the reference where it is in sight, and the low end of the axis."""
    guides = [Guide(target, f"{named:g}") for named, target in zip(results.targets, error_targets(results), strict=True)]
    low = min([bottom, *error_targets(results)]) * 0.7
    noise = reference_noise(results, panel)
    if noise is not None and noise[0] > low:
        guides.append(Guide(noise[0], f"noise of the {noise[1]} spp reference", low / 2, FAINT))
        low = min(low, noise[0] / 2)
    return guides, low


def _legend(palette: Palette, verdicts: Sequence[Verdict], *more: Entry) -> dict[str, Any]:
    """Options of a chart, with `more` entries."""
    legend = curve_legend(palette, [verdict.contestant for verdict in verdicts])
    return legend | {"more": more}
