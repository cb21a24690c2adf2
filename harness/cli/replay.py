"""The command `raybench replay`: measures an archive again and says what was reproduced."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from harness.cli.options import AllowCommands, AllowImports, AllowOutside, Folder, References, Set

if TYPE_CHECKING:
    from rich.console import Console

    from harness.analysis import Analysis
    from harness.analysis.columns import Table
    from harness.config import ConfigFile


def replay(
    folder: Folder,
    out: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "-o",
            "--out",
            metavar="DIR",
            file_okay=False,
            help="Folder of the new results.",
            show_default="results/<name>-replay",
        ),
    ] = None,
    overrides: Set = None,
    everything: Annotated[bool, typer.Option("--all", help="Also show what was reproduced.")] = False,
    table: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(metavar="FILE", help="Write all rows: .csv, .md or .tex."),
    ] = None,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
    references: References = None,
) -> None:
    """Measure an archive or results folder again, and say what was reproduced. Exit code 1 if something was not."""
    from engines.errors import ConfigError
    from harness.analysis import analyse
    from harness.cli import experiments
    from harness.cli.outputs import check_file
    from harness.cli.results import require_results
    from harness.console import consoles
    from harness.report.tables import TEXTS
    from harness.report.tables.reproduction import reproduction
    from harness.run.sweep import Options
    from harness.store.atomic import write_text
    from harness.store.results import load_results

    suffix = None if table is None else check_file(table, [f".{name}" for name in TEXTS])
    require_results(folder)
    target = out or Path("results") / f"{folder.resolve().name}-replay"
    if target.resolve() == folder.resolve():
        raise ConfigError(f"--out {target}: is the folder to replay: another is expected")
    options = Options(False, False, allow_imports, allow_commands, allow_outside, ["raybench", *sys.argv[1:]])
    code = experiments.run(experiment_of(folder), target, overrides or [], False, options)
    if code not in (0, 1):
        raise typer.Exit(code)
    there, here = (analyse(load_results(each)) for each in (folder, target))
    found = reproduction(there, here)
    _say(consoles()[0], found, there, here, everything)
    if table is not None and suffix is not None:
        write_text(table, TEXTS[suffix.removeprefix(".")](found))
    raise typer.Exit(1 if code or any(row.get("reproduced") is False for row in found.rows) else 0)


def experiment_of(folder: Path) -> ConfigFile:
    """The experiment of an archive, or of a results folder by its manifest. Raises `ConfigError`."""
    from engines.errors import ConfigError
    from engines.schema.yaml_file import locate
    from harness import store
    from harness.config import ConfigFile, read_file
    from harness.report.supplement import EXPERIMENT

    manifest = store.read_manifest(folder)
    if manifest.merged or not manifest.config:
        raise ConfigError(f"{folder}: {'was merged' if manifest.merged else 'has no experiment'}: replay the folder of one run")
    if (folder / EXPERIMENT).is_file():
        return read_file(f"{folder / EXPERIMENT}")
    path = folder / store.MANIFEST
    return ConfigFile(locate({"config": manifest.config}, str(path), ConfigError).value["config"], path, str(path))


def _say(console: Console, found: Table, there: Analysis, here: Analysis, everything: bool) -> None:
    """Prints what was not reproduced, or everything, then counts."""
    from harness.cli.results import print_rows
    from harness.report.tables.reproduction import differences_of_machines

    for words in differences_of_machines(there.results, here.results):
        console.print(words, markup=False, soft_wrap=True)
    print_rows(found, [row for row in found.rows if everything or row.get("reproduced") is not True])
    for kind, rows in (
        ("images", [row for row in found.rows if row["what"] == "image"]),
        ("ratios", [row for row in found.rows if row["what"] != "image"]),
    ):
        verdicts = Counter(str(row["verdict"]) for row in rows)
        counted = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
        reproduced = sum(row.get("reproduced") is True for row in rows)
        console.print(f"{reproduced} of {len(rows)} {kind} reproduced: {counted or 'none'}.", soft_wrap=True)
