"""Arguments and options that several commands have, and what they share: completion, sizes, help without `<bool>`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from harness.cli.former import renamed, translated

DEFAULT_ENGINE = "numba"
"""The engine of `render` and `view`; their threads are all usable cores."""


def _untyped(params: list[Any]) -> list[Any]:
    """Parameters of which the flags show no type in the help: they take no value."""
    for param in params:
        if getattr(param, "is_flag", False):
            param.metavar = ""
    return params


class Command(TyperCommand):
    """A command whose help gives flags no type, and that takes former options."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _untyped(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, [renamed(word) for word in args])


def given(context: Any) -> set[str]:
    """The names of the parameters that the command line has."""
    return {name for name in context.params if context.get_parameter_source(name).name == "COMMANDLINE"}


def names(texts: Sequence[str] | None) -> list[str]:
    """The names in a list option: separated by commas, given once or several times."""
    return [name.strip() for text in texts or () for name in text.split(",") if name.strip()]


class Group(TyperGroup):
    """The program, whose help gives flags no type, and that takes former commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _untyped(super().get_params(ctx))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        return super().resolve_command(ctx, translated(args))

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = _reason(error.__cause__) or error.message
            raise


BOUNDS = {"greater_than_equal": ("ge", "at least"), "less_than_equal": ("le", "at most")}
"""Kinds of pydantic's errors: the key of the bound, and words."""


def _reason(cause: BaseException | None) -> str | None:
    """What pydantic says of a number, with the value that was given; None of anything else."""
    errors = getattr(cause, "errors", None)
    error = errors()[0] if errors else {}
    kind = error.get("type", "")
    if kind in BOUNDS:
        key, bound = BOUNDS[kind]
        return f"{error['input']}: must be {bound} {error['ctx'][key]}"
    expected = {"int_parsing": "an integer", "float_parsing": "a number"}.get(kind)
    return f"{error['input']!r}: must be {expected}" if expected else None


def shipped(kind: str) -> Callable[[str], list[str]]:
    """Completes the names of the scenes or configs that come with raybench."""

    def complete(incomplete: str) -> list[str]:
        from harness.config import paths

        return [name for name in paths.shipped(kind) if name.startswith(incomplete)]

    return complete


def engines(incomplete: str) -> list[str]:
    """Completes the names of engines."""
    from engines.registry import engine_names

    return [name for name in engine_names() if name.startswith(incomplete)]


def engine_lists(incomplete: str) -> list[str]:
    """Completes the last name of a list of engines, as `numpy,numba`."""
    before, comma, last = incomplete.rpartition(",")
    return [before + comma + name for name in engines(last)]


def words(*names: str) -> Callable[[str], list[str]]:
    """Completes one of a few words."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def choices(table: str) -> Callable[[str], list[str]]:
    """Completes the names in a table of `engines.choices`, or of tone mappers."""

    def complete(incomplete: str) -> list[str]:
        from engines import choices, tonemap

        names = tonemap.TONE_MAPPERS if table == "TONE_MAPPERS" else getattr(choices, table)
        return [name for name in names if name.startswith(incomplete)]

    return complete


def parameters_of(definitions: Sequence[str] | None) -> dict[str, str]:
    """Values of a Mitsuba file's parameters by name, from texts `name=value`. Raises `ConfigError`."""
    from engines.errors import ConfigError

    values: dict[str, str] = {}
    for text in definitions or ():
        name, equals, value = text.partition("=")
        if not (name.isidentifier() and equals):
            raise ConfigError(f"-D {text}: must look like name=value")
        if name in values:
            raise ConfigError(f"-D {text}: {name} is given twice")
        values[name] = value
    return values


def parse_size(text: str) -> tuple[int, int]:
    """Width and height in pixels, from `256x192`. Raises `ConfigError`."""
    from engines.errors import ConfigError
    from harness.config.kinds import width_and_height

    size = width_and_height(text)
    if size is None:
        raise ConfigError(f"--size {text}: width and height are expected, as 256x192")
    return size


Config = Annotated[
    str,
    typer.Argument(
        metavar="CONFIG", help="An experiment: a path, or a bare name from configs/.", autocompletion=shipped("configs")
    ),
]
Scene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A scene: a path (.yaml, Mitsuba's .xml, .glb, .gltf, or a mesh: .obj, .ply, .stl), or a bare name from scenes/.",
        autocompletion=shipped("scenes"),
    ),
]
Size = Annotated[Any, typer.Option(parser=parse_size, metavar="WxH", help="Pixels.")]
Threads = Annotated[int | None, typer.Option(help="Number of threads.", show_default="every core")]
Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="A results folder.")]
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="DIR", file_okay=False, help="Results folder.", show_default="results/<name>"),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a key: --set budget.max_time=5s. May be repeated."),
]


def _keep_references(folder: Path | None) -> Path | None:
    if folder is not None:
        os.environ["RAYBENCH_REFERENCES"] = str(folder)
    return folder


References = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        file_okay=False,
        callback=_keep_references,
        help="Folder of references; by default $RAYBENCH_REFERENCES, or else raybench/references in the user's cache.",
    ),
]
AllowImports = Annotated[
    bool, typer.Option("--allow-imports", help="Import code that files name as module:attribute. Only if you trust it.")
]

AllowCommands = Annotated[
    bool, typer.Option("--allow-commands", help="Run the programs that renderers' files name. Only if you trust them.")
]
AllowOutside = Annotated[bool, typer.Option("--allow-outside", help="Read files that the scene names outside of its folder.")]
Define = Annotated[
    list[str] | None,
    typer.Option("-D", metavar="NAME=VALUE", help="Set the parameter $NAME of a Mitsuba file. May be repeated."),
]
