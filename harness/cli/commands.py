"""The command line: `raybench` and `python -m harness`. Only names and help live here; work is imported when asked for.

Exit codes: 0 all is well, 1 a cell failed or timed out, a check failed, images differ, or a regression was found, 2 the input
cannot be used or a file cannot be written, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli import conversion, history, images, paper, replay
from harness.cli.comparing import SeveralFolders, compare
from harness.cli.options import (
    DEFAULT_ENGINE,
    AllowCommands,
    AllowImports,
    AllowOutside,
    Command,
    Config,
    Define,
    Folder,
    Group,
    Out,
    References,
    Set,
    choices,
    engine_lists,
    engines,
    given,
    names,
    parameters_of,
    parse_size,
    shipped,
    words,
)
from harness.cli.race import race

AGAINST = "With --against"
Replicates = Annotated[int, typer.Option(help="Independent images per engine.", rich_help_panel=AGAINST)]
Spp = Annotated[int, typer.Option(min=1, help="Samples per pixel of each image.", rich_help_panel=AGAINST)]
EquivalenceShader = Annotated[
    str, typer.Option(help="A shader's name.", autocompletion=choices("SHADERS"), rich_help_panel=AGAINST)
]
Margin = Annotated[
    float, typer.Option(help="Largest difference of image means that counts as equal, as a share.", rich_help_panel=AGAINST)
]
TileMargin = Annotated[float, typer.Option(help="The same for tiles of 16x16 pixels.", rich_help_panel=AGAINST)]
FirstSeed = Annotated[int, typer.Option(help="The first seed.", rich_help_panel=AGAINST)]
SameSeeds = Annotated[
    bool, typer.Option("--same-seeds", help="The same seeds for all: shared noise cancels.", rich_help_panel=AGAINST)
]

app = typer.Typer(
    name="raybench",
    cls=Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Measures how long ray tracers take to reach a given image error.",
    epilog="Exit codes: 0 all is well; 1 a cell failed or timed out, a check failed, images differ, or a regression was "
    "found; 2 the input cannot be used, or a file cannot be written; 130 interrupted.",
)

EXPERIMENTS, RESULTS, IMAGES, ENGINES = "Experiments", "Results", "Images and scenes", "Engines"
"""The groups of commands in the help."""


def command(group: str, cls: type[Command] = Command, name: str | None = None) -> Callable[[Any], Any]:
    """Registers a function as a command in a group of the help."""
    return app.command(name, cls=cls, rich_help_panel=group)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"raybench {version('raybench')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options of the program itself."""


command(EXPERIMENTS)(race)


@command(EXPERIMENTS)
def run(
    config: Config,
    out: Out = None,
    overrides: Set = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Delete earlier results in the folder first.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Measure failed and timed-out cells again.")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="Stop at the first cell that fails.")] = False,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Render on the machines behind a Dask scheduler, as tcp://host:8786.")
    ] = None,
    references: References = None,
    only: Annotated[
        str | None, typer.Option(metavar="references", help="Only render the references.", autocompletion=words("references"))
    ] = None,
) -> None:
    """Measure the missing cells of an experiment, then write tables, plots and report. The same command resumes a run."""
    from engines.errors import ConfigError
    from harness.cli import experiments
    from harness.run.sweep import Options

    allowed = allow_imports, allow_commands, allow_outside
    if only not in (None, "references"):
        raise ConfigError(f"--only {only}: references is expected")
    if only:
        raise typer.Exit(experiments.reference(config, out, overrides or [], allowed))
    options = Options(retry, fail_fast, *allowed, ["raybench", *sys.argv[1:]], cluster)
    raise typer.Exit(experiments.run(config, out, overrides or [], fresh, options))


@command(EXPERIMENTS)
def plan(
    config: Config,
    out: Out = None,
    overrides: Set = None,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
    references: References = None,
) -> None:
    """Show what a run would measure: every configuration, its state, why it is skipped, and the expected time."""
    from harness.cli import experiments

    experiments.plan(config, out, overrides or [], (allow_imports, allow_commands, allow_outside))


@command(EXPERIMENTS)
def status(folder: Folder) -> None:
    """Show the progress of the run in a results folder, and what failed."""
    from harness.cli import experiments

    experiments.status(folder)


command(IMAGES, images.Render)(images.render)
app.command(images.DAHLQUIST, cls=Command, hidden=True)(images.dahlquist)


