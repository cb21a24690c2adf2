"""Time-to-quality with intervals, phases, and speed-up over threads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.analysis import Analysis, seconds_per_sample
from harness.analysis.columns import estimate_of
from harness.analysis.scaling import serial_fraction_of, thread_families
from harness.report.plots.chart import FAINT, GRID, INK, Axis, Bars, Chart, Entry, Look, Note, Series, Subplot, interval
from harness.report.plots.panels import Panel
from harness.report.plots.style import MOST_CURVES, Palette, small_multiples
from harness.report.tables.model import reached_text
from harness.statistics import parallel_speedups
from harness.statistics.ratios import FEWEST_BLOCKS
from harness.store.results import PHASES, Contestant, Results

PHASE_COLOURS = {"import": "#999999", "load": "#f0e442", "build": "#e69f00", "compile": "#cc79a7", "render": "#0072b2"}
PHASE_HATCHES = {"import": "|||", "load": "xxx", "build": "///", "compile": "\\\\\\", "render": ""}
STARTS = (
    Entry("warm: rendering alone", Look(INK, "none", "o")),
    Entry("cold: with import, load, build, compilation", Look(INK, "none", "o", False)),
)


def quality_bars(analysis: Analysis, panel: Panel, palette: Palette) -> Chart | None:
    """A panel for each target, two in a row; warm times are full dots, cold times hollow ones, whiskers 95 % intervals."""
    targets = analysis.results.targets
    if not targets:
        return None
    rows, columns = _names(panel), min(len(targets), 2)
    lines = math.ceil(len(targets) / columns)
    subplots = [
        Subplot(
            Axis("time [s]"),
            rows,
            _quality_rows(analysis, panel, target, palette),
            f"until {target:g}",
            notes=_quality_notes(analysis, panel, target),
        )
        for target in targets
    ]
    height = 0.7 + (0.8 + 0.24 * len(panel.verdicts)) * lines
    return Chart(subplots, 7.4, height, columns, "below", more=STARTS)


def _names(panel: Panel) -> Axis:
    return Axis("", "linear", names=[verdict.contestant.name for verdict in panel.verdicts])


def _quality_notes(analysis: Analysis, panel: Panel, target: float) -> list[Note]:
    notes = []
    for place, verdict in enumerate(panel.verdicts):
        row = analysis.at(verdict.contestant, target)
        if not math.isfinite(row.seconds):
            notes.append(Note(place, f"{row.reached}/{row.seeds} reached", colour=FAINT))
        elif row.at_first:
            notes.append(Note(place, f"< ({reached_text(row)})", row.cold_seconds))
    return notes


def _quality_rows(analysis: Analysis, panel: Panel, target: float, palette: Palette) -> list[Series]:
    """Means with whiskers; below three blocks a dot a block, for there an interval says nothing."""
    every = [(place, v.contestant, analysis.at(v.contestant, target)) for place, v in enumerate(panel.verdicts)]
    timed = [(place, contestant, row) for place, contestant, row in every if math.isfinite(row.seconds)]
    joins = np.array([(x, place) for place, _, row in timed for x in (row.seconds, row.cold_seconds, math.nan)]).reshape(-1, 2)
    found = [Series(joins[:, 0], joins[:, 1], Look(GRID, width=3), behind=True)]
    for colour in dict.fromkeys(palette.look(contestant).colour for _, contestant, _ in timed):
        own = [each for each in timed if palette.look(each[1]).colour == colour]
        found += [_dots(analysis, own, target, Look(colour, "none", "o", filled)) for filled in (False, True)]
    return found


def _dots(analysis: Analysis, timed: Sequence[tuple[int, Contestant, Any]], target: float, look: Look) -> Series:
    """Dots of one colour, warm times (full) or cold ones; the hover text says the interval, too."""
    seconds = "seconds" if look.filled else "cold seconds"
    rows: list[float] = []
    x: list[float] = []
    ends: list[tuple[float, float]] = []
    hover: dict[str, list[Any]] = {"contestant": [], "error": [], seconds: [], "95 % interval": [], "reached": []}
    for place, contestant, row in timed:
        mean, low, high, _ = estimate_of(row, "seconds" if look.filled else "cold_seconds")
        each = analysis.crossings_of(contestant, target).query("own")
        few = row.seeds < FEWEST_BLOCKS
        for value in each.high + each.fixed_seconds * (not look.filled) if few else [mean]:
            known = not few and not row.at_first
            texts = (contestant.name, target, value, f"{low:.3g} to {high:.3g} s" if known else None)
            rows.append(place)
            x.append(value)
            ends.append((low, high) if known else (math.nan, math.nan))
            for column, text in zip(hover, (*texts, reached_text(row)), strict=True):
                hover[column].append(text)
    return Series(np.array(x), np.array(rows, float), look, hover=hover, x_interval=np.array(ends).reshape(-1, 2))


def phase_bars(panel: Panel) -> Chart:
    """Stacked mean seconds of a whole cell; a whisker at the end of each phase is its own interval."""
    rows = _names(panel)
    left = np.zeros(len(rows.names))
    bars = []
    for phase in PHASES:
        estimates = [verdict.phases[phase] for verdict in panel.verdicts]
        seconds = np.nan_to_num([estimate.value for estimate in estimates])
        ends = interval(estimates)
        hover = {
            "contestant": rows.names,
            "phase": [phase] * len(rows.names),
            "seconds": seconds,
            "95 % interval": [f"{low:.3g} to {high:.3g} s" if low < high else None for low, high in ends],
        }
        look = PHASE_COLOURS[phase], PHASE_HATCHES[phase]
        bars.append(Bars(left.copy(), seconds, left[:, None] + ends, *look, phase, hover))
        left += seconds
    x = Axis("geometric mean time [s]", "linear")
    return Chart([Subplot(x, rows, bars)], 7.2, 1.4 + 0.24 * len(rows.names), legend="below")


def thread_speedups(analysis: Analysis, palette: Palette) -> Chart | None:
    """Speed-up over threads with intervals, the ideal, and Amdahl's law as fitted; a subplot a scene."""
    families = thread_families(analysis.results)
    if not families:
        return None
    scenes: dict[str, list[list[Contestant]]] = {}
    for family in families:
        scenes.setdefault(family[0].settings.scene, []).append(family)
    most = max(map(len, scenes.values()))
    many = most > MOST_CURVES
    height = 3.0 + (0.5 if many else 0.11 * most)
    counts = np.array(sorted({contestant.settings.threads for family in families for contestant in family}), float)
    ideal = Series(counts, counts / counts[0], Look(FAINT, ":", width=0.8), label="ideal", behind=True)
    x = Axis("threads", "linear", ticks={count: f"{count:g}" for count in counts})
    subplots = [
        Subplot(
            x,
            Axis("speed-up", "linear"),
            [ideal, *(_speedup_curve(analysis.results, family, palette) for family in of_scene)],
            scene,
        )
        for scene, of_scene in scenes.items()
    ]
    if many:
        return small_multiples(subplots, 3.4, height, legend="below", key=palette.key([family[0] for family in families]))
    return small_multiples(subplots, 3.4, height, legend="each")


def _speedup_curve(results: Results, family: list[Contestant], palette: Palette) -> Series:
    seconds = {contestant.settings.threads: seconds_per_sample(contestant) for contestant in family}
    rows = parallel_speedups(seconds)
    fit = serial_fraction_of(results, family)
    name = family[0].name.replace(f" {family[0].settings.threads} thread", "").removesuffix("s")
    serial = "" if math.isnan(fit.value) else f" (serial {100 * fit.value:.1f} %)"
    threads, values = [row.threads for row in rows], [row.speedup.value for row in rows]
    hover = {"threads": threads, "speed-up": values, "efficiency": [row.efficiency.value for row in rows]}
    ends = interval([row.speedup for row in rows])
    look = palette.look(family[0])._replace(filled=True, width=1.4)
    return Series(np.array(threads, float), np.array(values), look, name, name + serial, hover, y_interval=ends)
