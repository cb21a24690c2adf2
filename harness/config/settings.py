"""The settings of a cell: the keys that describe and read them, and how plain data becomes `engines.Settings`.

A name of the form `module:attribute` is code of the user's. It is imported only when imports are allowed, and is then
the plugin object itself, some of whose options the mapping changes, or a class or function called with the options.
"""

from __future__ import annotations

import contextlib
import inspect
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from engines import choices
from engines.errors import ConfigError, RaybenchError, UnknownName, suggestion
from engines.interface import Settings
from engines.registry import BUILT_IN, THIS, engine_names, interpreter, is_file, known_names, load_attribute, names_a_program
from engines.registry import engine as engine_of
from engines.scene import Scene, load_scene
from engines.schema.keys import Key, Record, Schema
from engines.schema.kinds import Kind
from engines.schema.yaml_file import Located, locate
from harness.config import paths
from harness.config.validators import DURATION, NAME, RESOLUTION, Checked, OrNull, finite, integer, mapping, one_of


@dataclass(frozen=True, slots=True)
class Budget:
    """When a cell ends: seconds inside `render`, samples per pixel, and wall time after which its process is killed."""

    max_time_seconds: float
    max_spp: int
    timeout_seconds: float

    def merged(self, changes: Mapping[str, Any]) -> Budget:
        return replace(self, **changes)


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A scene as an experiment names it: `name` in tables, `path` on disk, names and values of a Mitsuba file's parameters, and
    whether files outside of its folder may be read."""

    name: str
    path: str
    parameters: tuple[tuple[str, str], ...] = ()
    allow_outside: bool = False

    @property
    def names(self) -> tuple[str, str]:
        """The names by which a filter finds it."""
        return self.name, Path(self.path).stem

    @property
    def options(self) -> dict[str, Any]:
        """What a request of a worker says beside its path."""
        parameters = {"scene_parameters": dict(self.parameters)} if self.parameters else {}
        return {**parameters, **({"allow_outside": True} if self.allow_outside else {})}

    def load(self, allow_imports: bool) -> Scene:
        return load_scene(self.path, allow_imports, self.allow_outside, dict(self.parameters), natively=True)


def _parameters(node: Located) -> tuple[tuple[str, str], ...]:
    found = []
    for name, child in mapping(node).items():
        if not name.isidentifier() or isinstance(child.value, (dict, list, bool, type(None))):
            raise child.refuse("a number or a word is expected, under the name of a parameter")
        found.append((name, str(child.value)))
    return tuple(sorted(found))


_SCENE = Record(
    "A Mitsuba file, with values of its parameters.",
    {
        "file": Key(NAME, "Path of the file beside the experiment, or a bare name."),
        "parameters": Key(
            Kind(_parameters, {"type": "object", "additionalProperties": {"type": ["number", "string"]}}),
            "Values of $name in the file, by name.",
        ),
    },
)


class SceneKind:
    """A bare name from `scenes/`, a path beside `context`, the experiment's folder, or a mapping with parameters."""

    def read(self, node: Located, context: Any = None) -> SceneFile:
        if isinstance(node.value, dict):
            given = _SCENE.read(node, context)
            found, parameters = self.read(given.at("file"), context), given["parameters"]
            values = ", ".join(f"{name}={value}" for name, value in parameters)
            return replace(found, name=f"{found.name} {values}", parameters=parameters)
        given = NAME.read(node)
        try:
            path = paths.find("scenes", given, context)
        except ConfigError as error:
            raise node.origin.error(f"{node.where}: {error}") from error
        bare = "/" not in given and not given.endswith((".yaml", ".yml", ".xml"))
        return SceneFile(given if bare else path.stem, str(path))

    def schema(self) -> Schema:
        return {"anyOf": [NAME.schema(), _SCENE.schema()]}


class PythonKind:
    """A Python as `engines.registry` takes it behind an engine's name.

    A relative path is beside `context` or in the working directory, and $NAME is a variable of the environment: so a config
    need not name a place of one machine.
    """

    def read(self, node: Located, context: Any = None) -> str:
        text = os.path.expandvars(NAME.read(node))
        if "$" in text:
            raise node.refuse("the variable is not set: the folder of a virtual environment, or a Python, is expected")
        if text == THIS:
            return text
        places = [os.path.join(place, os.path.expanduser(text)) for place in (context or "", Path.cwd())]
        found = os.path.abspath(next(filter(os.path.exists, places), places[-1]))
        try:
            interpreter(found)
        except ConfigError as error:
            raise node.origin.error(f"{node.where} = {node.value!r}: {error}") from error
        return found

    def schema(self) -> Schema:
        return NAME.schema()


