"""The settings of an experiment's cells: the keys that describe, read and write them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from engines import choices
from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError, suggestion
from engines.registry import BUILT_IN, THIS, engine_names, interpreter, is_file, known_names, split
from engines.registry import engine as engine_of
from engines.scene import Scene, load_scene, names_a_file
from engines.schema.keys import Key, Schema
from engines.schema.kinds import Kind
from engines.schema.yaml_file import Located
from harness.config import paths
from harness.config.keys import Changes, Section, key, keys_of
from harness.config.kinds import DURATION, NAME, RECORDED, RESOLUTION, OrNull, finite, integer, mapping, number, one_of


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

    def load(self, allow_imports: bool) -> Scene:
        return load_scene(self.path, allow_imports, self.allow_outside, dict(self.parameters), natively=True)


def _parameters(node: Located) -> tuple[tuple[str, str], ...]:
    found = []
    for name, child in mapping(node).items():
        if not name.isidentifier() or isinstance(child.value, (dict, list, bool, type(None))):
            raise child.refuse("a number or a word is expected, under the name of a parameter")
        found.append((name, str(child.value)))
    return tuple(sorted(found))


@dataclass(frozen=True, slots=True, kw_only=True)
class _WithParameters:
    """A Mitsuba file, with values of its parameters."""

    file: str = key(NAME, "Path of the file beside the experiment, or a bare name.")
    parameters: tuple[tuple[str, str], ...] = key(
        Kind(_parameters, {"type": "object", "additionalProperties": {"type": ["number", "string"]}}, dict),
        "Values of $name in the file, by name.",
    )


_WITH_PARAMETERS = Section(_WithParameters)


class SceneKind:
    """A bare name from `scenes/`, a path beside `context`, the experiment's folder, or a mapping with parameters."""

    def read(self, node: Located, context: Any = None) -> SceneFile:
        if isinstance(node.value, dict):
            parameters = _WITH_PARAMETERS.read(node, context).parameters
            found = self.read(node.value["file"], context)
            values = ", ".join(f"{name}={value}" for name, value in parameters)
            return replace(found, name=f"{found.name} {values}", parameters=parameters)
        given = NAME.read(node)
        try:
            path = Path(given) if context is RECORDED else paths.find("scenes", given, context)
        except ConfigError as error:
            raise node.origin.error(f"{node.where}: {error}") from error
        bare = "/" not in given and not names_a_file(given)
        return SceneFile(given if bare else path.stem, str(path))

    def write(self, value: SceneFile) -> Any:
        """A bare name where that finds the file, else the path."""
        name = Path(value.path).stem
        file = name if paths.shipped_file("scenes", name) == Path(value.path) else paths.shown(Path(value.path))
        given = _WithParameters(file=file, parameters=value.parameters)
        return _WITH_PARAMETERS.write(given) if value.parameters else file

    def schema(self) -> Schema:
        return {"anyOf": [NAME.schema(), _WITH_PARAMETERS.schema()]}


class PythonKind:
    """A Python as `engines.registry` takes it behind an engine's name.

    A relative path is beside `context` or in the working directory, and $NAME is a variable of the environment: so a config
    need not name a place of one machine.
    """

    def read(self, node: Located, context: Any = None) -> str:
        text = NAME.read(node)
        if context is RECORDED:
            return text
        text = os.path.expandvars(text)
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

    def write(self, value: str) -> str:
        return value

    def schema(self) -> Schema:
        return NAME.schema()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Apart:
    """An engine in a process of its own, with a Python of the user's choice."""

    name: str = key(NAME, "Name of the engine, or module:attribute.")
    python: str = key(
        PythonKind(),
        "Folder of the virtual environment, or the Python, that runs the engine; `this` is raybench's own. "
        "$NAME stands for a variable of the environment.",
    )


_APART = Section(_Apart)


class EngineKind:
    """An engine's name, `module:attribute`, or a renderer's file beside `context` or in the working directory; or a mapping
    with a name and a Python, which becomes `name@python`."""

    def read(self, node: Located, context: Any = None) -> str:
        if isinstance(node.value, dict):
            apart = _APART.read(node, context)
            name = self.read(node.value["name"], context)
            if is_file(name):
                raise node.value["name"].refuse("a renderer's file names its own program: an engine in Python is expected")
            return f"{name}@{apart.python}"
        given = NAME.read(node)
        if context is RECORDED:
            return given
        if is_file(given):
            for place in (context or "", Path.cwd()):
                if os.path.isfile(file := os.path.join(place, os.path.expanduser(given))):
                    return str(Path(file).resolve())
            raise node.refuse("there is no such file")
        if ":" not in given and given not in BUILT_IN and given not in known_names():
            raise node.refuse(f"unknown engine: {suggestion(given, known_names())}")
        return given

    def write(self, value: str) -> Any:
        if is_file(value):
            return paths.shown(Path(value))
        name, python = split(value)
        return value if python is None else _APART.write(_Apart(name=name, python=python))

    def schema(self) -> Schema:
        apart = {**_APART.schema(), "title": "{name: ..., python: ...}"}
        return {"anyOf": [{"enum": known_names()}, {"type": "string", "pattern": r":|\.ya?ml$"}, apart]}


