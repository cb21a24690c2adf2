"""The command `raybench history`: seconds to each target over the revisions of a renderer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def history(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A folder with results folders below it, one per session.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR", file_okay=False, help="Folder of the files.", show_default="FOLDER"),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Also show revisions at which nothing changed.")] = False,
    threshold: Annotated[
        str | None,
        typer.Option(
            metavar="SHARE",
            help="Smallest increase of a time that is a regression. By default the config's same_within, and 10% for times "
            "that are not tested.",
        ),
    ] = None,
) -> None:
    """Show seconds to each target over the revisions of a renderer; exit code 1 if the last one is slower or worse.

    Writes history.csv, history.md and history.png.
    """
    from engines.errors import ConfigError
    from harness.cli import results
    from harness.console import consoles
    from harness.report.plots.figures import save, style
    from harness.report.plots.history import history_figure
    from harness.report.tables import csv_text, markdown_text, regressions
    from harness.report.tables import history as made
    from harness.store import events
    from harness.store.atomic import write_text
    from harness.store.results import load_results

    limit = None if threshold is None else results.share(threshold)
    found = sorted({path.parent for name in (events.EVENTS, events.COMPRESSED) for path in folder.rglob(name)})
    if not found:
        raise ConfigError(f"{folder}: no results folder is there or below it: folders written by `raybench run` are expected")
    table = made([load_results(each) for each in found], limit)
    if not table.rows:
        raise ConfigError(f"{folder}: nothing was measured towards a target in its {len(found)} results folders")
    console = consoles()[0]
    console.print(table.note, markup=False, soft_wrap=True)
    quiet = ("", "same", "unresolved")
    results.print_rows(table, [row for row in table.rows if everything or row["verdict"] not in quiet])
    out = output or folder
    out.mkdir(parents=True, exist_ok=True)
    for suffix, text in (("csv", csv_text), ("md", markdown_text)):
        write_text(out / f"history.{suffix}", text(table))
    with style():
        save(history_figure(table), out, "history", ["png"])
    bad = regressions(table)
    console.print(f"Written: {out / 'history.csv'}, history.md, history.png", soft_wrap=True)
    steps = sum(row["verdict"] not in quiet for row in table.rows)
    found = f"{len(bad)} regression{'s' * (len(bad) != 1)} at the last revision"
    console.print(f"{found}, {steps} step{'s' * (steps != 1)} or flag{'s' * (steps != 1)} in all.", soft_wrap=True)
    raise typer.Exit(1 if bad else 0)
