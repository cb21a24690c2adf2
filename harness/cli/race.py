"""The command `raybench race`: a short way to write an experiment, run it and read its answer."""

from __future__ import annotations

import math
import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli import rays as by_rays
from harness.cli.options import (
    AllowCommands,
    AllowImports,
    AllowOutside,
    Define,
    Out,
    References,
    Set,
    choices,
    engine_lists,
    parameters_of,
    parse_size,
    shipped,
    words,
)

if TYPE_CHECKING:
    from engines.interface import Engine
    from engines.scene import Scene

PIXELS = 64 * 64
"""About so many has an image where no size is given."""
SAMPLERS = ("sobol", "orthogonal", "stratified", "random")
"""Where none is named: the first that all engines have, else of each engine the first that it has."""
ERROR_SHARE = 0.5
"""A cell ends at this share of the smallest target, since an error may pass a target by chance. The share is not simulated."""

_SEVERAL = "Separated by commas; may be repeated."


def race(
    scene: Annotated[
        list[str],
        typer.Argument(metavar="SCENE...", help="Scenes: paths, or bare names from scenes/.", autocompletion=shipped("scenes")),
    ],
    engine: Annotated[
        list[str] | None,
        typer.Option("--engine", metavar="A,B", help=f"Engines. {_SEVERAL}", show_default="numba", autocompletion=engine_lists),
    ] = None,
    shader: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A,B",
            help="Names, '{name: path_tracer, max_depth: 6}', or module:attribute with --allow-imports.",
            show_default="path_tracer",
            autocompletion=choices("SHADERS"),
        ),
    ] = None,
    sampler: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A,B",
            help="Names, mappings with options, or module:attribute.",
            show_default="sobol, or each engine's own",
            autocompletion=choices("SAMPLERS"),
        ),
    ] = None,
    accelerator: Annotated[
        list[str] | None, typer.Option(metavar="A,B", help="Names, or mappings with options.", show_default="auto")
    ] = None,
    precision: Annotated[
        list[str] | None,
        typer.Option(metavar="A,B", help="float64 or float32.", show_default="float64, or what all engines have"),
    ] = None,
    threads: Annotated[list[str] | None, typer.Option(metavar="N,M", help="Threads.", show_default="every core")] = None,
    to: Annotated[
        list[str] | None, typer.Option("--to", metavar="ERROR,...", help="Targets: errors in relMSE.", show_default="0.03,0.01")
    ] = None,
    size: Annotated[
        Any | None, typer.Option(parser=parse_size, metavar="WxH", help="Pixels.", show_default="some 64x64, in shape")
    ] = None,
    time: Annotated[
        str | None, typer.Option(metavar="TIME", help="Most time inside render calls, per cell.", show_default="2s")
    ] = None,
    repeats: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Repeats, each with its own seed.", show_default="3")
    ] = None,
    rays: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SET,...",
            help="Race by rays, not by images: camera, shadow, incoherent, or all. "
            "Then the defaults are four engines, 500ms and 5 repeats.",
            autocompletion=words(*by_rays.RAY_KINDS, "all"),
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Of rays: print the rows of the table as JSON.")] = False,
    overrides: Set = None,
    save: Annotated[Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Keep the experiment: .yaml.")] = None,
    out: Out = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Delete earlier results in the folder first.")] = False,
    define: Define = None,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
    references: References = None,
) -> None:
    """Race engines, shaders or samplers to an image error: who is sooner, and by how much. An experiment of one line."""
    from engines.errors import ConfigError
    from engines.schema.yaml_file import locate
    from harness.cli import experiments
    from harness.cli.race_output import RaceTerminal, print_answer
    from harness.config import ConfigFile
    from harness.console import consoles
    from harness.processes import allow_here
    from harness.run.sweep import Options

    allow_here(allow_imports)
    given = {"engine": engine, "shader": shader, "sampler": sampler, "accelerator": accelerator}
    if rays and (to or size):
        raise ConfigError(f"{'--to' if to else '--size'}: is for images, and --rays races without them")
    if json and not rays:
        raise ConfigError("--json: is for --rays; open_results and points.csv have the figures of images")
    given |= {"precision": precision, "threads": threads, "rays": rays}
    axes = {name: _values(f"--{name}", texts) for name, texts in given.items() if texts}
    targets = _values("--to", to) if to else [0.03, 0.01]
    parameters, allowed = parameters_of(define), (allow_imports, allow_commands, allow_outside)
    scenes = [{"file": each, "parameters": parameters} for each in scene] if parameters else scene
    if rays:
        kinds = [*by_rays.RAY_KINDS] if "all" in axes["rays"] else axes["rays"]
        axes = {"engine": [*by_rays.ENGINES], **axes, "rays": kinds}
        written, notes = {**by_rays.experiment(scenes, axes), "name": _name(scenes, {"rays": kinds})}, []
    else:
        written, notes = _by_images(scenes, axes, targets, size, allowed)
    if time is not None:
        written["budget"]["max_time"] = time
    if repeats is not None:
        written["repeats"] = repeats
    file = ConfigFile(locate(written, "", ConfigError), Path("race.yaml"), "")
    if save is not None:
        _save(save, file.overridden(overrides or []).plain())
    for note in notes:
        consoles()[1].print(note, markup=False, soft_wrap=True)
    options = Options(False, False, *allowed, ["raybench", *sys.argv[1:]])
    # The report draws its plots itself; as files they would take ten seconds: `raybench report` writes them.
    os.environ.setdefault("RAYBENCH_PLOTS", "none")
    if rays:
        raise typer.Exit(by_rays.measure(file, out, overrides or [], fresh, options, json))
    raise typer.Exit(experiments.run(file, out, overrides or [], fresh, options, terminal=RaceTerminal, answer=print_answer))


