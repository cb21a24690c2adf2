"""Prints results and writes verify.json, verify.csv, verify.tex and verify.html."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Printed

from harness.check_results import FAIL, OUTCOMES, PASS, SKIP, XFAIL, CheckResult, counts, counts_text, worst_per_check
from harness.report.tables import Column, Table
from harness.report.tables.model import csv_text, latex_text, number_text
from harness.store.atomic import write_text
from harness.verify.results_file import document
from harness.verify.suite import CASES

if TYPE_CHECKING:
    from harness.report.plots import Picture

COLUMNS = [
    Column("case", "Id of the case."),
    Column("engine", "Engine."),
    Column("precision", "The setting: float64 or float32."),
    Column("tracing", "Precision in which the engine intersects rays with shapes; it sets the tolerance."),
    Column("accelerator", "Accelerator."),
    Column("parameter", "What was varied."),
    Column("error", "The error measured: the largest of `count`, for `wrong` the sum.", "number"),
    Column("unit", "Unit of error and tolerance: relative, absolute, eps, eps/cos, wrong or z."),
    Column("tolerance", "The largest error that passes; empty where the precision has none.", "number"),
    Column("median_error", "The median error, in the same unit.", "number"),
    Column("outcome", "pass, fail, xfail (no tolerance in this precision) or skip (refused by why_not)."),
    Column("median_ulp", "Median error in ulp of the tracing precision.", "number", "median ulp"),
    Column("p999_ulp", "The 99.9 % quantile of the error in ulp.", "number", "99.9 % ulp"),
    Column("worst_ulp", "The largest error in ulp.", "number", "worst ulp"),
    Column("count", "Rays, pixels or samples measured.", "count"),
    Column("seconds", "Time of the measurement, compilation included.", "number"),
    Column("description", "What the case checks."),
    Column("source", "Where the case comes from."),
    Column("note", "Further observations, or the reason of a skip or failure."),
]
NOT_IN_LATEX = ("precision", "median_error", "count", "seconds", "description", "source", "note")
WIDEST, NARROW = 120, 100
COLOURS = {PASS: "green", XFAIL: "yellow", FAIL: "bold red", SKIP: "dim"}


def table(results: Sequence[CheckResult], without: Sequence[str] = ()) -> Table:
    """All results as a table of the harness, `without` columns of these names."""
    chosen = [column for column in COLUMNS if column.name not in without]
    rows = [dict(result) for result in results]
    note = "Errors compared with the tolerances of the precision in which each engine traces."
    return Table("verify", "Accuracy of the engines", note, chosen, rows)


def write(results: Sequence[CheckResult], folder: Path, quick: bool) -> None:
    """Writes verify.json, .csv, .tex (without the long texts) and .html, and plots/ where there is something to plot."""
    from harness.report.plots import stability_plots, write_files
    from harness.report.plots.figures import picture
    from harness.report.plots.style import formats

    folder.mkdir(parents=True, exist_ok=True)
    plots = stability_plots(results)
    write_files(plots, folder / "plots")
    pictures = [picture(plot) for plot in plots] if formats() else []
    texts = {
        "json": json.dumps(document(results, quick), indent=1, allow_nan=False) + "\n",
        "csv": csv_text(table(results)),
        "tex": latex_text(table(results, NOT_IN_LATEX)),
        "html": page(results, quick, pictures),
    }
    for suffix, text in texts.items():
        write_text(folder / f"verify.{suffix}", text)


def show(results: Sequence[CheckResult], console: Console) -> None:
    """Prints a table for each engine and precision: the worst result of each check, and every failure."""
    by_engine: dict[str, list[CheckResult]] = {}
    for result in results:
        traces = "" if result.tracing == result.precision else f" (traces in {result.tracing})"
        by_engine.setdefault(f"{result.engine} {result.precision}{traces}", []).append(result)
    for engine, rows in by_engine.items():
        console.print(_printed(engine, rows, console.width >= NARROW), width=min(console.width, WIDEST))
        console.print()
    for result in results:
        if result.outcome == FAIL and result.note:
            where = f"{result.case} {result.engine} {result.precision} {result.accelerator}"
            console.print(f"{where}: {result.note}", style="red", markup=False, soft_wrap=True)
    console.print(f"{counts_text(counts(results))}.", markup=False)


def _printed(engine: str, results: Sequence[CheckResult], wide: bool) -> Printed:
    """Errors in ulp have a column where the terminal is wide and a case of the engine measures them."""
    printed = Printed(
        title=engine,
        title_justify="left",
        title_style="bold",
        box=None,
        header_style="dim",
        pad_edge=False,
        collapse_padding=True,
        padding=(0, 2, 0, 0),
    )
    with_ulps = wide and any(not math.isnan(result.worst_ulp) for result in results)
    printed.add_column("case", no_wrap=True)
    printed.add_column("description", min_width=24, max_width=58)
    printed.add_column("worst at", min_width=12, max_width=20)
    printed.add_column("error", justify="right", no_wrap=True)
    printed.add_column("tolerance", justify="right", no_wrap=True)
    if with_ulps:
        printed.add_column("ulp: median /\n99.9 % / worst", justify="right", no_wrap=True)
    printed.add_column("outcome", no_wrap=True)
    for result, others, worst_in_ulp in worst_per_check(results):
        accelerator = "" if result.accelerator == "auto" else accelerator_text(result)
        where = ", ".join(filter(None, [accelerator, result.parameter])) if result.error != 0 else ""
        unit = "" if result.unit in ("relative", "absolute") else f" {result.unit}"
        texts = [result.case, result.description, where, f"{number_text(result.error)}{unit}", tolerance_text(result)]
        more = f" [dim]+{others}[/]" if others else ""
        ulps = [_ulps(worst_in_ulp)] if with_ulps else []
        printed.add_row(*map(escape, [*texts, *ulps]), f"[{COLOURS[result.outcome]}]{result.outcome}[/]{more}")
    return printed


def _ulps(result: CheckResult) -> str:
    errors = (result.median_ulp, result.p999_ulp, result.worst_ulp)
    if math.isnan(result.worst_ulp):
        return ""
    return " / ".join("∞" if math.isinf(x) else f"{x:.0f}" if x >= 100 else f"{x:.2g}" for x in errors)


def accelerator_text(result: CheckResult) -> str:
    """The accelerator in tables for people: `none` reads "brute force"."""
    return "brute force" if result.accelerator == "none" else result.accelerator


def tolerance_text(result: CheckResult) -> str:
    return "–" if math.isnan(result.tolerance) else number_text(result.tolerance)


def page(results: Sequence[CheckResult], quick: bool, plots: Sequence[Picture] = ()) -> str:
    """verify.html: one file without scripts, which loads nothing."""
    from harness.report.html.assembly import svg_address

    loader = jinja2.PackageLoader("harness.verify.commands", ".")
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    sections: dict[str, dict[str, list[CheckResult]]] = {}
    for result in results:
        sections.setdefault(result.section, {}).setdefault(result.case, []).append(result)
    engines = sorted({(r.engine, r.version, r.precision, r.tracing) for r in results})
    matrix = {
        (section, *engine): Counter(
            r.outcome for r in results if (r.section, r.engine, r.version, r.precision, r.tracing) == (section, *engine)
        )
        for section in sections
        for engine in engines
    }
    return environment.get_template("verify.html.j2").render(
        sections=sections,
        engines=engines,
        matrix=matrix,
        counts=counts(results),
        quick=quick,
        whys={case.id: case.tolerance.why for case in CASES},
        outcomes=OUTCOMES,
        number=number_text,
        tolerance_text=tolerance_text,
        accelerator_text=accelerator_text,
        isnan=math.isnan,
        plots=plots,
        svg_address=svg_address,
        worst=lambda rows: [row.result for row in worst_per_check(rows)],
        has_ulps=lambda rows: any(not math.isnan(result.worst_ulp) for result in rows),
        failures=[r for r in results if r.outcome == FAIL],
        expected_failures=[row for row in worst_per_check(results) if row.result.outcome == XFAIL],
    )
