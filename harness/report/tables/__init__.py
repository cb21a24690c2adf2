"""Tables of results: verdicts for people (csv, md, tex) and tidy data for programs. Every column is documented."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from harness.analysis import Analysis, frames
from harness.analysis.columns import Column, Table
from harness.analysis.measurements import CONTESTANT
from harness.report.tables.changes import changes
from harness.report.tables.history import history, regressions
from harness.report.tables.model import cell_text, csv_text, latex_text, markdown_text, sort_value
from harness.report.tables.verdicts import all_tables
from harness.store.atomic import write_text
from harness.store.confined import inside

TEXTS = {"csv": csv_text, "md": markdown_text, "tex": latex_text}


def columns(tables: list[Table]) -> dict[str, str]:
    """`table.column` -> meaning, for every column."""
    return {f"{table.name}.{column.name}": column.meaning for table in tables for column in table.columns}


def tidy_tables(analysis: Analysis) -> list[Table]:
    """points, ttq and phases: the frames as csv files hold them, without the name of the contestant."""
    found = [analysis.points, frames.times_to_quality(analysis), analysis.cells]
    return [replace(table, columns=[c for c in table.columns if c is not CONTESTANT]) for table in found]


def write_tables(analysis: Analysis, folder: Path) -> list[Table]:
    """Writes points.csv, ttq.csv, phases.csv and tables/*; returns the tables for people."""
    tidy, tables = tidy_tables(analysis), all_tables(analysis)
    target = inside(folder, "tables", str(folder))
    for table in tidy:
        write_text(folder / f"{table.name}.csv", csv_text(table))
    for table in tables:
        write_table(table, target)
    write_text(target / "columns.md", _columns_text(tidy, tables))
    return tables


def write_table(table: Table, folder: Path) -> None:
    """Writes a table for people in each format of `TEXTS`."""
    for suffix, text in TEXTS.items():
        write_text(folder / f"{table.name}.{suffix}", text(table))


def _columns_text(tidy: list[Table], tables: list[Table]) -> str:
    """What every column means, file by file."""
    lines = ["# Columns", "", "An estimate has three columns in csv: `name`, `name_low`, `name_high`."]
    for path, table in [*((f"{t.name}.csv", t) for t in tidy), *((f"tables/{t.name}", t) for t in tables)]:
        lines += ["", f"## {path}", "", *(f"- `{column.name}`: {column.meaning}" for column in table.columns)]
    return "\n".join(lines) + "\n"
