"""Numerical stability: error of t over distance, scene offset and radius; self-hits and leaks over scale.

Drawn from check results of the suite's section `stability` (as events and verify.json hold them).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from harness.check_results import CheckResult
from harness.report.plots import chart
from harness.report.plots.chart import FAINT, INK, Axis, Chart, Entry, Guide, Look, Plot, Subplot
from harness.report.plots.style import engine_colours

DISTANCES = {"t/distance": "distance", "t/offset": "offset of the scene", "t/radius": "radius of the sphere"}
RATES = {"self/scale": "scale of the scene: self-hits", "leak/scale": "scale of the scene: light through a gap"}
LINES: dict[str, Any] = {"sphere": "-", "triangle": "--", "mesh": "--", "gap 1e-03": "-", "gap 1e-05": "--", "gap 1e-07": ":"}
EPSILONS = {"float64": 2.0**-52, "float32": 2.0**-23}
ERRORS = Axis("relative error of t", low=1e-17, high=10.0, ticks={x: f"{x:g}" for x in (1e-16, 1e-12, 1e-8, 1e-4, 1.0)})
LINEAR = 1e-3
"""Shares are drawn by arcsinh(share / LINEAR): in proportion below it, logarithmic above."""
LOWEST = 2e-18
"""Where an error of exactly zero is drawn."""


class Series(NamedTuple):
    """A curve: who, of what, and the findings by rising number."""

    engine: str
    precision: str
    kind: str
    x: np.ndarray
    findings: list[CheckResult]


def plots(findings: Sequence[CheckResult]) -> list[Plot]:
    """The two figures, as far as there are findings for them."""
    errors = _chart(findings, DISTANCES, ERRORS, _error_curves, [Guide(eps, colour=FAINT) for eps in EPSILONS.values()])
    shares = {0.0: "none", 1e-3: "0.001", 1e-2: "0.01", 1e-1: "0.1", 1.0: "all"}
    ticks = {_place(share): text for share, text in shares.items()}
    y = Axis("share of samples", "linear", _place(-3e-4), _place(2.0), ticks)
    described = [
        (
            "stability-of-t",
            "Numerical stability: error of t",
            "For each engine and precision the relative error of t: lines are medians, areas end at the worst hit; "
            "crosses at the top mark where rays missed what they should hit. Horizontal lines: the "
            "machine epsilons of float64 and float32.",
            errors,
        ),
        (
            "self-hits-and-leaks",
            "Numerical stability: self-hits and leaks",
            "Share of samples that hit the surface they had left, and that saw light where there is none, over the "
            "scale of the scene.",
            _chart(findings, RATES, y, _share_curves),
        ),
    ]
    return [Plot(name, title, text, drawn) for name, title, text, drawn in described if drawn is not None]


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


def _place(share: float) -> float:
    return math.asinh(share / LINEAR)


def _chart(
    findings: Sequence[CheckResult],
    cases: Mapping[str, str],
    y: Axis,
    curves_of: Callable[[Series, Look], list[chart.Series]],
    guides: Sequence[Guide] = (),
) -> Chart | None:
    """A row an engine, a column a case."""
    curves = {case: series(findings, case) for case in cases}
    curves = {case: found for case, found in curves.items() if found}
    if not curves:
        return None
    everyone = [curve for found in curves.values() for curve in found]
    engines = list(dict.fromkeys(curve.engine for curve in everyone))
    colours = engine_colours(engines)
    subplots = []
    for engine in engines:
        for column, (case, found) in enumerate(curves.items()):
            own = [s for curve in found if curve.engine == engine for s in curves_of(curve, _look(curve, colours[engine]))]
            title = "" if column else engine
            subplots.append(Subplot(Axis(cases[case]), y, own, title, colours[engine], guides))
    size = max(3.0 * len(curves), 7.2), 1.1 + 1.75 * len(engines)
    return Chart(subplots, *size, len(curves), "below", more=_entries(everyone), shared_x="col")


def _look(curve: Series, colour: str) -> Look:
    """Colour: engine. Line: what was hit. Hollow marker: float32, wider, so that it is seen behind the other."""
    single = curve.precision == "float32"
    return Look(colour, LINES.get(curve.kind, "-."), "o", not single, size=6 if single else 3)


def _error_curves(curve: Series, look: Look) -> list[chart.Series]:
    medians, worst = (np.array([getattr(f, key) for f in curve.findings]) for key in ("median_error", "error"))
    name = f"{curve.engine} {curve.precision}, {curve.kind}"
    seen, missed = np.isfinite(medians), ~np.isfinite(worst)
    ends = np.column_stack([medians[seen].clip(LOWEST), np.where(missed, math.nan, worst)[seen].clip(LOWEST)])
    hover = {"at": curve.x[seen], "median error": medians[seen], "worst error": worst[seen]}
    line = chart.Series(curve.x[seen], medians[seen].clip(LOWEST), look, name, hover=hover, y_interval=ends, area=True)
    crosses = Look(look.colour, "none", "x", size=5)
    misses = {"at": curve.x[missed], "rays": ["some miss"] * int(missed.sum())}
    return [line, chart.Series(curve.x[missed], np.ones(missed.sum()), crosses, name, hover=misses)]


def _share_curves(curve: Series, look: Look) -> list[chart.Series]:
    shares = np.array([f.error / f.count if f.count else math.nan for f in curve.findings])
    name = f"{curve.engine} {curve.precision}, {curve.kind}"
    hover = {"scale": curve.x, "share": shares, "samples": [f.count for f in curve.findings]}
    return [chart.Series(curve.x, np.arcsinh(shares / LINEAR), look, name, hover=hover)]


def _entries(curves: Sequence[Series]) -> list[Entry]:
    """What lines and markers mean, among those that are there."""
    entries = [Entry(kind, Look(INK, LINES.get(kind, "-."))) for kind in dict.fromkeys(curve.kind for curve in curves)]
    precisions = sorted({curve.precision for curve in curves}, reverse=True)
    if len(precisions) > 1:
        entries += [Entry(name, Look(INK, "none", "o", name != "float32")) for name in precisions]
    if any(math.isinf(finding.error) for curve in curves for finding in curve.findings):
        entries.append(Entry("some rays miss", Look(INK, "none", "x")))
    return entries
