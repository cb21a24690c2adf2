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

from harness.tables import Column, Table
from harness.tables.model import csv_text, latex_text, number_text
from harness.verify.battery import BROKEN, DECLINED, KEPT, NOT_PROMISED, Finding
from harness.verify.promises import PROMISES

if TYPE_CHECKING:
    from harness.plots import Plot

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
COLOURS = {KEPT: "green", NOT_PROMISED: "yellow", BROKEN: "bold red", DECLINED: "dim"}


def table(found: Sequence[Finding], names: Sequence[str] = ()) -> Table:
    """All findings as a table of the harness; `names` chooses columns."""
    chosen = [column for column in COLUMNS if not names or column.name in names]
    rows = [dataclasses.asdict(finding) for finding in found]
    note = "Errors found against what an engine promises by the precision in which it traces."
    return Table("verify", "Accuracy of the engines", note, chosen, rows)


def write(found: Sequence[Finding], folder: Path, quick: bool) -> None:
    """verify.json, .csv, .tex (all but the wordy columns) and .html; plots/, where there is something to draw."""
    from harness.plots import draw_stability

    folder.mkdir(parents=True, exist_ok=True)
    plots = draw_stability([dataclasses.asdict(finding) for finding in found], folder / "plots")
    texts = {
        "json": json.dumps(_document(found, quick), indent=1, allow_nan=False) + "\n",
        "csv": csv_text(table(found)),
        "tex": latex_text(table(found, SHORT)),
        "html": page(found, quick, plots),
    }
    for suffix, text in texts.items():
        (folder / f"verify.{suffix}").write_text(text, encoding="utf-8")


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


def show(found: Sequence[Finding], console: Console) -> None:
    """One row a case, engine and tracing precision: the finding nearest to its limit; all that is not kept in full."""
    names = ("case", "asked", "engine", "precision", "accelerator", "parameter", "error", "allowed", "verdict")
    printed = Printed(*names, box=None, header_style="bold")
    for finding, rest in condensed(found):
        texts = [finding.case, finding.asked, finding.engine, finding.precision, *_where(finding, rest),
                 f"{number_text(finding.error)} {finding.unit}", limit_text(finding)]  # fmt: skip
        printed.add_row(*map(escape, texts), f"[{COLOURS[finding.verdict]}]{finding.verdict}[/]")
    console.print(printed)
    for finding in found:
        if finding.verdict == BROKEN and finding.note:
            where = f"{finding.case} {finding.engine} {finding.precision} {finding.accelerator}"
            console.print(f"{where}: {finding.note}", style="red", markup=False)
    console.print(", ".join(f"{number} {verdict}" for verdict, number in sorted(counts(found).items())) + ".")


def _where(finding: Finding, rest: int) -> tuple[str, str]:
    more = f" (+{rest} kept)" if rest else ""
    return finding.accelerator, finding.parameter + more


def condensed(found: Sequence[Finding]) -> list[tuple[Finding, int]]:
    """Of the kept findings of a case, engine and precision the worst, with how many it stands for; others as they are."""
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in found:
        group = groups.setdefault((finding.engine, finding.precision, finding.section, finding.case), [])
        group.append(finding)
    rows: list[tuple[Finding, int]] = []
    for group in groups.values():
        kept = [finding for finding in group if finding.verdict == KEPT]
        if kept:
            rows.append((max(kept, key=_closeness), len(kept) - 1))
        rows += [(finding, 0) for finding in group if finding.verdict != KEPT]
    return rows


def _closeness(finding: Finding) -> float:
    """Error as a share of what is allowed; where nothing is, the error."""
    share = finding.error / finding.allowed if finding.allowed > 0 else finding.error
    return -share if finding.unit == "p" else share


def limit_text(finding: Finding) -> str:
    return "–" if math.isnan(finding.allowed) else number_text(finding.allowed)


def page(found: Sequence[Finding], quick: bool, plots: Sequence[Plot] = ()) -> str:
    """A page of its own, without scripts or anything from elsewhere."""
    from harness.report.assembly import inline_svg

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
        worst=lambda given: [finding for finding, _ in condensed(given)],
        has_ulps=lambda given: any(not math.isnan(finding.worst) for finding in given),
        failures=[f for f in found if f.verdict == BROKEN], lost=[f for f in found if f.verdict == NOT_PROMISED],
    )  # fmt: skip
