"""Arguments and options that several commands have."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Optional

import typer

Config = Annotated[str, typer.Argument(help="An experiment: a path, or a bare name from configs/.")]
Folder = Annotated[Path, typer.Argument(help="A results folder.")]
Out = Annotated[Optional[Path], typer.Option("--out", help="Results folder. [default: results/<name>]")]  # noqa: UP045
Set = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--set", metavar="KEY=VALUE", help="Override a key: --set budget.max_time=5s. May be repeated."),
]


def _keep_references(folder: Path | None) -> Path | None:
    if folder is not None:
        os.environ["RAYBENCH_REFERENCES"] = str(folder)
    return folder


References = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(
        metavar="DIR", callback=_keep_references,
        help="Where references are kept; else in $RAYBENCH_REFERENCES, else in raybench/references of the user's cache.",
    ),
]  # fmt: skip
AllowImports = Annotated[
    bool, typer.Option("--allow-imports", help="Import code that files name as module:attribute. Only if you trust it.")
]

AllowCommands = Annotated[
    bool, typer.Option("--allow-commands", help="Run the programs that renderers' files name. Only if you trust them.")
]
AllowOutside = Annotated[
    bool, typer.Option("--allow-outside", help="Read files outside of the scene's folder where the scene names them.")
]
Define = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("-D", metavar="NAME=VALUE", help="A value of $NAME in a Mitsuba file. May be repeated."),
]
