"""What a run of the battery writes: a table on the terminal, and verify.json, verify.csv, verify.tex and verify.html."""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Printed

from harness.report.tables import Column, Table
from harness.report.tables.model import csv_text, latex_text, number_text
from harness.store.atomic import write_text
from harness.verify.battery import BROKEN, DECLINED, KEPT, NOT_PROMISED, Finding
from harness.verify.promises import PROMISES
from harness.verify.worst import condensed

if TYPE_CHECKING:
    from harness.report.plots import Plot

COLUMNS = [
    Column("case", "Id of the case."),
    Column("engine", "Engine."),
    Column("precision", "The setting: float64 or float32."),
    Column("tracing", "Precision in which rays meet shapes, which sets what is allowed."),
    Column("accelerator", "Accelerator."),
    Column("parameter", "What was varied."),
    Column("error", "Error found, the worst of `count`.", "number"),
    Column("unit", "Unit of error and allowed: relative, absolute, eps, eps/cos, wrong, share, z or p."),
    Column("allowed", "What the engine promises; empty where it promises nothing.", "number"),
    Column("typical", "The median error, in the same unit.", "number"),
    Column("verdict", "kept, not promised, broken, or declined by why_not."),
    Column("median", "Median error in ulp of the tracing precision.", "number", "median ulp"),
    Column("tail", "The 99.9 % quantile of it.", "number", "99.9 % ulp"),
    Column("worst", "The worst of it.", "number", "worst ulp"),
    Column("count", "Rays, pixels or samples.", "count"),
    Column("seconds", "What it took, compilation included.", "number"),
    Column("asked", "What is asked."),
    Column("source", "Where the case comes from."),
    Column("note", "What else was seen."),
]
SHORT = ("case", "engine", "tracing", "accelerator", "parameter", "error", "unit", "allowed", "verdict", "median",
         "tail", "worst")  # fmt: skip
WIDEST, NARROW = 120, 100
COLOURS = {KEPT: "green", NOT_PROMISED: "yellow", BROKEN: "bold red", DECLINED: "dim"}


def table(found: Sequence[Finding], names: Sequence[str] = ()) -> Table:
    """All findings as a table of the harness; `names` chooses columns."""
    chosen = [column for column in COLUMNS if not names or column.name in names]
    rows = [dataclasses.asdict(finding) for finding in found]
    note = "Errors found against what an engine promises by the precision in which it traces."
    return Table("verify", "Accuracy of the engines", note, chosen, rows)


def write(found: Sequence[Finding], folder: Path, quick: bool) -> None:
    """verify.json, .csv, .tex (all but the wordy columns) and .html; plots/, where there is something to draw."""
    from harness.report.plots import draw_stability

    folder.mkdir(parents=True, exist_ok=True)
    plots = draw_stability([dataclasses.asdict(finding) for finding in found], folder / "plots")
    texts = {
        "json": json.dumps(_document(found, quick), indent=1, allow_nan=False) + "\n",
        "csv": csv_text(table(found)),
        "tex": latex_text(table(found, SHORT)),
        "html": page(found, quick, plots),
    }
    for suffix, text in texts.items():
        write_text(folder / f"verify.{suffix}", text)


def _document(found: Sequence[Finding], quick: bool) -> dict[str, Any]:
    """Plain data; numbers that JSON lacks are null (NaN) or the text "inf"."""

    def plain(value: Any) -> Any:
        if isinstance(value, float) and not math.isfinite(value):
            return None if math.isnan(value) else "inf" if value > 0 else "-inf"
        return value

    rows = [{key: plain(value) for key, value in dataclasses.asdict(finding).items()} for finding in found]
    return {"raybench_verify": 1, "quick": quick, "verdicts": dict(counts(found)), "findings": rows}


def counts(found: Sequence[Finding]) -> Counter[str]:
    return Counter(finding.verdict for finding in found)


def counts_text(counted: Counter[str]) -> str:
    return ", ".join(f"{counted[verdict]} {verdict}" for verdict in COLOURS if counted[verdict]) or "nothing to measure"