@dataclass(frozen=True, slots=True)
class ChoiceKind:
    """A name or `{name: ..., option: value}`; a `table` of names with their options checks all but `module:attribute`."""

    kind: str
    table: Mapping[str, Mapping[str, choices.Option]] | None = None

    def read(self, node: Located, context: Any = None) -> Choice:
        if not isinstance(node.value, (str, dict)):
            raise node.refuse(f"a {self.kind}'s name, or {{name: ..., option: value}}, is expected")
        finite(node)
        given = node.plain() if isinstance(node.value, dict) else {"name": NAME.read(node)}
        if not isinstance(given.get("name"), str):
            raise node.refuse("the key 'name' is expected")
        if self.table is None or ":" in given["name"] or context is RECORDED:
            return Choice.of(given)
        try:
            return choices.resolve(self.kind, given, known(self.kind, given["name"], self.table))
        except RaybenchError as error:
            raise node.origin.error(f"{node.where}: {error}") from error

    def write(self, value: Choice) -> dict[str, Any]:
        return {"name": value.name, **value.options}

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """When a cell ends. A budget in the matrix, an included cell or `extend` changes single keys of the one at the top."""

    max_time_seconds: float = key(
        DURATION, "Time inside render calls. The checkpoint that passes it is the last.", "20s", name="max_time"
    )
    max_spp: int = key(integer(1, 2**31), "Samples per pixel of the last checkpoint.", 1024)
    stop_at_error: float | None = key(
        OrNull(number(0.0, 1e30, open_low=True)),
        "Error, in the metric of targets, at which a cell ends before its budget is spent. Choose it well below the smallest "
        "target, as half of it: an error may pass a target by chance. Not on a cluster.",
        None,
    )
    timeout_seconds: float = key(
        DURATION, "Wall time after which a cell's process is killed; its checkpoints are kept.", "300s", name="timeout"
    )


BUDGET = Section(Budget)
ENGINE = EngineKind()
SHADER = ChoiceKind("shader", choices.SHADERS)
SAMPLER = ChoiceKind("sampler", choices.SAMPLERS)
ACCELERATOR = ChoiceKind("accelerator")
PRECISION = OrNull(one_of("float64", "float32"))
DIVISIONS = ("closed", "open")
RAY_KINDS = ("camera", "shadow", "incoherent")
"""Kinds of ray sets: see `harness.trace.rays`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """One value of every setting of a cell, in the order of its description."""

    scene: SceneFile = key(
        SceneKind(),
        "Name of a scene in scenes/, path of a scene file beside the experiment, or a Mitsuba file with parameters.",
        None,
    )
    engine: str = key(ENGINE, "Name of an engine (see `raybench list`), module:attribute, or file of a renderer.", None)
    rays: str | None = key(
        OrNull(one_of(*RAY_KINDS)),
        "Kind of rays that the cell traces, see `ray_sets`; null: it renders. With rays `shader`, `sampler`, `resolution` and "
        "the budget's `max_spp` mean nothing.",
        None,
    )
    shader: Choice | None = key(
        OrNull(SHADER),
        "Name of a shader, or {name: ..., option: value}; null: the one that the scene's file names, "
        "volumetric_path_tracer for other scenes with media, else path_tracer.",
        None,
    )
    sampler: Choice = key(SAMPLER, "Name of a sampler, or {name: ..., option: value}.", "sobol")
    accelerator: Choice = key(
        ACCELERATOR, "Name of an accelerator, or {name: ..., option: value}; auto lets the engine choose.", "auto"
    )
    precision: str | None = key(
        PRECISION,
        "Precision of the arithmetic; null is float64, or float32 for an engine that has nothing else; of rays: its own.",
        None,
    )
    threads: int = key(integer(1, 1024), "Threads of the engine.", 1)
    resolution: tuple[int, int] | None = key(
        RESOLUTION, "Width and height of the image, by default those of the scene.", None, unit="pixels"
    )
    division: str = key(
        one_of(*DIVISIONS),
        "Division in which the contestant is ranked. closed: the same estimator with the same image. open: anything whose "
        "image is not biased against the reference.",
        "closed",
    )
    budget: Budget = key(BUDGET, default={})


SETTINGS: dict[str, Key] = keys_of(Combination)
SETTINGS["budget"] = replace(SETTINGS["budget"], kind=Changes(BUDGET))
"""The keys of a cell. At the top level of a file a default stands for one left out; budgets are merged."""
