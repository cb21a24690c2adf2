"""The command `raybench figure`: what a paper shows of a results folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from harness.cli.options import Folder, choices


def figure(
    folder: Folder,
    scene: Annotated[str, typer.Option(metavar="SCENE", help="The scene to show.")],
    output: Annotated[Path, typer.Option("--out", "-o", help="The file: .pdf, .png or .svg.")],
    crops: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="X,Y,W,H", help="A crop in pixels; may be repeated. By default two squares of high contrast."),
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
    from harness.report.plots.figures import save, style
    from harness.store.results import load_results

    suffix = check_file(output, (".pdf", ".png", ".svg"))
    if exr is not None:
        check_folder(exr, "--exr")
    require_results(folder)
    results = load_results(folder)
    taken = made.taken_images(results, scene, made.moment_of(at), contestants or [])
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