def _values(option: str, texts: Sequence[str]) -> list[Any]:
    """The values of an option, of lists separated by commas that are added up; each is YAML."""
    from engines.errors import ConfigError
    from engines.schema.yaml_file import parse_yaml

    found: list[Any] = []
    for text in texts:
        try:
            values = parse_yaml(f"[{text}]", option, ConfigError).plain()
        except ConfigError:
            values = None
        if not values or None in values:
            raise ConfigError(f"{option} {text}: names separated by commas are expected, or {{name: ..., option: value}}")
        found += values
    return list({str(value): value for value in found}.values())


def _name(scenes: Sequence[Any], axes: Mapping[str, Sequence[Any]]) -> str:
    """Of the results folder, too: the same question goes on where it was, another one is another folder."""
    parts = [Path(each["file"] if isinstance(each, dict) else each).stem for each in scenes]
    parts += [_word(value) for name in axes for value in axes[name]]
    return f"race {' '.join(parts)}"[:80]


def _word(value: Any) -> str:
    return " ".join(str(each) for each in value.values()) if isinstance(value, dict) else str(value)


def _by_images(
    scenes: list[Any],
    axes: dict[str, list[Any]],
    targets: list[Any],
    size: tuple[int, int] | None,
    allowed: tuple[bool, bool, bool],
) -> tuple[dict[str, Any], list[str]]:
    """The experiment of a race by images, and what is to be said of the settings that were chosen."""
    from engines.errors import ConfigError
    from engines.registry import lineage_of
    from harness.config.settings import ENGINE
    from harness.measure.machine import usable_cores

    if not all(isinstance(each, (int, float)) and not isinstance(each, bool) and 0 < each < math.inf for each in targets):
        raise ConfigError(f"--to {','.join(map(str, targets))}: errors above zero are expected, as 0.03,0.01")
    name = _name(scenes, axes)
    axes = {"engine": ["numba"], "threads": [len(usable_cores())], **axes}
    engines = _engines(axes["engine"], allowed)
    axes["engine"] = [ENGINE.write(each) for each in engines]
    loaded = [_scene(each, allowed) for each in scenes]
    written: dict[str, Any] = {"raybench_experiment": 1, "name": name}
    matrix: dict[str, Any] = {"scene": scenes, **axes}
    zips: list[dict[str, list[Any]]] = []
    notes: list[str] = []
    if size is None and len({_size(scene) for scene in loaded}) > 1:
        zips.append({"scene": matrix.pop("scene"), "resolution": [[*_size(scene)] for scene in loaded]})
    else:
        written["resolution"] = [*(size or _size(loaded[0]))]
    single = {}
    if "precision" not in axes and (single := _only_single(engines, loaded, allowed)):
        matrix["precision"] = ["float32"]
        notes.append(f"precision: float32, since {', '.join(single)} has nothing else")
    if "sampler" not in axes:
        precision = str(axes["precision"][0]) if "precision" in axes else "float32" if single else "float64"
        shader = axes["shader"][0] if "shader" in axes else None
        own = {name: _sampler(engine, loaded[0], precision, allowed, shader) for name, engine in engines.items()}
        if len(set(own.values())) == 1:
            matrix["sampler"] = [next(iter(own.values()))]
        else:
            zips.append({"engine": matrix.pop("engine"), "sampler": [*own.values()]})
            notes.append(f"sampler: {', '.join(f'{name} {sampler}' for name, sampler in own.items())}")
    written |= {"matrix": matrix, **({"zip": zips[0] if len(zips) == 1 else zips} if zips else {})}
    if len({lineage_of(engine) for engine in engines.values()}) > 1:
        # Too few images to show that engines draw the same: those that are not biased against the reference are ranked.
        written["division"] = "open"
    # A reference in the precision of the cells shares their compiled code; its rounding is far below any target.
    precisions = matrix.get("precision", [])
    reference = {"precision": "float32"} if precisions == ["float32"] else {}
    return {
        **written,
        "budget": {"max_time": "2s", "max_spp": 1 << 16, "stop_at_error": ERROR_SHARE * min(targets)},
        "repeats": 3,
        "remeasure": 0,
        "reference": {**reference, "certify": None},
        "quality": {"metric": "relmse", "targets": targets},
    }, notes


