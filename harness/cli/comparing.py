"""The command `raybench compare`, whose options take several folders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import Command


class SeveralFolders(Command):
    """Takes several folders behind `--before` and `--after`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        spread: list[str] = []
        option = ""
        for word in args:
            if word.startswith("-"):
                option = word if word in ("--before", "--after") else ""
                spread += [] if option else [word]
            else:
                spread += [option, word] if option else [word]
        return super().parse_args(ctx, spread)


def compare(
    folders: Annotated[
        list[Path] | None, typer.Argument(metavar="BEFORE AFTER", help="Two results folders.", show_default=False)
    ] = None,
    before: Annotated[
        list[Path] | None,
        typer.Option("--before", metavar="FOLDER...", help="Results folders before the change, one per session."),
    ] = None,
    after: Annotated[
        list[Path] | None,
        typer.Option("--after", metavar="FOLDER...", help="Results folders after it. Three or more per side are tested."),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Also show images that did not change.")] = False,
    output: Annotated[Path | None, typer.Option("--out", "-o", help="Write all rows: .csv, .md or .tex.")] = None,
    fail_on_regression: Annotated[
        bool,
        typer.Option("--fail-on-regression", help="Exit code 1 if something became slower or worse, failed or was flagged."),
    ] = False,
    threshold: Annotated[
        str | None,
        typer.Option(
            metavar="SHARE",
            help="Smallest increase of a time or error that is a regression. By default the config's same_within, and 10% for "
            "times of fewer than three sessions per side.",
        ),
    ] = None,
) -> None:
    """Compare results folders, such as before and after a change: speed, start-up, error and image."""
    from harness.cli import results

    limit = None if threshold is None else results.share(threshold)
    regressions = results.compare(*results.sides(folders or [], before or [], after or []), everything, output, limit)
    raise typer.Exit(1 if regressions and fail_on_regression else 0)
