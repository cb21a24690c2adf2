"""`raybench list`: everything that can be named in an experiment or on the command line."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from engines import engine_names
from engines.choices import SAMPLERS, SHADERS
from engines.errors import RaybenchError
from engines.registry import engine
from engines.tonemap import TONE_MAPPERS
from harness.config import paths
from harness.console import consoles


def show() -> None:
    """Prints the lists. An engine that cannot be loaded is listed with the reason."""
    console = consoles()[0]
    accelerators: dict[str, Mapping[str, Any]] = {}
    samplers: dict[str, Mapping[str, Any]] = {}
    shaders: dict[str, Mapping[str, Any]] = {}
    engines = _table("engines", "", "", "")
    for name in engine_names():
        try:
            loaded = engine(name)
            accelerators[name] = loaded.accelerators()
            samplers[name] = getattr(loaded, "samplers", dict)()
            shaders[name] = getattr(loaded, "shaders", dict)()
            engines.add_row(name, _version(loaded.version), _first_sentence(loaded))
        except RaybenchError as error:
            engines.add_row(name, "", f"cannot be loaded: {escape(str(error))}")
        except Exception as error:  # what others wrote may fail in any way
            engines.add_row(name, "", f"fails: {escape(f'{type(error).__name__}: {error}')}")
    console.print(engines)
    for title, table in (("shaders", SHADERS), ("samplers", SAMPLERS)):
        _options(console, title, table)
    for kind, tables in (("shaders", shaders), ("samplers", samplers)):
        for name, table in tables.items():
            if table:
                _options(console, f"{kind} of {name} alone", table)
    for name, table in accelerators.items():
        _options(console, f"accelerators of {name}", table)
    console.print(f"\n[bold]tone mappers[/]\n  {', '.join(TONE_MAPPERS)}")
    scenes = _table("scenes", "", "")
    for name, path in paths.shipped("scenes").items():
        scenes.add_row(name, str(path))
    console.print(scenes)
    experiments = _table("experiments", "", "")
    for name, path in paths.shipped("configs").items():
        experiments.add_row(name, _question(path))
    console.print(experiments)


def print_schema(kind: str) -> None:
    """Prints the JSON schema of a kind of file, experiment or scene."""
    import json

    import typer

    from engines.errors import UnknownName
    from engines.scene import scene_schema
    from harness.config import experiment_schema

    schemas = {"experiment": experiment_schema, "scene": scene_schema}
    if kind not in schemas:
        raise UnknownName("kind of file", kind, schemas)
    typer.echo(json.dumps(schemas[kind](), indent=2))


def _version(version: str) -> str:
    """An adapter's version is followed by that of its package."""
    own, _, package = version.partition("+")
    return f"version {own}, package not installed" if package == "none" else f"version {version}"


def _first_sentence(engine: Any) -> str:
    """What an engine says of itself; of an engine in a process of its own, what its class says."""
    text = " ".join((inspect.getdoc(type(getattr(engine, "local", engine))) or "").split("\n\n")[0].split())
    return escape(re.split(r"(?<=\.)\s(?=[A-Z])", text)[0].rstrip("."))


def _table(title: str, *columns: str) -> Table:
    heading = f"\n[bold]{title}[/]"
    return Table(*columns, title=heading, title_justify="left", title_style="", box=None, show_header=False)


def _options(console: Console, title: str, table: Mapping[str, Any]) -> None:
    shown = _table(title, "", "", "", "")
    for name, options in table.items():
        shown.add_row(name, "", "", "")
        for key, option in options.items():
            shown.add_row("", key, f"default {option.default!r}", option.meaning)
    console.print(shown)


def _question(path: Any) -> str:
    """The question that an experiment says it answers."""
    from engines.errors import ConfigError
    from engines.schema.yaml_file import read_yaml

    try:
        root = read_yaml(path, ConfigError).value
    except RaybenchError as error:
        return str(error)
    return str(root["question"].value) if isinstance(root, dict) and "question" in root else str(path)