def show(found: Sequence[Finding], console: Console) -> None:
    """A table an engine and precision: of each case the finding nearest to its limit, and whatever is broken in full."""
    by_engine: dict[str, list[Finding]] = {}
    for finding in found:
        traces = "" if finding.tracing == finding.precision else f" (traces in {finding.tracing})"
        by_engine.setdefault(f"{finding.engine} {finding.precision}{traces}", []).append(finding)
    for engine, findings in by_engine.items():
        console.print(_printed(engine, findings, console.width >= NARROW), width=min(console.width, WIDEST))
        console.print()
    for finding in found:
        if finding.verdict == BROKEN and finding.note:
            where = f"{finding.case} {finding.engine} {finding.precision} {finding.accelerator}"
            console.print(f"{where}: {finding.note}", style="red", markup=False, soft_wrap=True)
    console.print(f"{counts_text(counts(found))}.", markup=False)


def _printed(engine: str, found: Sequence[Finding], room: bool) -> Printed:
    """Distributions in ulp have a column where there is room and any case of the engine has one."""
    printed = Printed(title=engine, title_justify="left", title_style="bold", box=None, header_style="dim",
                      pad_edge=False, collapse_padding=True, padding=(0, 2, 0, 0))  # fmt: skip
    with_ulps = room and any(not math.isnan(finding.worst) for finding in found)
    printed.add_column("case", no_wrap=True)
    printed.add_column("what is asked", min_width=24, max_width=58)
    printed.add_column("worst at", min_width=12, max_width=20)
    printed.add_column("error", justify="right", no_wrap=True)
    printed.add_column("allowed", justify="right", no_wrap=True)
    if with_ulps:
        printed.add_column("ulp: median /\n99.9 % / worst", justify="right", no_wrap=True)
    printed.add_column("verdict", no_wrap=True)
    for finding, rest, spread in condensed(found):
        accelerator = "" if finding.accelerator == "auto" else finding.accelerator
        where = ", ".join(filter(None, [accelerator, finding.parameter])) if finding.error != 0 else ""
        unit = "" if finding.unit in ("relative", "absolute") else f" {finding.unit}"
        texts = [finding.case, finding.asked, where, f"{number_text(finding.error)}{unit}", limit_text(finding)]
        more = f" [dim]+{rest}[/]" if rest else ""
        ulps = [_ulps(spread)] if with_ulps else []
        printed.add_row(*map(escape, [*texts, *ulps]), f"[{COLOURS[finding.verdict]}]{finding.verdict}[/]{more}")
    return printed


def _ulps(finding: Finding) -> str:
    shares = (finding.median, finding.tail, finding.worst)
    if math.isnan(finding.worst):
        return ""
    return " / ".join("∞" if math.isinf(x) else f"{x:.0f}" if x >= 100 else f"{x:.2g}" for x in shares)


def limit_text(finding: Finding) -> str:
    return "–" if math.isnan(finding.allowed) else number_text(finding.allowed)


def page(found: Sequence[Finding], quick: bool, plots: Sequence[Plot] = ()) -> str:
    """A page of its own, without scripts or anything from elsewhere."""
    from harness.report.html.assembly import inline_svg

    loader = jinja2.PackageLoader("harness.verify", ".")
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    sections: dict[str, dict[str, list[Finding]]] = {}
    for finding in found:
        sections.setdefault(finding.section, {}).setdefault(finding.case, []).append(finding)
    engines = sorted({(f.engine, f.version, f.precision, f.tracing) for f in found})
    matrix = {
        (section, *engine): Counter(f.verdict for f in found if (f.section, f.engine, f.version, f.precision, f.tracing)
                                    == (section, *engine))
        for section in sections for engine in engines
    }  # fmt: skip
    return environment.get_template("verify.html.j2").render(
        sections=sections, engines=engines, matrix=matrix, counts=counts(found), quick=quick, promises=PROMISES,
        number=number_text, limit=limit_text, isnan=math.isnan,
        plots=[(plot, inline_svg(plot, index)) for index, plot in enumerate(plots)],
        worst=lambda given: [row.finding for row in condensed(given)],
        has_ulps=lambda given: any(not math.isnan(finding.worst) for finding in given),
        failures=[f for f in found if f.verdict == BROKEN],
        lost=[row for row in condensed(found) if row.finding.verdict == NOT_PROMISED],
    )  # fmt: skip