_APART = Record(
    "An engine in a process of its own, with a Python of the user's choice.",
    {
        "name": Key(NAME, "Name of the engine, or module:attribute."),
        "python": Key(
            PythonKind(),
            "Folder of the virtual environment, or the Python, that runs the engine; `this` is raybench's own. "
            "$NAME stands for a variable of the environment.",
        ),
    },
)


class EngineKind:
    """An engine's name, `module:attribute`, or a renderer's file beside `context` or in the working directory; or a mapping
    with a name and a Python, which becomes `name@python`."""

    def read(self, node: Located, context: Any = None) -> str:
        if isinstance(node.value, dict):
            given = _APART.read(node, context)
            name = self.read(given.at("name"), context)
            if is_file(name):
                raise given.at("name").refuse("a renderer's file names its own program: an engine in Python is expected")
            return f"{name}@{given['python']}"
        given = NAME.read(node)
        if is_file(given):
            for place in (context or "", Path.cwd()):
                if os.path.isfile(file := os.path.join(place, os.path.expanduser(given))):
                    return str(Path(file).resolve())
            raise node.refuse("there is no such file")
        if ":" not in given and given not in BUILT_IN and given not in known_names():
            raise node.refuse(f"unknown engine: {suggestion(given, known_names())}")
        return given

    def schema(self) -> Schema:
        apart = {**_APART.schema(), "title": "{name: ..., python: ...}"}
        return {"anyOf": [{"enum": known_names()}, {"type": "string", "pattern": r":|\.ya?ml$"}, apart]}


@dataclass(frozen=True, slots=True)
class ChoiceKind:
    """A name or `{name: ..., option: value}`; a `table` of names with their options checks all but `module:attribute`."""

    kind: str
    table: Mapping[str, Mapping[str, choices.Option]] | None = None

    def read(self, node: Located, context: Any = None) -> dict[str, Any]:
        if not isinstance(node.value, (str, dict)):
            raise node.refuse(f"a {self.kind}'s name, or {{name: ..., option: value}}, is expected")
        finite(node)
        given = node.plain() if isinstance(node.value, dict) else {"name": NAME.read(node)}
        if not isinstance(given.get("name"), str):
            raise node.refuse("the key 'name' is expected")
        if self.table is None or ":" in given["name"]:
            return given
        try:
            return choices.resolve(self.kind, given, known(self.kind, given["name"], self.table)).describe()
        except RaybenchError as error:
            raise node.origin.error(f"{node.where}: {error}") from error

    def schema(self) -> Schema:
        names = {*(self.table or ()), *(of_engines(self.kind) if self.table else ())}
        name = {"anyOf": [{"enum": sorted(names)}, {"type": "string", "pattern": ":"}]} if names else NAME.schema()
        named = {"name": {**name, "description": f"Name of the {self.kind}; other keys are options."}}
        return {"anyOf": [name, {"type": "object", "required": ["name"], "properties": named}]}


def known(kind: str, name: str, table: Mapping[str, Any]) -> Mapping[str, Any]:
    """`table`, with the samplers or shaders that single engines bring where it lacks a name."""
    return {**table, **of_engines(kind)} if kind in ("sampler", "shader") and name not in table else table


def of_engines(kind: str) -> dict[str, Mapping[str, choices.Option]]:
    """The samplers or shaders that single engines bring, with their options; none of an engine that fails."""
    found: dict[str, Mapping[str, choices.Option]] = {}
    for name in engine_names():
        with contextlib.suppress(Exception, SystemExit):
            found |= getattr(engine_of(name), f"{kind}s", dict)()
    return found


