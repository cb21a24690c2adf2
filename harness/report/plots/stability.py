"""Numerical stability: error of t over distance, scene offset and radius; self-hits and leaks over scale.

Drawn from check results of the suite's section `stability` (as events and verify.json hold them).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from harness.check_results import CheckResult
from harness.report.plots.style import FAINT, INK, Sketch, engine_colours, log_scales, new_figure

DISTANCES = {"t/distance": "distance", "t/offset": "offset of the scene", "t/radius": "radius of the sphere"}
RATES = {"self/scale": "scale of the scene: self-hits", "leak/scale": "scale of the scene: light through a gap"}
LINES: dict[str, Any] = {"sphere": "-", "triangle": "--", "mesh": "--", "gap 1e-03": "-", "gap 1e-05": "--", "gap 1e-07": ":"}
EPSILONS = {"float64": 2.0**-52, "float32": 2.0**-23}
LOWEST = 2e-18
"""Where an error of exactly zero is drawn."""


class Series(NamedTuple):
    """A curve: who, of what, and the findings by rising number."""

    engine: str
    precision: str
    kind: str
    x: np.ndarray
    findings: list[CheckResult]


def sketches(findings: Sequence[CheckResult]) -> list[Sketch]:
    """The two figures, as far as there are findings for them."""
    return [
        Sketch(
            "stability-of-t",
            "Numerical stability: error of t",
            "For each engine and precision the relative error of t: lines are medians, areas end at the worst hit; "
            "crosses at the top mark where rays missed what they should hit. Horizontal lines: the "
            "machine epsilons of float64 and float32.",
            partial(_figure, findings, DISTANCES, _error_axis),
        ),
        Sketch(
            "self-hits-and-leaks",
            "Numerical stability: self-hits and leaks",
            "Share of samples that hit the surface they had left, and that saw light where there is none, over the "
            "scale of the scene.",
            partial(_figure, findings, RATES, _rate_axis),
        ),
    ]


def series(findings: Sequence[CheckResult], case: str) -> list[Series]:
    """The curves of a case: one an engine, precision and kind of shape."""
    groups: dict[tuple[str, str, str], list[tuple[float, CheckResult]]] = {}
    for finding in findings:
        if finding.case == case and finding.outcome != "skip" and "," in finding.parameter:
            kind, _, rest = finding.parameter.partition(", ")
            key = (finding.engine, finding.precision, kind)
            groups.setdefault(key, []).append((float(rest.split()[-1]), finding))
    found = []
    for key, points in sorted(groups.items()):
        points.sort(key=lambda point: point[0])
        found.append(Series(*key, np.array([x for x, _ in points]), [finding for _, finding in points]))
    return found


def _figure(
    findings: Sequence[CheckResult], cases: Mapping[str, str], draw: Callable[[Axes, Series, str], None]
) -> Figure | None:
    """A row an engine, a column a case."""
    curves = {case: series(findings, case) for case in cases}
    curves = {case: found for case, found in curves.items() if found}
    if not curves:
        return None
    everyone = [curve for found in curves.values() for curve in found]
    engines = list(dict.fromkeys(curve.engine for curve in everyone))
    colours = engine_colours(engines)
    figure = new_figure(max(3.0 * len(curves), 7.2), 1.1 + 1.75 * len(engines))
    axes = figure.subplots(len(engines), len(curves), sharey=True, sharex="col", squeeze=False)
    for row, engine in zip(axes, engines, strict=True):
        for axis, found in zip(row, curves.values(), strict=True):
            for curve in found:
                if curve.engine == engine:
                    draw(axis, curve, colours[engine])
            log_scales(axis)
        row[0].set_title(engine, fontsize=9, color=colours[engine], fontweight="bold")
    for axis, case in zip(axes[-1], curves, strict=True):
        axis.set_xlabel(cases[case])
    finish = _finish_errors if set(curves) <= set(DISTANCES) else _finish_rates
    for axis in axes.ravel():
        finish(axis)
    figure.supylabel("relative error of t" if finish is _finish_errors else "share of samples", fontsize=9, color=INK)
    figure.legend(handles=_legend(everyone), loc="outside lower center", ncols=4)
    return figure


def _style(curve: Series, colour: str) -> dict[str, Any]:
    """Colour: engine. Line: what was hit. Hollow marker: float32, wider, so that it is seen behind the other."""
    single = curve.precision == "float32"
    return {
        "color": colour,
        "linestyle": LINES.get(curve.kind, "-."),
        "marker": "o",
        "markersize": 6 if single else 3,
        "markerfacecolor": "white" if single else colour,
    }


def _error_axis(axis: Axes, curve: Series, colour: str) -> None:
    medians, worst = (np.array([getattr(f, key) for f in curve.findings]) for key in ("median_error", "error"))
    seen = np.isfinite(medians)
    axis.plot(curve.x[seen], medians[seen].clip(LOWEST), **_style(curve, colour))
    both = seen & np.isfinite(worst)
    axis.fill_between(curve.x[both], medians[both].clip(LOWEST), worst[both].clip(LOWEST), color=colour, alpha=0.1, linewidth=0)
    missed = curve.x[~np.isfinite(worst)]
    axis.plot(missed, np.ones(len(missed)), "x", color=colour, markersize=5)


def _finish_errors(axis: Axes) -> None:
    log_scales(axis, x=False, y=True)
    axis.set_ylim(1e-17, 10.0)
    axis.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1.0])
    axis.yaxis.set_minor_locator(FixedLocator([]))
    for eps in EPSILONS.values():
        axis.axhline(eps, color=FAINT, linewidth=0.8, linestyle=(0, (2, 2)), zorder=0.5)


def _rate_axis(axis: Axes, curve: Series, colour: str) -> None:
    shares = np.array([f.error / f.count if f.count else math.nan for f in curve.findings])
    axis.plot(curve.x, shares, **_style(curve, colour))


def _finish_rates(axis: Axes) -> None:
    axis.set_yscale("symlog", linthresh=1e-3)
    axis.set_ylim(-3e-4, 2.0)
    axis.set_yticks([0, 1e-3, 1e-2, 1e-1, 1], ["none", "0.001", "0.01", "0.1", "all"])
    axis.yaxis.set_minor_locator(FixedLocator([]))


def _legend(curves: Sequence[Series]) -> list[Line2D]:
    """What lines and markers mean, among those that are there."""
    entries = [
        Line2D([], [], color=INK, linestyle=LINES.get(kind, "-."), label=kind)
        for kind in dict.fromkeys(curve.kind for curve in curves)
    ]
    precisions = sorted({curve.precision for curve in curves}, reverse=True)
    if len(precisions) > 1:
        entries += [
            Line2D(
                [],
                [],
                color=INK,
                linestyle="none",
                marker="o",
                label=name,
                markerfacecolor="white" if name == "float32" else INK,
            )
            for name in precisions
        ]
    if any(math.isinf(finding.error) for curve in curves for finding in curve.findings):
        entries.append(Line2D([], [], color=INK, linestyle="none", marker="x", label="some rays miss"))
    return entries
