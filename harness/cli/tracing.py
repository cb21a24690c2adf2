"""The command `raybench trace`: engines compared by the rays that they trace, and by their wrong answers."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from harness.cli.options import AllowImports, AllowOutside, engines, shipped, words

if TYPE_CHECKING:
    from harness.config import ConfigFile

INTERRUPTED = 130


def trace(
    scene: Annotated[
        list[str],
        typer.Argument(metavar="SCENE", help="Scenes: paths, or bare names from scenes/.", autocompletion=shipped("scenes")),
    ],
    rays: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            metavar="SET",
            help="camera, shadow or incoherent rays. May be repeated.",
            show_default="all three",
            autocompletion=words("camera", "shadow", "incoherent"),
        ),
    ] = None,
    engine: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            metavar="NAME",
            help="An engine. May be repeated.",
            show_default="numpy, numba, embree, embreex_batch",
            autocompletion=engines,
        ),
    ] = None,
    accelerator: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="NAME", help="A name, or a mapping with options. May be repeated.", show_default="auto"),
    ] = None,
    precision: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="NAME", help="float64 or float32. May be repeated.", show_default="the engine's"),
    ] = None,
    threads: Annotated[Optional[list[int]], typer.Option(help="Number of threads. May be repeated.", show_default="1")] = None,  # noqa: UP045
    count: Annotated[int, typer.Option(help="Rays per set.")] = 200_000,
    batch: Annotated[Optional[int], typer.Option(help="Rays per call.", show_default="all")] = None,  # noqa: UP045
    bounces: Annotated[int, typer.Option(help="Bounces of the paths that incoherent rays start from.")] = 3,
    checked: Annotated[int, typer.Option(help="Rays per set that are compared with exact answers.")] = 10_000,
    hard: Annotated[int, typer.Option(help="Rays per set at shared edges and vertices, to count leaks.")] = 20_000,
    repeats: Annotated[int, typer.Option(help="Number of blocks.")] = 5,
    max_time: Annotated[str, typer.Option(metavar="TIME", help="Time inside calls, per block.")] = "500ms",
    seed: Annotated[int, typer.Option(help="Seed of the rays and of the order.")] = 1,
    baseline: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            metavar="ENGINE",
            help="Engine that rates are compared with.",
            show_default="the first that has results",
            autocompletion=engines,
        ),
    ] = None,
    out: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--out", metavar="DIR", help="Results folder.", show_default="results/trace"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the results as JSON, not as tables.")] = False,
    allow_imports: AllowImports = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Compare engines by rays: million rays per second, wrong hits, misses and leaks."""
    from engines.errors import ConfigError
    from engines.schema.yaml_file import parse_yaml
    from harness.trace.experiment import trace_of

    axes = {"rays": rays, "engine": engine, "precision": precision, "threads": threads}
    chosen = [parse_yaml(each, "--accelerator", ConfigError).plain() for each in accelerator or []]
    options = {
        "scene": scene,
        "accelerator": chosen or None,
        "count": count,
        "batch": batch,
        "bounces": bounces,
        "checked": checked,
        "hard": hard,
        "repeats": repeats,
        "max_time": max_time,
        "seed": seed,
        "baseline": baseline,
        **axes,
    }
    experiment = trace_of({key: value for key, value in options.items() if value is not None})
    raise typer.Exit(measure(experiment, out, json, (allow_imports, allow_outside), ["raybench", *sys.argv[1:]]))


def run_file(
    given: ConfigFile, out: Path | None, overrides: Sequence[str], allowed: tuple[bool, bool], command: Sequence[str]
) -> int:
    """`raybench run` of a file that compares rays."""
    from harness.trace.experiment import load_trace

    return measure(load_trace(given, overrides), out, False, allowed, command)


def measure(experiment: Any, out: Path | None, as_json: bool, allowed: tuple[bool, bool], command: Sequence[str]) -> int:
    """Measures, writes and prints; the exit code: 1 where a contestant failed, 2 where all declined, 130 if interrupted.
    `allowed`: imports, and files outside of the scenes' folders."""
    from harness.console import consoles
    from harness.processes import allow_here
    from harness.report.tracing import show, write
    from harness.run import trace as run_trace
    from harness.store import make_out
    from harness.trace.records import text_of

    stdout, stderr = consoles()
    allow_imports, allow_outside = allowed
    experiment = replace(experiment, scene=tuple(replace(file, allow_outside=allow_outside) for file in experiment.scene))
    allow_here(allow_imports, experiment.folder)
    folder = out or Path("results") / experiment.name
    make_out(folder)
    try:
        with stderr.status("trace") as status:

            def note(text: str) -> None:
                status.update(text)
                if not stderr.is_terminal:
                    stderr.print(text, markup=False, soft_wrap=True)

            results = run_trace.run(experiment, folder, note, allow_imports, command)
    except KeyboardInterrupt:
        stderr.print("\nInterrupted: nothing was written.")
        return INTERRUPTED
    write(results, folder)
    if as_json:
        stdout.print(text_of(results), markup=False, soft_wrap=True, end="")
    else:
        show(results, stdout)
        stdout.print(f"Report: {folder / 'report.html'} (and trace.json, tables/, plots/)", soft_wrap=True, markup=False)
    return _code([each.model_dump() for each in results.entries])


def _code(entries: Sequence[Mapping[str, Any]]) -> int:
    states = {entry["state"] for entry in entries}
    return 1 if states & {"failed", "timeout"} else 0 if "done" in states else 2