def _changes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the keys of a budget by fields of `Budget`."""
    return {key if key == "max_spp" else f"{key}_seconds": value for key, value in values.items()}


_BUDGET = Record(
    "When a cell ends. A budget in the matrix, an included cell or `extend` changes single keys of the one at the top.",
    {
        "max_time": Key(DURATION, "Time inside render calls. The checkpoint that passes it is the last.", "20s"),
        "max_spp": Key(integer(1, 2**31), "Samples per pixel of the last checkpoint.", 1024),
        "timeout": Key(DURATION, "Wall time after which a cell's process is killed; its checkpoints are kept.", "300s"),
    },
)
BUDGET = Budget(**_changes(_BUDGET.read(locate({})).values))
"""That of a file that gives none."""

CHOICES = ("shader", "sampler", "accelerator")
"""Settings that have options."""
DIVISIONS = ("closed", "open")
SETTINGS = {
    "scene": Key(
        SceneKind(),
        "Name of a scene in scenes/, path of a scene file beside the experiment, or a Mitsuba file with parameters.",
        None,
    ),
    "engine": Key(EngineKind(), "Name of an engine (see `raybench list`), module:attribute, or file of a renderer.", None),
    "shader": Key(ChoiceKind("shader", choices.SHADERS), "Name of a shader, or {name: ..., option: value}.", "path_tracer"),
    "sampler": Key(ChoiceKind("sampler", choices.SAMPLERS), "Name of a sampler, or {name: ..., option: value}.", "sobol"),
    "accelerator": Key(
        ChoiceKind("accelerator"), "Name of an accelerator, or {name: ..., option: value}; auto lets the engine choose.", "auto"
    ),
    "precision": Key(
        OrNull(one_of("float64", "float32")),
        "Precision of the arithmetic; null is float64, or float32 for an engine that has nothing else.",
        None,
    ),
    "threads": Key(integer(1, 1024), "Threads of the engine.", 1),
    "resolution": Key(RESOLUTION, "Width and height of the image, by default those of the scene.", None, unit="pixels"),
    "division": Key(
        one_of(*DIVISIONS),
        "Division in which the contestant is ranked. closed: the same estimator with the same image. open: anything whose "
        "image is not biased against the reference.",
        "closed",
    ),
    "budget": Key(Checked(mapping, replace(_BUDGET, make=lambda given, context: _changes(given.written))), _BUDGET.meaning, {}),
}
"""The keys of a cell, in the order of its description. At the top level of a file a default stands for one left out."""


# --- towards the engines --------------------------------------------------------------------------------------------


def engine_settings(plain: Mapping[str, Any], seed: int, allow_imports: bool) -> Settings:
    """`engines.Settings` of a cell's plain data: shader, sampler, accelerator, precision, threads, width, height."""
    chosen = {kind: plugin_or_choice(kind, plain[kind], allow_imports) for kind in CHOICES}
    return Settings(
        width=plain["width"],
        height=plain["height"],
        threads=plain["threads"],
        precision=plain["precision"],
        seed=seed,
        **chosen,
    )


def plugin_or_choice(kind: str, given: Mapping[str, Any], allow_imports: bool) -> Any:
    """The choice itself, or for `module:attribute` the plugin that it names, with its options."""
    return _plugin(kind, given, allow_imports)[0] if ":" in given["name"] else dict(given)


def completed(kind: str, given: Mapping[str, Any], allow_imports: bool) -> dict[str, Any]:
    """A choice with all options of the plugin that it names: what identifies it, whether or not defaults are written."""
    return _plugin(kind, given, allow_imports)[1] if ":" in given["name"] else dict(given)


def _plugin(kind: str, given: Mapping[str, Any], allow_imports: bool) -> tuple[Any, dict[str, Any]]:
    """What an engine gets for a `module:attribute`, and its description."""
    name, options = given["name"], {key: value for key, value in given.items() if key != "name"}
    require_imports(name, allow_imports)
    found = load_attribute(name)
    if isinstance(found, type) or (callable(found) and not hasattr(found, "name")):
        try:
            options = _arguments(f"{kind} {name!r}", found, options)
            return found(**options), {"name": name, **options}
        except RaybenchError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigError(f"{kind} {name}: cannot be created: {type(error).__name__}: {error}") from error
    choice = choices.resolve(kind, {"name": found, **options}, {})
    return choice, {"name": name, **choice.options}


def _arguments(what: str, make: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of a class or function that makes a plugin: `options`, and defaults for those that are left out."""
    parameters = list(inspect.signature(make).parameters.values())
    known = {each.name: each.default for each in parameters if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)}
    for key in options:
        if key not in known and not any(each.kind is each.VAR_KEYWORD for each in parameters):
            raise UnknownName(f"option of {what}", key, known)
    for key, default in known.items():
        if default is inspect.Parameter.empty and key not in options:
            raise ConfigError(f"{what}: the option {key!r} is missing")
    numbers = {key: value.item() if isinstance(value, np.generic) else value for key, value in known.items()}
    plain = {key: value for key, value in numbers.items() if isinstance(value, (bool, int, float, str, type(None)))}
    return {**plain, **options}


def require_commands(name: str, allowed: bool) -> None:
    """Refuses an engine that is a program, or for which one is named, unless that was allowed on the command line."""
    if names_a_program(name) and not allowed:
        raise ConfigError(f"{name}: names a program to be run; run with --allow-commands if you trust it")


def require_imports(name: str, allowed: bool) -> None:
    """Refuses a name that would run the user's code unless that was allowed on the command line."""
    if ":" in name and not allowed:
        raise ConfigError(f"{name}: names code to be imported; run with --allow-imports if you trust it")
