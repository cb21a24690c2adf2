"""The settings of a cell: how each is read from YAML, and how plain data becomes `engines.Settings`.

A name of the form `module:attribute` is code of the user's. It is imported only when imports are allowed, and is then
the plugin object itself, or a factory called with the options written beside the name.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from engines import choices
from engines.errors import ConfigError, RaybenchError, suggestion
from engines.interface import Settings
from engines.registry import engine as engine_of
from engines.registry import engine_names, is_file, known_names, load_attribute
from engines.scene.yaml_file import Located
from harness.config import paths, validators


@dataclass(frozen=True, slots=True)
class Budget:
    """When a cell ends: seconds inside `render`, samples per pixel, and wall time after which its process is killed."""

    max_time_seconds: float = 20.0
    max_spp: int = 1024
    timeout_seconds: float = 300.0

    def merged(self, changes: Mapping[str, Any]) -> Budget:
        return replace(self, **changes)


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A scene as an experiment names it: `name` in tables, `path` on disk."""

    name: str
    path: str

    @property
    def names(self) -> tuple[str, str]:
        """The names by which a filter finds it."""
        return self.name, Path(self.path).stem


Reader = Callable[[Located, Path], Any]


def _scene(node: Located, folder: Path) -> SceneFile:
    given = validators.text(node)
    try:
        path = paths.find("scenes", given, folder)
    except ConfigError as error:
        raise node.origin.error(f"{node.where}: {error}") from error
    bare = "/" not in given and not given.endswith((".yaml", ".yml"))
    return SceneFile(given if bare else path.stem, str(path))


def _engine(node: Located, folder: Path) -> str:
    given = validators.text(node)
    if is_file(given):
        for place in (folder, Path.cwd()):
            if os.path.isfile(file := os.path.join(place, os.path.expanduser(given))):
                return str(Path(file).resolve())
        raise node.refuse("there is no such file")
    if ":" not in given and given not in known_names():
        raise node.refuse(f"unknown engine: {suggestion(given, known_names())}")
    return given


def _named_choice(kind: str, table: Mapping[str, Mapping[str, choices.Option]] | None) -> Reader:
    def read(node: Located, folder: Path) -> dict[str, Any]:
        if not isinstance(node.value, (str, dict)):
            raise node.refuse(f"a {kind}'s name, or {{name: ..., option: value}}, is wanted")
        validators.finite(node)
        given = node.plain() if isinstance(node.value, dict) else {"name": validators.text(node)}
        if not isinstance(given.get("name"), str):
            raise node.refuse("the key 'name' is wanted")
        if table is None or ":" in given["name"]:
            return given
        try:
            return choices.resolve(kind, given, known(kind, given["name"], table)).describe()
        except RaybenchError as error:
            raise node.origin.error(f"{node.where}: {error}") from error

    return read


def known(kind: str, name: str, table: Mapping[str, Any]) -> Mapping[str, Any]:
    """`table`, with the samplers that single engines bring where it lacks a sampler's name."""
    return {**table, **samplers_of_engines()} if kind == "sampler" and name not in table else table


def samplers_of_engines() -> dict[str, Mapping[str, choices.Option]]:
    """Those that single engines bring, with their options; none of an engine that fails."""
    found: dict[str, Mapping[str, choices.Option]] = {}
    for name in engine_names():
        with contextlib.suppress(Exception, SystemExit):
            found |= getattr(engine_of(name), "samplers", dict)()
    return found


def _precision(node: Located, folder: Path) -> str | None:
    return None if node.value is None else validators.one_of("float64", "float32")(node)


def _budget(node: Located, folder: Path) -> dict[str, Any]:
    readers: dict[str, tuple[str, Callable[[Located], Any]]] = {
        "max_time": ("max_time_seconds", validators.duration),
        "max_spp": ("max_spp", validators.integer(1, 2**31)),
        "timeout": ("timeout_seconds", validators.duration),
    }
    found = validators.mapping(node, readers)
    return {readers[key][0]: readers[key][1](child) for key, child in found.items()}


SETTING_READERS: dict[str, Reader] = {
    "scene": _scene,
    "engine": _engine,
    "shader": _named_choice("shader", choices.SHADERS),
    "sampler": _named_choice("sampler", choices.SAMPLERS),
    "accelerator": _named_choice("accelerator", None),
    "precision": _precision,
    "threads": lambda node, folder: validators.integer(1, 1024)(node),
    "resolution": lambda node, folder: validators.resolution(node),
    "budget": _budget,
}

DEFAULTS: dict[str, Any] = {
    "shader": choices.resolve("shader", "path_tracer", choices.SHADERS).describe(),
    "sampler": choices.resolve("sampler", "sobol", choices.SAMPLERS).describe(),
    "accelerator": {"name": "auto"},
    "precision": None,
    "threads": 1,
    "resolution": None,
}


# --- towards the engines --------------------------------------------------------------------------------------------


def engine_settings(plain: Mapping[str, Any], seed: int, allow_imports: bool) -> Settings:
    """`engines.Settings` of a cell's plain data: shader, sampler, accelerator, precision, threads, width, height."""
    chosen = {kind: plugin_or_choice(plain[kind], allow_imports) for kind in ("shader", "sampler", "accelerator")}
    return Settings(
        width=plain["width"], height=plain["height"], threads=plain["threads"], precision=plain["precision"],
        seed=seed, **chosen,
    )  # fmt: skip


def plugin_or_choice(given: Mapping[str, Any], allow_imports: bool) -> Any:
    """The choice itself, or for `module:attribute` the object that it names."""
    if ":" not in given["name"]:
        return dict(given)
    require_imports(given["name"], allow_imports)
    found = load_attribute(given["name"])
    options = {key: value for key, value in given.items() if key != "name"}
    return found(**options) if options or isinstance(found, type) else found


def require_commands(name: str, allowed: bool) -> None:
    """Refuses an engine that is a program unless that was allowed on the command line."""
    if is_file(name) and not allowed:
        raise ConfigError(f"{name}: names a program to be run; run with --allow-commands if you trust it")


def require_imports(name: str, allowed: bool) -> None:
    """Refuses a name that would run the user's code unless that was allowed on the command line."""
    if ":" in name and not allowed:
        raise ConfigError(f"{name}: names code to be imported; run with --allow-imports if you trust it")
