"""What the commands about results folders do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from engines.errors import ConfigError
from harness import store
from harness.cli.outputs import check_file
from harness.console import consoles
from harness.processes import allow_here
from harness.store import atomic

if TYPE_CHECKING:
    from harness.analysis import Analysis, columns
    from harness.report.plugins import Plugin

NO_CHANGE = ("identical", "equivalent", "unresolved")
"""Verdicts on images that `compare` leaves out unless it is asked for everything; ratios it shows all."""


def require_results(folder: Path) -> None:
    if store.events_file(folder) is None:
        raise ConfigError(f"{folder}: no {store.EVENTS} is there: a folder written by `raybench run` is expected")


def require_folders(folders: Sequence[Path], where: str) -> None:
    """Refuses no folders, and folders without results."""
    if not folders:
        raise ConfigError(f"{where}: a results folder is missing")
    for folder in folders:
        require_results(folder)


def print_rows(found: columns.Table, rows: Sequence[Mapping[str, Any]]) -> None:
    """Prints rows of a table without its last column, which is for files."""
    from harness.report.tables import cell_text

    shown = found.columns[:-1]
    printed = Table(*(column.heading for column in shown), box=None, header_style="bold")
    for row in rows:
        printed.add_row(*(escape(cell_text(column, row.get(column.name))) for column in shown))
    if rows:
        consoles()[0].print(printed)


def analysed(folder: Path) -> Analysis:
    """What a results folder says."""
    from harness.analysis import analyse
    from harness.store.results import load_results

    return analyse(load_results(folder))


def write_derived(folder: Path, plugins: Sequence[Plugin] = (), analysis: Analysis | None = None) -> None:
    """Writes tables, plots and report of a results folder, from its analysis where that is known."""
    from harness.report import write_derived as write

    write(folder, plugins, analysis)


def _plugins(own: Sequence[tuple[str, str]], allow_imports: bool) -> list[Plugin]:
    from harness.report.plugins import plugin
    from harness.settings import require_imports

    for _, name in own:
        require_imports(name, allow_imports)
    allow_here(allow_imports)
    return [plugin(kind, name) for kind, name in own]


def report(folders: Sequence[Path], own: Sequence[tuple[str, str]] = (), allow_imports: bool = False) -> None:
    """Writes everything derived from results folders anew, with plots and tables of the user's `own`: (kind, name)."""
    require_folders(folders, "report")
    plugins = _plugins(own, allow_imports)
    for folder in folders:
        write_derived(folder, plugins)
        consoles()[0].print(f"Report: {folder / 'report.html'}", soft_wrap=True)


def chapter(folders: Sequence[Path], target: Path) -> None:
    """Writes the chapter about results folders, in order."""
    from harness.report.chapter import write_chapter

    require_folders(folders, f"--chapter {target}")
    if target.exists() and not target.is_dir():
        raise ConfigError(f"--chapter {target}: is a file; a folder is expected")
    for written in write_chapter(folders, target):
        consoles()[0].print(str(written), soft_wrap=True)


def rescore(folder: Path, overrides: Sequence[str], command: Sequence[str]) -> None:
    """Measures every stored image again, against the reference and quality of its results, or another quality."""
    from harness.run.rescore import rescore as again

    require_results(folder)
    with store.locked(folder):
        scored, without = again(folder, overrides, command)
        write_derived(folder)
    console = consoles()[0]
    console.print(f"{scored} checkpoints scored again, {without} kept as they were: they have no image.")
    console.print(f"Report: {folder / 'report.html'}", soft_wrap=True)


def merge(folders: Sequence[Path], out: Path) -> None:
    """Puts results folders together, machine beside machine, and reports."""
    from harness.store.merge import merge as merged

    for folder in folders:
        require_results(folder)
    with store.locked(out):
        counts = merged(folders, out)
        write_derived(out)
    console = consoles()[0]
    for env_id, count in counts.items():
        console.print(f"{count} measured cells of machine {env_id}", soft_wrap=True)
    if len(counts) > 1:
        console.print("Times of different machines must not be compared; the report keeps them apart.")
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)


def archive(folder: Path, out: Path, images: int, authors: Sequence[str], licence: str, scenes: bool) -> None:
    """Writes a small copy of a results folder, and its report."""
    from harness.report.archive import archive as archived
    from harness.report.supplement import Published

    require_results(folder)
    with store.locked(out):
        size, missing = archived(folder, out, images, Published(authors, licence, scenes))
        write_derived(out)
    for sentence in missing:
        consoles()[1].print(sentence, markup=False, soft_wrap=True)
    rest = "without the tables, plots and report, which `raybench report` makes again"
    consoles()[0].print(f"Archive: {out}, {size / 1e6:.2g} MB {rest}", soft_wrap=True)


def calibrate(folder: Path) -> int:
    """Prints the figures of a calibration; 1 where one is not what it must be, else 0, also where a run is too small."""
    from harness.analysis import calibration

    require_results(folder)
    calibrated = calibration.calibrate(analysed(folder))
    console = consoles()[0]
    console.print(calibration.rests_on(calibrated), markup=False, soft_wrap=True)
    table = Table("figure", "value", "must be", "", box=None, header_style="bold")
    for figure in calibration.figures(calibrated):
        holds = "" if figure.holds is None else "holds" if figure.holds else "missed"
        table.add_row(figure.name, figure.value, figure.expected, holds)
    console.print(table)
    return 1 if calibration.missed(calibrated) else 0


def compare(
    before: Sequence[Path], after: Sequence[Path], everything: bool, output: Path | None, threshold: float | None
) -> int:
    """Prints the ratios of two sides of results folders, and the images that changed, or all; the number of regressions."""
    from harness.report.tables import TEXTS, changes
    from harness.store.results import load_results

    suffix = None if output is None else check_file(output, [f".{name}" for name in TEXTS])
    for folder in (*before, *after):
        require_results(folder)
    old, new = ([load_results(folder) for folder in side] for side in (before, after))
    changed = changes(old, new, threshold)
    shown = [row for row in changed.rows if everything or row.get("ratio") or row["verdict"] not in NO_CHANGE]
    console = consoles()[0]
    console.print(changed.note, markup=False, soft_wrap=True)
    print_rows(changed, shown)
    if not changed.rows:
        console.print("Nothing to compare.")
    elif left := len(changed.rows) - len(shown):
        console.print(f"{left} images show no change; --all lists them.")
    if any(results.ray_cells for results in (*old, *new)):
        console.print("Cells that trace rays are not compared between folders.")
    if output is not None and suffix is not None:
        atomic.write_text(output, TEXTS[suffix.removeprefix(".")](changed))
    return sum(bool(row.get("regression")) for row in changed.rows)


def sides(folders: Sequence[Path], before: Sequence[Path], after: Sequence[Path]) -> tuple[Sequence[Path], Sequence[Path]]:
    """The folders before and after: two without options, or those of both options."""
    if (folders and (before or after)) or (not folders and not (before and after)) or (folders and len(folders) != 2):
        raise ConfigError("compare: two results folders are expected, or --before and --after with one or more each")
    return (folders[:1], folders[1:]) if folders else (before, after)


def share(text: str) -> float:
    """`10%` or `0.1` as a share above zero."""
    number, percent, rest = text.strip().partition("%")
    try:
        value = float(number) / (100 if percent else 1)
    except ValueError:
        value = math.nan
    if rest or not 0 < value < math.inf:
        raise ConfigError(f"--threshold {text}: must be a share above zero: 10% or 0.1")
    return value
