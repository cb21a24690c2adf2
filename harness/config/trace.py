"""A file that compares rays becomes a `TraceExperiment`. `KEYS` describes its keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.schema.keys import Key, Readable, Record, Schema
from engines.schema.kinds import Kind
from engines.schema.yaml_file import Located, locate, read_yaml
from harness.config import paths
from harness.config.experiment import override
from harness.config.sections import SEED
from harness.config.settings import ChoiceKind, EngineKind, SceneFile, SceneKind
from harness.config.validators import DURATION, LINE, NAME, ListOf, OrNull, integer, mapping, number, one_of
from harness.trace.rays import KINDS

TRACE = "raybench_trace"
VERSION = 1
ENGINES = ("numpy", "numba", "embree", "embreex_batch")
"""Those of a file that names none."""


def _version(node: Located) -> int:
    if node.value != VERSION or node.value is True:
        raise node.refuse(f"must be {VERSION}")
    return VERSION


@dataclass(frozen=True, slots=True)
class _OneOrMore:
    """A value of `kind`, or a list of at least one."""

    kind: Readable

    def read(self, node: Located, context: Any = None) -> list[Any]:
        return ListOf(self.kind, 1).read(node, context) if isinstance(node.value, list) else [self.kind.read(node, context)]

    def schema(self) -> Schema:
        return {"anyOf": [self.kind.schema(), ListOf(self.kind, 1).schema()]}


def _axis(kind: Readable, meaning: str, default: Any = ...) -> Key:
    return Key(_OneOrMore(kind), meaning, default)


KEYS = Record(
    "A comparison of engines by the rays that they trace: one value, or a list of several, for each axis.",
    {
        TRACE: Key(Kind(_version, {"const": VERSION}), "Version of the format."),
        "name": Key(LINE, "Title of the report, and name of the results folder; by default the name of the file.", None),
        "question": Key(LINE, "Question that the comparison answers.", None),
        "scene": _axis(SceneKind(), "Scenes: names in scenes/, or paths beside the file."),
        "rays": _axis(one_of(*KINDS), "Sets of rays; shadow is answered by occluded, the others by trace.", [*KINDS]),
        "engine": _axis(EngineKind(), "Engines, as in experiments.", [*ENGINES]),
        "accelerator": _axis(
            ChoiceKind("accelerator"), "Accelerators, as in experiments; an engine that lacks one is left out there.", ["auto"]
        ),
        "precision": _axis(OrNull(one_of("float64", "float32")), "Precisions; null is the engine's own.", [None]),
        "threads": _axis(integer(1, 1024), "Threads of the engines.", [1]),
        "count": Key(integer(16, 10**8), "Rays per set.", 200_000),
        "batch": Key(OrNull(integer(1, 10**8)), "Rays per call; by default all in one.", None),
        "bounces": Key(integer(1, 64), "Bounces of the paths from whose hits incoherent rays start.", 3),
        "checked": Key(integer(0, 10**8), "Rays per set that are compared with exact answers; the whole set at most.", 10_000),
        "hard": Key(integer(0, 10**8), "Rays at edges and vertices that triangles share, by which leaks are counted.", 20_000),
        "repeats": Key(integer(1, 1000), "Blocks. Each measures every contestant once, in random order, in new processes.", 5),
        "max_time": Key(DURATION, "Time inside calls in a block: sets are traced again until it is reached.", "500ms"),
        "timeout": Key(DURATION, "Wall time after which the process of a contestant's block is killed.", "300s"),
        "seed": Key(SEED, "Seed of the rays and of the order.", 1),
        "baseline": Key(OrNull(NAME), "Engine that rates are compared with; by default the first that has results.", None),
        "same_within": Key(
            number(0.0, 1.0, open_low=True), "Largest difference of times that counts as the same, as a share.", 0.05
        ),
    },
)


@dataclass(frozen=True, slots=True)
class TraceExperiment:
    """What a file asks for. `contestants`: engine, accelerator, precision and threads of each."""

    name: str
    question: str
    scenes: tuple[SceneFile, ...]
    rays: tuple[str, ...]
    contestants: tuple[Mapping[str, Any], ...]
    count: int
    batch: int | None
    bounces: int
    checked: int
    hard: int
    repeats: int
    max_time_seconds: float
    timeout_seconds: float
    seed: int
    baseline: str | None
    same_within: float
    folder: Path | None
    """That of the file, where code that it names is looked for first; None for a command line."""

    def describe(self) -> dict[str, Any]:
        """The whole as plain data."""
        plain = {key: getattr(self, key) for key in self.__dataclass_fields__ if key not in ("scenes", "contestants", "folder")}
        scenes = [{"name": each.name, "path": paths.shown(Path(each.path))} for each in self.scenes]
        return {**plain, "scenes": scenes, "contestants": [dict(each) for each in self.contestants]}


def trace_schema() -> Schema:
    """The JSON schema (draft 2020-12) of such files. It is no stricter than `load_trace`, which has the last word."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **KEYS.schema(),
        "title": "raybench trace",
        "patternProperties": {r"^\.": {}},
    }


def is_trace(path: Path) -> bool:
    """Whether a file of configs/ compares rays."""
    try:
        root = read_yaml(path, ConfigError)
    except ConfigError:
        return False
    return isinstance(root.value, dict) and TRACE in root.value


def load_trace(given: str | Path, overrides: Iterable[str] = ()) -> TraceExperiment:
    """The comparison of a path or bare name, with `key=value` overrides applied."""
    path = paths.find("configs", str(given))
    root = read_yaml(path, ConfigError, paths.shown(path))
    for text in overrides:
        root = override(root, text)
    return _parsed(root, path.parent, path.stem)


def trace_of(options: Mapping[str, Any]) -> TraceExperiment:
    """The comparison of keys from the command line, whose messages name them."""
    return _parsed(locate({TRACE: VERSION, **options}, "", ConfigError), None, "trace")


def _parsed(root: Located, folder: Path | None, stem: str) -> TraceExperiment:
    top = {key: node for key, node in mapping(root).items() if not key.startswith(".")}
    given = KEYS.read(replace(root, value=top), folder)
    axes = ("engine", "accelerator", "precision", "threads")
    chosen = product(*(given[key] for key in axes))
    contestants: list[dict[str, Any]] = [dict(zip(axes, values, strict=True)) for values in chosen]
    same = ("count", "batch", "bounces", "checked", "hard", "repeats", "seed", "baseline", "same_within")
    if given["baseline"] is not None and given["baseline"] not in given["engine"]:
        raise given.at("baseline").refuse(f"must be one of the engines: {', '.join(given['engine'])}")
    return TraceExperiment(
        name=given["name"] or stem,
        question=given["question"] or "",
        scenes=tuple(dict.fromkeys(given["scene"])),
        rays=tuple(dict.fromkeys(given["rays"])),
        contestants=tuple(contestants),
        max_time_seconds=given["max_time"],
        timeout_seconds=given["timeout"],
        folder=folder,
        **{key: given[key] for key in same},
    )
