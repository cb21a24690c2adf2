"""Rays per second against wrong answers, and against leaks: a figure a scene and number of threads, a column a set of rays."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.analysis.tracing import rates
from harness.report.plots.chart import FAINT, INK, MARKERS, Axis, Chart, Entry, Look, Plot, Series, Subplot, interval
from harness.report.plots.style import engine_colours, file_stem
from harness.statistics import Estimate, geometric_interval, proportion_interval
from harness.trace import records
from harness.trace.records import TraceResults

Shares = Callable[[records.Entry], Estimate]
ROWS: dict[str, Shares] = {
    "share of wrong answers": lambda entry: proportion_interval(*_counts(entry, "faults", "checked")),
    "share of leaks": lambda entry: proportion_interval(*_counts(entry, "leaks", "hard")),
}


def _counts(entry: records.Entry, *names: str) -> tuple[int, int]:
    one, other = (getattr(entry.answers, name) for name in names)
    return one, other


def plots(results: TraceResults) -> list[Plot]:
    """A figure for each scene and number of threads that has results."""
    found = []
    shown = [entry for entry in results.entries if entry.timings and entry.answers and not entry.twin]
    engines = list(dict.fromkeys(entry.engine for entry in results.entries))
    for scene, threads in dict.fromkeys((entry.scene, entry.threads) for entry in shown):
        own = [entry for entry in shown if (entry.scene, entry.threads) == (scene, threads)]
        title = f"{scene}, {threads} thread{'s' if threads > 1 else ''}: rays per second and errors"
        found.append(
            Plot(
                file_stem("rays-against-errors", scene, f"{threads}t"),
                title,
                "Points by million rays per second of wall time and the share of wrong answers, and of leaks, logarithmic, "
                "with 95 % intervals. Hollow: no error was found; the point is the bound below which the share lies. Lower "
                "right is better.",
                _chart(own, engines),
            )
        )
    return found


def _chart(entries: Sequence[records.Entry], engines: Sequence[str]) -> Chart:
    kinds = list(dict.fromkeys(entry.rays for entry in entries))
    rows = {name: share for name, share in ROWS.items() if any(share(entry).n for entry in entries)}
    variants = list(dict.fromkeys(_variant(entry) for entry in entries))
    colours = engine_colours(engines)

    def point(entry: records.Entry, name: str, share: Estimate) -> Series:
        look = Look(colours[entry.engine], "none", MARKERS[variants.index(_variant(entry)) % len(MARKERS)])
        return _point(entry, name, share, look._replace(filled=share.value != 0, size=6))

    subplots = []
    for name, share in rows.items():
        low, high = _limits([share(entry) for entry in entries])
        for kind in kinds:
            own = [point(entry, name, share(entry)) for entry in entries if entry.rays == kind and share(entry).n]
            subplots.append(Subplot(Axis("million rays per second"), Axis(name, low=low, high=high), own, kind))
    size = max(7.2, 3.2 * len(kinds)), 0.9 + 2.3 * max(1, len(rows))
    more = [Entry(name, Look(colours[name], "none", "o")) for name in dict.fromkeys(entry.engine for entry in entries)]
    if len(variants) > 1:
        more += [Entry(name, Look(INK, "none", MARKERS[i % len(MARKERS)])) for i, name in enumerate(variants)]
    more.append(Entry("none found: bound", Look(FAINT, "none", "o", False)))
    return Chart(subplots, *size, len(kinds), "below", more=more, shared_x="col", shared_y="row")


def _limits(shares: Sequence[Estimate]) -> tuple[float, float]:
    """Ends of the axis of shares: half a decade around all that is drawn."""
    drawn = [value for share in shares if share.n for value in (share.high, share.low) if value > 0]
    return min(drawn) / 5, min(max(drawn) * 3, 1.5)


def _point(entry: records.Entry, column: str, share: Estimate, look: Look) -> Series:
    rate = geometric_interval(rates(entry))
    none = share.value == 0
    place = share.high if none else share.value
    name = " ".join(filter(None, [entry.engine, _variant(entry)]))
    hover = {"million rays per second": [rate.value], column: [f"below {share.high:.2g}" if none else share.value]}
    whiskers = interval([rate]), None if none else interval([share])
    return Series(np.array([rate.value]), np.array([place]), look, name, "", hover, *whiskers, bounds=none)


def _variant(entry: records.Entry) -> str:
    return " ".join(filter(None, [entry.accelerator, entry.precision]))