def _engines(named: Sequence[Any], allowed: tuple[bool, bool, bool]) -> dict[str, Engine]:
    """The engines by their names, of what stands for them in an experiment. Raises `ConfigError` as its reader does."""
    from engines.errors import ConfigError
    from engines.registry import engine
    from engines.schema.yaml_file import locate
    from harness.config.settings import ENGINE
    from harness.settings import require_commands, require_imports

    found: dict[str, Engine] = {}
    for name in (ENGINE.read(locate(each, "--engine", ConfigError)) for each in named):
        require_imports(name, allowed[0])
        require_commands(name, allowed[1])
        found[name] = engine(name)
    return found


def _scene(given: Any, allowed: tuple[bool, bool, bool]) -> Scene:
    from dataclasses import replace

    from engines.errors import ConfigError
    from engines.schema.yaml_file import locate
    from harness.config.settings import SceneKind

    file = SceneKind().read(locate(given, "SCENE", ConfigError))
    return replace(file, allow_outside=allowed[2]).load(allowed[0])


def _size(scene: Scene) -> tuple[int, int]:
    """Width and height of about `PIXELS`, in the shape of the scene's image and no larger."""
    width, height = scene.camera.resolution
    factor = min(1.0, math.sqrt(PIXELS / (width * height)))
    return max(1, round(width * factor)), max(1, round(height * factor))


def _why_not(
    engine: Engine, scene: Scene, sampler: str, precision: str, allowed: tuple[bool, bool, bool], shader: Any = None
) -> str | None:
    from engines.choices import Choice
    from harness.plan import answers
    from harness.settings import CellSettings

    width, height = scene.camera.resolution
    chosen = shader or scene.shader or "path_tracer"
    given = CellSettings(
        shader=Choice(chosen) if isinstance(chosen, str) else Choice.of(chosen),
        sampler=Choice(sampler),
        accelerator=Choice("auto"),
        precision=precision,
        threads=1,
        width=int(width),
        height=int(height),
    )
    return answers.why_not(engine, scene, given, allowed[0])


def _only_single(engines: Mapping[str, Engine], scenes: Sequence[Scene], allowed: tuple[bool, bool, bool]) -> list[str]:
    """The engines that render in float32 alone."""
    return [
        name
        for name, engine in engines.items()
        if any(
            _why_not(engine, scene, "random", "float64", allowed) and not _why_not(engine, scene, "random", "float32", allowed)
            for scene in scenes
        )
    ]


def _sampler(engine: Engine, scene: Scene, precision: str, allowed: tuple[bool, bool, bool], shader: Any) -> str:
    """The first of `SAMPLERS` that an engine has."""
    able = (name for name in SAMPLERS if not _why_not(engine, scene, name, precision, allowed, shader))
    return next(able, SAMPLERS[0])


def _save(file: Path, written: dict[str, Any]) -> None:
    """Writes the experiment, with the command that it stands for."""
    from engines.schema.yaml_file import yaml_text
    from harness.cli.outputs import check_file
    from harness.store import atomic

    check_file(file, (".yaml", ".yml"), "--save")
    atomic.write_text(file, f"# {shlex.join(['raybench', *sys.argv[1:]])}\n{yaml_text(written)}")
