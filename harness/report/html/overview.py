"""The first screen of a report: per scene and target the fastest, its ratio to the baseline, and what the timing rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup, escape

from harness.analysis import Analysis, Verdict, error_targets
from harness.analysis.calibration import missed, plural
from harness.metrics import metric_title
from harness.report.plots.curves import band
from harness.report.plots.panels import Panel, panels
from harness.report.plots.style import LINES, Palette
from harness.report.tables.evidence import spread_of, weakness_of
from harness.report.tables.model import number_text
from harness.report.winners import Standing, seconds_text, standing
from harness.statistics.ratios import FEWEST_BLOCKS, PersistentSpread
from harness.store.records import Calibration, Reference

PLOT_WIDTH, PLOT_HEIGHT, LEFT, BOTTOM = 250, 132, 36, 18


class JudgedReference(NamedTuple):
    """A reference with what its certificate says, in words, and whether it is certified or refuted."""

    record: Reference
    certificate: str
    certified: bool
    refuted: bool


class Entry(NamedTuple):
    """A contestant in a cell: its warm seconds with their interval, `ratio` with what it is a ratio to, or in `no_ratio` why
    there is none, and its warnings."""

    name: str
    seconds: str
    ratio: str
    other: str
    no_ratio: str
    warnings: list[str]


class Badge(NamedTuple):
    """What the times of a cell rest on: the persistent spread of the machine, and `remarks` on what weakens it."""

    spread: str
    remarks: list[str]


class Cell(NamedTuple):
    """A scene and target. `entries` are the possible winners: one is the fastest, several are not separated. Where there
    is none, `nobody` says why."""

    target: str
    entries: list[Entry]
    nobody: str
    reached: int
    out_of: int
    ranked: int
    left_out: list[str]
    badge: Badge


class Row(NamedTuple):
    """A panel: its cells along the targets, a small plot of error over time, and its measurement quality in words."""

    title: str
    stem: str
    cells: list[Cell]
    plot: Markup
    quality: dict[str, str]


def matrix(analysis: Analysis, calibration: Calibration, references: Sequence[JudgedReference]) -> list[Row]:
    """One row a panel; empty without targets, or without a measured cell."""
    palette, targets = Palette(analysis.results), analysis.results.targets
    found = []
    for panel in panels(analysis) if targets else []:
        reference = reference_of(panel, references)
        cells = [_cell(analysis, panel, target, calibration, reference) for target in targets]
        found.append(
            Row(panel.title, panel.stem, cells, small_plot(analysis, panel, palette), _quality(analysis, panel, reference))
        )
    return found


def colour_key(analysis: Analysis) -> list[tuple[str, str]]:
    """What the colours of curves mean, and the colours."""
    return Palette(analysis.results).colours([verdict.contestant for verdict in analysis.verdicts])


def reference_of(panel: Panel, references: Sequence[JudgedReference]) -> JudgedReference | None:
    """The reference that a panel's errors are measured against."""
    reference_id = panel.verdicts[0].contestant.done[0].reference_id
    return next((each for each in references if each.record.reference_id == reference_id), None)


def _cell(analysis: Analysis, panel: Panel, target: float, calibration: Calibration, reference: JudgedReference | None) -> Cell:
    found = standing(analysis, panel, target)
    return Cell(
        f"{target:g}",
        [_entry(found, *possible) for possible in found.possible],
        found.nobody,
        len(found.reached),
        len(found.rows),
        len(found.ranked),
        found.left_out,
        Badge(spread_of(_spread(analysis, panel)), list(_remarks(analysis, found, calibration, reference))),
    )


def _entry(found: Standing, verdict: Verdict, row: Any) -> Entry:
    ratio, other = found.ratio_of(row)
    why_not = "" if ratio else row.no_ratio or "it or its baseline reached the target in no block"
    return Entry(row.contestant, seconds_text(row), ratio, other, why_not, verdict.warnings)


def _remarks(analysis: Analysis, found: Standing, calibration: Calibration, reference: JudgedReference | None) -> Iterator[str]:
    """What weakens the verdict of a cell, a sentence each."""
    panel = found.panel
    if _fewest_blocks(panel) < FEWEST_BLOCKS:
        yield f"fewer than {FEWEST_BLOCKS} blocks: no verdict is given"
    if weakness := weakness_of(_spread(analysis, panel)):
        yield weakness
    contended, judged = _contention(panel)
    if contended or not judged:
        yield f"{contended} of {judged} timings contended" if judged else "contention was not measured"
    if noisy := found.noisy:
        yield f"the reference is too noisy for the times of {plural(noisy, 'contestant')}"
    if calibration.races is None:
        yield "the run is too small for a calibration"
    if lacking := missed(calibration):
        yield f"calibration missed: {', '.join(lacking)}"
    if reference is not None and not reference.certified:
        yield f"the reference is {'refuted' if reference.refuted else 'uncertified'}"


def _quality(analysis: Analysis, panel: Panel, reference: JudgedReference | None) -> dict[str, str]:
    """The row of the section on measurement quality."""
    counts = sorted({len({cell.block for cell in verdict.contestant.done}) for verdict in panel.verdicts})
    contended, judged = _contention(panel)
    certified = reference.certificate if reference is not None else "no reference is recorded"
    return {
        "blocks": f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else str(counts[0]),
        "contended": f"{contended} of {judged}" if judged else "not measured",
        "spread": spread_of(_spread(analysis, panel)),
        "reference": certified,
    }


