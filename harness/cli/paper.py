"""The commands `raybench figure` and `raybench table`: what a paper shows of a results folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from harness.cli.options import Command, Folder, choices, words

VALUES = ("ratio", "seconds", "error", "spp")
"""What the cells of a table can hold."""


class SeveralCrops(Command):
    """Takes several crops behind one `--crops`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        spread: list[str] = []
        for word in args:
            is_next = "," in word and not word.startswith("-") and "--crops" in spread[-2:-1]
            spread += ["--crops", word] if is_next else [word]
        return super().parse_args(ctx, spread)


def figure(
    folder: Folder,
    scene: Annotated[str, typer.Option(metavar="SCENE", help="The scene to show.")],
    output: Annotated[Path, typer.Option("--out", "-o", help="The file: .pdf, .png or .svg.")],
    crops: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="X,Y,W,H...", help="Crops in pixels. By default two squares of high contrast."),
    ] = None,
    at: Annotated[
        str, typer.Option(metavar="2s|64spp|last", help="Compare images after a time, at a number of samples, or the last.")
    ] = "last",
    contestants: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--contestant", metavar="NAME", help="A contestant by its name in the report; may be repeated."),
    ] = None,
    tone: Annotated[
        str, typer.Option("--tone", metavar="NAME", help="Tone mapper of all images.", autocompletion=choices("TONE_MAPPERS"))
    ] = "srgb",
    exposure: Annotated[float, typer.Option(metavar="STOPS", help="Brighten all images by so many stops.")] = 0.0,
    width: Annotated[float, typer.Option(min=2, max=40, metavar="INCHES", help="Width of the figure.")] = 7.2,
    plot: Annotated[bool, typer.Option(help="Show error over time beside the images.")] = True,
    exr: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--exr", metavar="DIR", file_okay=False, help="Also write each crop as an EXR of linear radiance."),
    ] = None,
) -> None:
    """Draw a figure for a paper: the reference with crops, each contestant's crops with their errors, and error over time."""
    from harness.cli.outputs import check_file, check_folder
    from harness.cli.results import require_results
    from harness.console import consoles
    from harness.report import comparison_figure as made
    from harness.report.moments import moment_of
    from harness.report.plots.figures import save, style
    from harness.store.results import load_results

    suffix = check_file(output, (".pdf", ".png", ".svg"))
    if exr is not None:
        check_folder(exr, "--exr")
    require_results(folder)
    results = load_results(folder)
    taken = made.taken_images(results, scene, moment_of(at), contestants or [])
    reference = made.reference_of(results, taken)
    parts = [made.crop_of(text) for text in crops or []] or made.chosen_crops(reference.mean)
    with style():
        drawn = made.comparison_figure(
            results, taken, reference, parts, tone=tone, exposure=exposure, width=width, with_plot=plot
        )
        save(drawn, output.parent, output.stem, [suffix.removeprefix(".")])
    console = consoles()[0]
    console.print(f"Figure: {output}", soft_wrap=True)
    if exr is not None:
        exr.mkdir(exist_ok=True)
        console.print(f"{len(made.write_crops(exr, taken, reference, parts))} crops in {exr}", soft_wrap=True)


def table(
    folder: Folder,
    value: Annotated[str, typer.Option(metavar="|".join(VALUES), help="What the cells hold.", autocompletion=words(*VALUES))],
    rows: Annotated[str, typer.Option(metavar="SETTING", help="A setting, as sampler or light_sampler.")] = "scene",
    columns: Annotated[
        str, typer.Option(metavar="SETTING", help="Another one; target and size are settings, too.")
    ] = "contestant",
    target: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="ERROR", help="Seconds, samples or ratio until this target.", show_default="the run's only one"),
    ] = None,
    at: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="2s|64spp|last", help="Values after a time, at a number of samples, or at the end."),
    ] = None,
    where: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="SETTING=VALUE", help="Only contestants that have this setting; may be repeated."),
    ] = None,
    form: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            "--format",
            metavar="latex|markdown|csv|html",
            help="Format of the table.",
            show_default="by the file's suffix, else markdown",
            autocompletion=words("latex", "markdown", "csv", "html"),
        ),
    ] = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--out", "-o", help="The file: .tex, .md, .csv or .html.", show_default="standard output"),
    ] = None,
) -> None:
    """Print a table for a paper: a value with any two settings as rows and columns, with intervals."""
    from engines.errors import UnknownName
    from harness.analysis import analyse
    from harness.cli.outputs import check_file
    from harness.cli.results import require_results
    from harness.console import consoles
    from harness.report import paper_table as made
    from harness.report.moments import moment_of
    from harness.store.atomic import write_text
    from harness.store.results import load_results

    suffix = "" if output is None else check_file(output, made.SUFFIXES if form is None else [output.suffix.lower()])
    form = form or made.SUFFIXES.get(suffix, "markdown")
    if form not in made.FORMATS:
        raise UnknownName("format", form, made.FORMATS)
    if value not in VALUES:
        raise UnknownName("value", value, VALUES)
    asked = made.Asked(value, rows, columns, made.conditions(where or (), target), None if at is None else moment_of(at))
    require_results(folder)
    found = made.paper_table(analyse(load_results(folder)), asked)
    text = made.FORMATS[form](found)
    if output is None:
        typer.echo(text, nl=False)
    else:
        write_text(output, text)
        consoles()[0].print(f"Table: {output}", soft_wrap=True)
        consoles()[0].print(found.note, markup=False, soft_wrap=True)
