"""What is written and printed of a comparison by rays: trace.json, tables, plots, report.html."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Printed

from harness.analysis.columns import Table
from harness.analysis.tracing import trace_table
from harness.report.html.assembly import trace_html
from harness.report.plots import write_files
from harness.report.plots.tracing import plots as plots_of
from harness.report.tables import write_table
from harness.report.tables.model import estimate_text, number_text
from harness.statistics import Estimate
from harness.store.atomic import write_text
from harness.trace.records import FILE, TraceResults, read_trace, text_of


def write(results: TraceResults, folder: Path) -> None:
    """Writes everything."""
    write_text(folder / FILE, text_of(results), durable=True)
    write_derived(folder)


def write_derived(folder: Path) -> Path:
    """Writes tables/, plots/ and report.html anew from trace.json. Returns the report's path."""
    results = read_trace(folder / FILE)
    table = trace_table(results)
    write_table(table, folder / "tables")
    plots = plots_of(results)
    write_files(plots, folder / "plots")
    path = folder / "report.html"
    write_text(path, trace_html(results, table, plots))
    return path


def show(results: TraceResults, console: Console) -> None:
    """Prints a table a scene, set of rays and number of threads, and what was declined or failed."""
    table = trace_table(results)
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in table.rows:
        groups.setdefault(tuple(row[key] for key in ("scene", "primitives", "rays", "threads")), []).append(row)
    for (scene, primitives, kind, threads), rows in groups.items():
        done = [row for row in rows if row["state"] == "done" and row.get("blocks")]
        if done:
            what = f"{scene}, {primitives} primitives: {kind} rays, {threads} thread{'s' if threads > 1 else ''}"
            console.print(_printed(f"{what}; {done[0]['checked']} rays checked, {done[0]['hard']} hard rays", done))
            console.print()
    said: dict[str, None] = {}
    for row in table.rows:
        if row["state"] != "done":
            who = " ".join(filter(None, [row["engine"], row["accelerator"], row["precision"]]))
            said[f"{row['scene']}: {who}: {row['state']}: {row['message']}"] = None
        elif row["unstable"]:
            said[f"{row['scene']} {row['rays']}: {row['engine']}: its answers differ between blocks"] = None
    for line in said:
        console.print(line, style="yellow", markup=False, soft_wrap=True)
    console.print(_contention(table), markup=False, soft_wrap=True)


def _contention(table: Table) -> str:
    blocks, contended = (sum(row.get(key) or 0 for row in table.rows) for key in ("blocks", "contended"))
    busy = " Times of a busy machine: read the ratios, which are paired by blocks." if contended > blocks / 4 else ""
    return f"{contended} of {blocks} measurements were disturbed by other work.{busy}"


def _printed(title: str, rows: list[Mapping[str, Any]]) -> Printed:
    printed = Printed(
        title=escape(title),
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        header_style="dim",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    hits = any(row["rays"] != "shadow" for row in rows)
    printed.add_column("engine")
    for heading in (
        "Mrays/s",
        "Mrays/\ncpu s",
        "over baseline",
        "",
        *(["wrong\nhits"] if hits else []),
        "missed",
        "false\nhits",
        "wrong answers",
        "leaks",
        *(["t error\n99.9 %"] if hits else []),
        "build\n[s]",
    ):
        printed.add_column(heading, justify="left" if heading == "" else "right", no_wrap=True)
    for row in rows:
        names = [row["engine"], "" if row["accelerator"] == "auto" else row["accelerator"], row["precision"]]
        cells = [
            " ".join(filter(None, names)),
            estimate_text(row["mrays_per_second"]),
            number_text(row["mrays_per_cpu_second"].value),
            estimate_text(row["ratio"]) if row.get("ratio") else "",
            row["verdict"],
        ]
        cells += [str(row[key]) for key in (*(["wrong"] if hits else []), "missed", "false_hits")]
        cells += [share_text(row["error_rate"]), share_text(row["leak_rate"])]
        cells += [number_text(row.get("t_p999", math.nan))] if hits else []
        printed.add_row(*map(escape, [*cells, number_text(row["build_seconds"])]))
    return printed


def share_text(share: Estimate) -> str:
    """A count with the interval of its share in percent; of none, the bound below which the share lies."""
    if not share.n:
        return "–"
    count = round(share.value * share.n)
    if count == 0:
        return f"0 (below {_percent(share.high)} %)"
    return f"{count} ({_percent(share.low)} to {_percent(share.high)} %)"


def _percent(share: float) -> str:
    return f"{100 * share:.2g}"