def _spread(analysis: Analysis, panel: Panel) -> PersistentSpread:
    """That of the panel's machine."""
    return analysis.spread(panel.verdicts[0].contestant)


def _fewest_blocks(panel: Panel) -> int:
    return min(len({cell.block for cell in verdict.contestant.done}) for verdict in panel.verdicts)


def _contention(panel: Panel) -> tuple[int, int]:
    """(contended, judged) timings of the panel's contestants."""
    found = [cell.machine.contended for verdict in panel.verdicts for cell in verdict.contestant.done]
    judged = [bool(contended) for contended in found if contended is not None]
    return sum(judged), len(judged)


def small_plot(analysis: Analysis, panel: Panel, palette: Palette) -> Markup:
    """Error over warm seconds on logarithmic axes: medians over blocks with their range, possible winners thicker."""
    curves = []
    for verdict in panel.verdicts:
        data = band(analysis.results, verdict, "seconds")
        sure = ~data.noisy & (data.error > 0) & (data.low > 0)
        if sure.any():
            curves.append((verdict, *(np.log10(values[sure]) for values in (data.x, data.error, data.low, data.high))))
    if not curves:
        return Markup("")
    targets = [math.log10(target) for target in error_targets(analysis.results)]
    x0, x1 = _ends(np.concatenate([curve[1] for curve in curves]))
    y0, y1 = _ends(np.concatenate([*(part for curve in curves for part in curve[3:]), targets]))

    def x_of(x: float) -> float:
        return LEFT + (x - x0) / (x1 - x0) * (PLOT_WIDTH - LEFT - 4)

    def y_of(y: float) -> float:
        return 4 + (y1 - y) / (y1 - y0) * (PLOT_HEIGHT - BOTTOM - 4)

    def path(xs: Sequence[float], ys: Sequence[float]) -> str:
        return " ".join(f"{x_of(x):.1f},{y_of(y):.1f}" for x, y in zip(xs, ys, strict=True))

    parts = []
    for tick in _ticks(x0, x1):
        x, words = x_of(math.log10(tick)), f"{tick:g}"
        parts.append(
            f'<path class="grid" d="M{x:.1f} 4V{PLOT_HEIGHT - BOTTOM}"/>'
            f'<text x="{x:.1f}" y="{PLOT_HEIGHT - 5}" text-anchor="middle">{words}</text>'
        )
    for named, target in zip(analysis.results.targets, targets, strict=True):
        y = y_of(target)
        parts.append(
            f'<path class="target" d="M{LEFT} {y:.1f}H{PLOT_WIDTH - 4}"/>'
            f'<text x="{LEFT - 3}" y="{y + 3:.1f}" text-anchor="end">{named:g}</text>'
        )
    rows = analysis.by_target
    winners = set(rows[rows.possible_winner & (rows.scene == panel.scene)].contestant)
    for verdict, x, error, low, high in curves:
        look, best = palette.look(verdict.contestant), verdict.contestant.name in winners
        around = path([*x, *x[::-1]], [*low, *high[::-1]])
        dashes = f' stroke-dasharray="{_dashes(look.line)}"' if look.line != "-" else ""
        parts.append(
            f"<g><title>{escape(verdict.contestant.name)}</title>"
            f'<polygon points="{around}" fill="{look.colour}" opacity=".15"/>'
            f'<polyline points="{path(x, error)}" fill="none" stroke="{look.colour}" '
            f'stroke-width="{2.6 if best else 1}"{dashes}/></g>'
        )
    label = escape(
        f"{panel.title}: {metric_title(analysis.results.metric)} over warm seconds of {len(curves)} contestants, "
        f"logarithmic, {number_text(10**x0)} to {number_text(10**x1)} s. Horizontal lines: targets."
    )
    box = f'viewBox="0 0 {PLOT_WIDTH} {PLOT_HEIGHT}"'
    return Markup(f'<svg class="small" {box} role="img" aria-label="{label}">{"".join(parts)}</svg>')


def _ends(logs: np.ndarray) -> tuple[float, float]:
    """The ends of an axis, with some room."""
    low, high = float(logs.min()), float(logs.max())
    room = max(0.04 * (high - low), 0.02)
    return low - room, high + room


def _ticks(low: float, high: float) -> list[float]:
    """Powers of ten between two logarithms; where there are fewer than two, 2 and 5 of each decade too."""
    steps = range(math.floor(low), math.ceil(high) + 1)
    for digits in ((1,), (1, 2, 5)):
        found = [digit * 10.0**step for step in steps for digit in digits if low <= math.log10(digit * 10.0**step) <= high]
        if len(found) > 1:
            break
    return found


def _dashes(line: Any) -> str:
    """A line of Matplotlib as dashes of SVG."""
    if isinstance(line, tuple):
        return " ".join(str(length) for length in line[1])
    return {"--": "5 2", "-.": "5 2 1 2", ":": "1 2"}.get(line, "none") if line in LINES else "none"