@command(IMAGES)
def view(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE", help="A scene below the folder, or a bare name from scenes/.", autocompletion=shipped("scenes")
        ),
    ] = "cornell_box",
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Folder that the page may read. Races are saved in it.")] = Path(
        "."
    ),
    engine: Annotated[str, typer.Option(help="Engine that is selected at first.", autocompletion=engines)] = DEFAULT_ENGINE,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the server.", show_default="a free one")] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address, and open no browser.")] = False,
    allow_imports: AllowImports = False,
    allow_outside: AllowOutside = False,
    define: Define = None,
    references: References = None,
) -> None:
    """Open the live viewer in a browser on this machine: images while they are refined, races, Dahlquist's program."""
    from harness.view import open_viewer
    from harness.view.options import ViewOptions

    allowed, parameters = (allow_imports, allow_outside), parameters_of(define)
    open_viewer(ViewOptions(scene, folder, port, engine, *allowed, parameters, not no_browser))


@command(RESULTS)
def report(
    folders: Annotated[list[Path] | None, typer.Argument(metavar="FOLDER", help="Results folders.")] = None,
    chapter: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write a chapter into this folder instead: tables and figures, with a section for each results folder.",
        ),
    ] = None,
    plot: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Show a plot of your own, too: module:function, or a name that a plugin registers."),
    ] = None,
    table: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Show a table of your own, too: module:function, or a name that a plugin registers."),
    ] = None,
    allow_imports: AllowImports = False,
    rescore: Annotated[
        bool, typer.Option("--rescore", help="First compute all metrics again from the images: see --set.")
    ] = False,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Another quality to rescore by: --set quality.epsilon=0.1."),
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate",
            help="Estimate the error rates of a run's verdicts from its own noise, instead. Exit code 1 if a figure is "
            "outside its range.",
        ),
    ] = False,
    references: References = None,
) -> None:
    """Write tables, plots and report.html of results folders again, without rendering; or a chapter about them."""
    from engines.errors import ConfigError
    from harness.cli import results

    if overrides and not rescore:
        raise ConfigError(f"--set {overrides[0]}: is for --rescore")
    if calibrate or rescore:
        if chapter is not None or plot or table or (calibrate and rescore):
            raise ConfigError(f"--{'calibrate' if calibrate else 'rescore'}: stands alone, beside --set for --rescore")
        results.require_folders(folders or [], "report")
        if calibrate:
            raise typer.Exit(max([results.calibrate(folder) for folder in folders or []]))
        for folder in folders or []:
            results.rescore(folder, overrides or [], ["raybench", *sys.argv[1:]])
        return
    own = [*(("plot", name) for name in plot or ()), *(("table", name) for name in table or ())]
    if chapter is None:
        results.report(folders or [], own, allow_imports)
    elif own:
        raise ConfigError(f"--{own[0][0]} {own[0][1]}: is for a report: a chapter has none")
    else:
        results.chapter(folders or [], chapter)


@command(RESULTS)
def archive(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="A results folder; several are merged.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", file_okay=False, help="A new folder, or an archive to replace.")
    ],
    images: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Images of a scene and shader: that many at the end, as many at equal time. Merged folders keep theirs.",
            show_default="2",
        ),
    ] = None,
    author: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="An author, as 'Kajiya, James'; may be repeated. By default none.")
    ] = None,
    licence: Annotated[str, typer.Option("--license", metavar="SPDX", help="Licence of the measurements, as CC-BY-4.0.")] = "",
    scenes: Annotated[bool, typer.Option(help="Include the files of scenes that do not come with raybench.")] = True,
    references: References = None,
) -> None:
    """Copy results into a small folder for reviewers: few images, references, scenes, and how to replay and cite them.

    Several folders become one with all their images and a report; times of several machines are kept apart.
    """
    from engines.errors import ConfigError
    from harness.cli import results

    if len(folders) > 1 and images is not None:
        raise ConfigError(f"--images {images}: is for one folder: merged folders keep their images")
    if len(folders) > 1 and (author or licence or not scenes):
        raise ConfigError("--author, --license, --no-scenes: are for one folder: merge first, then archive what you get")
    if len(folders) > 1:
        results.merge(folders, out)
    else:
        results.archive(folders[0], out, 2 if images is None else images, author or (), licence, scenes)


command(RESULTS, SeveralFolders)(compare)
command(RESULTS)(history.history)
command(RESULTS)(paper.table)
command(RESULTS, paper.SeveralCrops)(paper.figure)
command(RESULTS)(replay.replay)


