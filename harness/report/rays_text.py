"""The table of contestants that trace rays as lines of text, which `raybench run` and `raybench trace` end with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from io import StringIO
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Printed

from harness.analysis.columns import Column, Table
from harness.analysis.rays import ray_races
from harness.report.tables.evidence import contended_text, spreads_text
from harness.report.tables.model import cell_text
from harness.report.tables.rays import rays
from harness.statistics import Estimate
from harness.store.results import Results

Row = Mapping[str, Any]
WIDEST = 1000
"""Columns of a table: none is wrapped."""
SHARES = ("error_rate", "leak_rate")
OF_RATES = ("mrays_per_second", "mrays_per_cpu_second", "ratio", "verdict")
SHOWN = (*OF_RATES, "wrong", "missed", "false_hits", *SHARES, "t_p999", "build_seconds")


def rays_text(results: Results) -> str:
    """A table a scene, set of rays and number of threads, what was declined or failed, how busy the machine was, and its
    persistent spread; empty without cells that trace rays."""
    table = rays(results)
    contended = [cell.machine.contended for cell in results.ray_cells if cell.state == "done" and cell.passes]
    compared = {one.settings.machine: one.spread for race in ray_races(results) for one in race if one.ratio is not None}
    lines = filter(None, [*_lines(table, contended), spreads_text(compared)])
    return "".join(f"{line}\n" for line in lines) if table.rows else ""


def _lines(table: Table, contended: Sequence[bool | None]) -> Iterator[str]:
    races: dict[tuple[Any, ...], list[Row]] = {}
    for row in table.rows:
        races.setdefault(tuple(row[key] for key in ("scene", "primitives", "rays", "threads", "machine")), []).append(row)
    for (scene, primitives, kind, threads, machine), rows in races.items():
        done = [row for row in rows if row["state"] == "done" and row.get("blocks")]
        if done:
            of = f"{scene}, {primitives} primitives: {kind} rays, {threads} thread{'s' if threads > 1 else ''}"
            on = f", machine {machine}" if machine else ""
            checked = [f"{row['checked']} rays checked, {row['hard']} hard rays" for row in done if "checked" in row]
            yield f"{of}{on}; {checked[0] if checked else 'no answers checked'}"
            yield from _printed(done, table.columns)
    said: dict[str, None] = {}
    for row in table.rows:
        if row["state"] != "done":
            said[f"{row['scene']} {row['rays']}: {_name(row)}: {row['state']}: {row['message']}"] = None
        elif row["unstable"]:
            said[f"{row['scene']} {row['rays']}: {_name(row)}: its answers differ between blocks"] = None
    yield from said
    busy = sum(map(bool, contended)) > len(contended) / 4
    yield contended_text(contended) + (" Times of a busy machine: read the ratios, which are paired by blocks." if busy else "")


def _printed(rows: Sequence[Row], columns: Sequence[Column]) -> list[str]:
    """Lines of those columns of `SHOWN` of which something is known in some row."""
    printed = Printed(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    printed.add_column("engine")
    known = [each for each in columns if each.name in SHOWN and any(_text(each, row) != "–" for row in rows)]
    for column in known:
        printed.add_column(escape(column.heading), justify="left" if column.kind == "text" else "right", no_wrap=True)
    for row in rows:
        printed.add_row(*map(escape, [_name(row), *(_text(column, row) for column in known)]))
    file = StringIO()
    Console(file=file, width=WIDEST).print(printed)
    return [line.rstrip() for line in file.getvalue().splitlines()]


def _name(row: Row) -> str:
    accelerator = "" if row["accelerator"] == "auto" else row["accelerator"]
    return " ".join(filter(None, [row["engine"], accelerator, row["precision"]]))


def _text(column: Column, row: Row) -> str:
    value = row.get(column.name)
    return share_text(value) if column.name in SHARES and value else cell_text(column, value)


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
