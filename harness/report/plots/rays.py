"""Rays per second against wrong answers, and against leaks: a figure a scene and number of threads, a column a kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.analysis.rays import RayContestant, ray_races
from harness.report.plots.chart import FAINT, INK, MARKERS, Axis, Chart, Entry, Look, Plot, Series, Subplot, interval
from harness.report.plots.style import engine_colours, file_stem
from harness.statistics import Estimate, geometric_interval
from harness.store.results import Results

RAYS = "rays-against-errors"
"""How the names of these plots start."""
ROWS: dict[str, Callable[[RayContestant], Estimate]] = {
    "share of wrong answers": lambda one: one.error_rate,
    "share of leaks": lambda one: one.leak_rate,
}


def plots(results: Results) -> list[Plot]:
    """A figure for each scene, number of threads and machine that has results."""
    races = ray_races(results)
    shown = [one for group in races for one in group if one.answers and not one.settings.label]
    engines = list(dict.fromkeys(one.settings.engine for group in races for one in group))
    figures: dict[tuple[str, int, str], list[RayContestant]] = {}
    for one in shown:
        figures.setdefault((one.settings.scene, one.settings.threads, one.settings.machine), []).append(one)
    several = len({machine for _, _, machine in figures}) > 1
    found = []
    for (scene, threads, machine), own in figures.items():
        of = [scene, f"{threads} thread{'s' if threads > 1 else ''}", *([f"machine {machine}"] if several else [])]
        found.append(
            Plot(
                file_stem(RAYS, scene, f"{threads}t", machine if several else ""),
                ", ".join(of),
                "Points by million rays per second of wall time and the share of wrong answers, and of leaks, logarithmic, "
                "with 95 % intervals. Hollow: no error was found; the point is the bound below which the share lies. Lower "
                "right is better.",
                _chart(own, engines),
            )
        )
    return found


def _chart(contestants: Sequence[RayContestant], engines: Sequence[str]) -> Chart:
    kinds = list(dict.fromkeys(one.settings.rays for one in contestants))
    rows = {name: share for name, share in ROWS.items() if any(share(one).n for one in contestants)}
    variants = list(dict.fromkeys(one.variant for one in contestants))
    colours = engine_colours(engines)

    def point(one: RayContestant, name: str, share: Estimate) -> Series:
        look = Look(colours[one.settings.engine], "none", MARKERS[variants.index(one.variant) % len(MARKERS)])
        return _point(one, name, share, look._replace(filled=share.value != 0, size=6))

    subplots = []
    for name, share in rows.items():
        low, high = _limits([share(one) for one in contestants])
        for kind in kinds:
            own = [point(one, name, share(one)) for one in contestants if one.settings.rays == kind and share(one).n]
            subplots.append(Subplot(Axis("million rays per second"), Axis(name, low=low, high=high), own, kind))
    size = max(7.2, 3.2 * len(kinds)), 0.9 + 2.3 * max(1, len(rows))
    more = [Entry(name, Look(colours[name], "none", "o")) for name in dict.fromkeys(one.settings.engine for one in contestants)]
    if len(variants) > 1:
        more += [Entry(name, Look(INK, "none", MARKERS[i % len(MARKERS)])) for i, name in enumerate(variants)]
    more.append(Entry("none found: bound", Look(FAINT, "none", "o", False)))
    return Chart(subplots, *size, len(kinds), "below", more=more, shared_x="col", shared_y="row")


def _limits(shares: Sequence[Estimate]) -> tuple[float, float]:
    """Ends of the axis of shares: half a decade around all that is drawn."""
    drawn = [value for share in shares if share.n for value in (share.high, share.low) if value > 0]
    return min(drawn) / 5, min(max(drawn) * 3, 1.5)


def _point(one: RayContestant, column: str, share: Estimate, look: Look) -> Series:
    rate = geometric_interval(one.rates())
    none = share.value == 0
    place = share.high if none else share.value
    name = " ".join(filter(None, [one.settings.engine, one.variant]))
    hover = {"million rays per second": [rate.value], column: [f"below {share.high:.2g}" if none else share.value]}
    whiskers = interval([rate]), None if none else interval([share])
    return Series(np.array([rate.value]), np.array([place]), look, name, "", hover, *whiskers, bounds=none)
