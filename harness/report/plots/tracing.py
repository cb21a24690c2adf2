"""Rays per second against wrong answers, and against leaks: a figure a scene and number of threads, a column a set of rays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from harness.analysis.tracing import rates
from harness.report.plots.style import FAINT, INK, MARKERS, Sketch, engine_colours, file_stem, log_scales, new_figure
from harness.statistics import Estimate, geometric_interval, proportion_interval
from harness.trace.records import Entry, TraceResults

Shares = Callable[[Entry], Estimate]
ROWS: dict[str, Shares] = {
    "share of wrong answers": lambda entry: proportion_interval(*_counts(entry, "faults", "checked")),
    "share of leaks": lambda entry: proportion_interval(*_counts(entry, "leaks", "hard")),
}


def _counts(entry: Entry, *names: str) -> tuple[int, int]:
    one, other = (getattr(entry.answers, name) for name in names)
    return one, other


def sketches(results: TraceResults) -> list[Sketch]:
    """A figure for each scene and number of threads that has results."""
    found = []
    shown = [entry for entry in results.entries if entry.timings and entry.answers and not entry.twin]
    for scene, threads in dict.fromkeys((entry.scene, entry.threads) for entry in shown):
        own = [entry for entry in shown if (entry.scene, entry.threads) == (scene, threads)]
        title = f"{scene}, {threads} thread{'s' if threads > 1 else ''}: rays per second and errors"
        found.append(
            Sketch(
                file_stem("rays-against-errors", scene, f"{threads}t"),
                title,
                "Points by million rays per second of wall time and the share of wrong answers, and of leaks, logarithmic, "
                "with 95 % intervals. Hollow: no error was found; the point is the bound below which the share lies. Lower "
                "right is better.",
                partial(_figure, own, list(dict.fromkeys(entry.engine for entry in results.entries))),
            )
        )
    return found


def _figure(entries: Sequence[Entry], engines: Sequence[str]) -> Figure:
    kinds = list(dict.fromkeys(entry.rays for entry in entries))
    rows = {name: share for name, share in ROWS.items() if any(share(entry).n for entry in entries)}
    variants = list(dict.fromkeys(_variant(entry) for entry in entries))
    colours = engine_colours(engines)
    figure = new_figure(max(7.2, 3.2 * len(kinds)), 0.9 + 2.3 * max(1, len(rows)))
    grid = figure.subplots(max(1, len(rows)), len(kinds), squeeze=False, sharey="row", sharex="col")
    for axes, (name, share) in zip(grid, rows.items(), strict=False):
        for axis, kind in zip(axes, kinds, strict=True):
            for entry in entries:
                if entry.rays == kind and share(entry).n:
                    _point(axis, entry, share(entry), colours[entry.engine], MARKERS[variants.index(_variant(entry)) % 10])
            log_scales(axis, y=True)
        axes[0].set_ylabel(name)
        axes[0].set_ylim(*_limits([share(entry) for entry in entries]))
    for axis, kind in zip(grid[0], kinds, strict=True):
        axis.set_title(kind)
    for axis in grid[-1]:
        axis.set_xlabel("million rays per second")
    figure.legend(handles=_legend(entries, variants, colours), loc="outside lower center", ncols=5)
    return figure


def _limits(shares: Sequence[Estimate]) -> tuple[float, float]:
    """Ends of the axis of shares: half a decade around all that is drawn."""
    drawn = [value for share in shares if share.n for value in (share.high, share.low) if value > 0]
    return min(drawn) / 5, min(max(drawn) * 3, 1.5)


def _point(axis: Axes, entry: Entry, share: Estimate, colour: str, marker: str) -> None:
    rate = geometric_interval(rates(entry))
    place = share.value if share.value > 0 else share.high
    wide = [[max(0.0, rate.value - rate.low)], [max(0.0, rate.high - rate.value)]] if rate.n > 1 else None
    none = share.value == 0
    tall = [[0.5 * place], [0.0]] if none else [[place - share.low], [share.high - place]]
    axis.errorbar(
        rate.value,
        place,
        yerr=tall,
        xerr=wide,
        color=colour,
        marker=marker,
        linestyle="none",
        markersize=6,
        markerfacecolor="white" if none else colour,
        elinewidth=0.9,
        uplims=none,
    )


def _variant(entry: Entry) -> str:
    return " ".join(filter(None, [entry.accelerator, entry.precision]))


def _legend(entries: Sequence[Entry], variants: Sequence[str], colours: dict[str, str]) -> list[Any]:
    bare: dict[str, Any] = {"linestyle": "none"}
    found = [
        Line2D([], [], marker="o", color=colours[name], label=name, **bare)
        for name in dict.fromkeys(entry.engine for entry in entries)
    ]
    if len(variants) > 1:
        found += [Line2D([], [], marker=MARKERS[i % 10], color=INK, label=name, **bare) for i, name in enumerate(variants)]
    return [*found, Line2D([], [], marker="o", color=FAINT, markerfacecolor="white", label="none found: bound", **bare)]
