"""Engines compared by the rays that they trace, and by their wrong answers: for `raybench race --rays`, and the command `trace`
that it replaces."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import AllowCommands, AllowImports, AllowOutside, Define, engines, parameters_of, shipped, words

if TYPE_CHECKING:
    from rich.console import Console

    from harness.config import ConfigFile
    from harness.run.sweep import Options, Outcome

RAY_KINDS = ("camera", "shadow", "incoherent")
ENGINES = ("numpy", "numba", "embree", "embreex_batch")
"""Those that are compared where none is named."""


def trace(
    scene: Annotated[
        list[str],
        typer.Argument(metavar="SCENE", help="Scenes: paths, or bare names from scenes/.", autocompletion=shipped("scenes")),
    ],
    rays: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SET",
            help="camera, shadow or incoherent rays. May be repeated.",
            show_default="all three",
            autocompletion=words(*RAY_KINDS),
        ),
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="An engine. May be repeated.", show_default=", ".join(ENGINES), autocompletion=engines
        ),
    ] = None,
    accelerator: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A name, or a mapping with options. May be repeated.", show_default="auto"),
    ] = None,
    precision: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="float64 or float32. May be repeated.", show_default="the engine's")
    ] = None,
    threads: Annotated[list[int] | None, typer.Option(help="Number of threads. May be repeated.", show_default="1")] = None,
    count: Annotated[int, typer.Option(help="Rays per set.")] = 200_000,
    batch: Annotated[int | None, typer.Option(help="Rays per call.", show_default="all")] = None,
    bounces: Annotated[int, typer.Option(help="Bounces of the paths that incoherent rays start from.")] = 3,
    checked: Annotated[int, typer.Option(help="Rays per set that are compared with exact answers.")] = 10_000,
    hard: Annotated[int, typer.Option(help="Rays per set at shared edges and vertices, to count leaks.")] = 20_000,
    repeats: Annotated[int, typer.Option(help="Number of blocks.")] = 5,
    max_time: Annotated[str, typer.Option(metavar="TIME", help="Time inside calls, per block.")] = "500ms",
    seed: Annotated[int, typer.Option(help="Seed of the rays and of the order.")] = 1,
    baseline: Annotated[
        str | None,
        typer.Option(
            metavar="ENGINE",
            help="Engine that rates are compared with.",
            show_default="the first that has results",
            autocompletion=engines,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Results folder.", show_default="results/trace")
    ] = None,
    define: Define = None,
    json: Annotated[bool, typer.Option("--json", help="Print the rows of the table as JSON.")] = False,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Compare engines by rays: million rays per second, wrong hits, misses and leaks. An experiment of one line."""
    from engines.errors import ConfigError
    from engines.schema.yaml_file import locate, parse_yaml
    from harness.config import ConfigFile
    from harness.run.sweep import Options

    parameters = parameters_of(define)
    axes = {
        "rays": rays or [*RAY_KINDS],
        "engine": engine or [*ENGINES],
        "accelerator": [parse_yaml(each, "--accelerator", ConfigError).plain() for each in accelerator or []],
        "precision": precision or [],
        "threads": threads or [],
    }
    written = {
        **experiment([{"file": each, "parameters": parameters} for each in scene] if parameters else scene, axes),
        "ray_sets": {"count": count, "batch": batch, "bounces": bounces, "checked": checked, "hard": hard},
        "budget": {"max_time": max_time},
        "repeats": repeats,
        "seed": seed,
        "baseline": baseline,
    }
    file = ConfigFile(locate(written, "", ConfigError), Path("trace"), "")
    options = Options(False, False, allow_imports, allow_commands, allow_outside, ["raybench", *sys.argv[1:]])
    raise typer.Exit(measure(file, out, [], False, options, json))


def experiment(scenes: list[Any], axes: Mapping[str, list[Any]]) -> dict[str, Any]:
    """The experiment of a comparison by rays."""
    return {
        "raybench_experiment": 1,
        "matrix": {"scene": scenes, **{key: values for key, values in axes.items() if values}},
        "budget": {"max_time": "500ms"},
        "repeats": 5,
        "remeasure": 0,
    }


def measure(file: ConfigFile, out: Path | None, overrides: list[str], fresh: bool, options: Options, json: bool) -> int:
    """Runs a comparison by rays; the exit code, 2 where no cell was measured. `json`: the rows of the table are printed so."""
    from harness import config
    from harness.cli import experiments

    folder = experiments.results_folder(config.load(file, overrides), out)
    summary = _print_rows if json else experiments.print_summary
    return experiments.run(file, folder, overrides, fresh, options, summary) or _declined(folder)


def _print_rows(console: Console, outcome: Outcome, folder: Path) -> None:
    """The table `rays` as JSON, a mapping a row; what failed on stderr."""
    from harness.cli import experiments
    from harness.console import consoles
    from harness.report.tables.rays import rays as table_of
    from harness.store.results import load_results

    text = table_of(load_results(folder)).frame.to_json(orient="records", indent=1, double_precision=15)
    console.print(text, markup=False, soft_wrap=True)
    experiments.print_failures(consoles()[1], outcome, folder)


def _declined(folder: Path) -> int:
    """2 where no cell was measured, else 0."""
    from harness.store.results import load_results

    return 0 if any(cell.state == "done" for cell in load_results(folder).ray_cells) else 2