@command(ENGINES)
def verify(
    context: typer.Context,
    engine: Annotated[
        list[str] | None,
        typer.Option(
            "--engine",
            metavar="A,B",
            help="Installed engines, module:attribute, or all. May be repeated.",
            show_default="numpy, numba, embree",
            autocompletion=engine_lists,
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer rays and parameters: a minute and a half.")] = False,
    only: Annotated[
        list[str] | None, typer.Option("--case", metavar="ID", help="Check only this case or section. May be repeated.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Results folder.", show_default="results/verify")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes that run in parallel.", show_default="one per core, at most 8")
    ] = None,
    against: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENGINE",
            help="Instead bound the difference of the engines' images from this one's, in the mean and in any tile. Exit code "
            "1 if they are different.",
            autocompletion=engine_lists,
        ),
    ] = None,
    scene: Annotated[
        str, typer.Option(help="A scene.", autocompletion=shipped("scenes"), rich_help_panel=AGAINST)
    ] = "cornell_box",
    replicates: Replicates = 16,
    spp: Spp = 16,
    size: Annotated[Any, typer.Option(parser=parse_size, metavar="WxH", help="Pixels.", rich_help_panel=AGAINST)] = "64x64",
    shader: EquivalenceShader = "path_tracer",
    margin: Margin = 0.005,
    tile_margin: TileMargin = 0.05,
    seed: FirstSeed = 1,
    same_seeds: SameSeeds = False,
    define: Define = None,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Check engines with hard cases and known answers. Exit code 1 if a check fails, 2 if nothing was checked."""
    from engines.errors import ConfigError
    from harness.verify.commands.equivalence import EquivalenceOptions, Margins
    from harness.verify.commands.equivalence import compare as equivalence
    from harness.verify.commands.verify import VerifyOptions
    from harness.verify.commands.verify import verify as run_verify

    allowed = allow_imports, allow_commands, allow_outside
    _only_with_its_kind(context, bool(against))
    if against:
        if not engine:
            raise ConfigError(f"--against {','.join(against)}: --engine is expected, too")
        options = EquivalenceOptions(
            *(scene, [*names(against), *names(engine)], replicates, spp, size, shader, Margins(margin, tile_margin), seed),
            *(same_seeds, *allowed, parameters_of(define)),
        )
        raise typer.Exit(equivalence(options))
    raise typer.Exit(run_verify(VerifyOptions(names(engine), quick, only or [], out, jobs, allow_imports)))


def _only_with_its_kind(context: typer.Context, against: bool) -> None:
    """Refuses options of images where checks are run, and options of checks where images are compared."""
    from engines.errors import ConfigError

    for param in context.command.params:
        of_images = param.name == "define" or getattr(param, "rich_help_panel", None) == AGAINST
        of_checks = param.name in ("quick", "only", "out", "jobs")
        if param.name in given(context) and (of_checks if against else of_images):
            raise ConfigError(f"{param.opts[0]}: is for {'checks, without' if against else 'images, with'} --against ENGINE")


command(IMAGES)(conversion.convert)


@command(ENGINES, name="list")
def list_(
    schema: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="Instead print the JSON schema of experiment or scene files, for editors: experiment or scene.",
            autocompletion=words("experiment", "scene"),
        ),
    ] = None,
) -> None:
    """List engines, shaders, samplers and accelerators with their options, scenes and experiments."""
    from harness.cli.listing import print_schema, show

    if schema is None:
        show()
    else:
        print_schema(schema)


def main() -> None:
    """Runs the command line; an error that the user caused is one message and exit code 2."""
    warnings.formatwarning = lambda message, *_, **__: f"raybench: warning: {message}\n"
    try:
        app()
    except BrokenPipeError:
        from harness.console import BROKEN_PIPE

        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.exit(BROKEN_PIPE)
    except Exception as error:
        message = _as_one_line(error)
        if message is None:
            raise
        print(f"raybench: {message}", file=sys.stderr)
        sys.exit(2)


def _as_one_line(error: Exception) -> str | None:
    """An error that the user or the machine caused as one line; None for a mistake of ours."""
    from engines.errors import RaybenchError

    if isinstance(error, RaybenchError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:  # a full disk, a file that may not be written
        return f"{error.filename}: {error.strerror}" if error.filename is not None else error.strerror
    if isinstance(error, MemoryError):
        return f"there is not enough memory: {error}" if str(error) else "there is not enough memory"
    return None
