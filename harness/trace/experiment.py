"""A file that compares rays becomes a `TraceExperiment`, whose fields say its keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from engines.choices import Choice
from engines.errors import ConfigError
from engines.schema.keys import Key, Record, Schema
from engines.schema.yaml_file import Located, locate
from harness.config.files import ConfigFile, read_file, top_level
from harness.config.keys import by_field, key, keys_of, written
from harness.config.kinds import DURATION, LINE, NAME, RECORDED, SEED, ListOf, OrNull, Value, integer, number, one_of, version
from harness.config.settings import ACCELERATOR, ENGINE, PRECISION, SceneFile, SceneKind
from harness.trace.rays import KINDS

TRACE = "raybench_trace"
VERSION = 1
ENGINES = ("numpy", "numba", "embree", "embreex_batch")
"""Those of a file that names none."""


@dataclass(frozen=True, slots=True)
class _OneOrMore:
    """A value of `kind`, or a list of at least one."""

    kind: Value

    def read(self, node: Located, context: Any = None) -> tuple[Any, ...]:
        return ListOf(self.kind, 1).read(node, context) if isinstance(node.value, list) else (self.kind.read(node, context),)

    def write(self, value: Any) -> list[Any]:
        return ListOf(self.kind).write(value)

    def schema(self) -> Schema:
        return {"anyOf": [self.kind.schema(), ListOf(self.kind, 1).schema()]}


class TraceContestant(NamedTuple):
    """What is compared: an engine with its settings."""

    engine: str
    accelerator: Choice
    precision: str | None
    threads: int

    def describe(self) -> dict[str, Any]:
        """The settings as plain data, as the request of a worker holds them."""
        return {"accelerator": self.accelerator.describe(), "precision": self.precision, "threads": self.threads}


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceExperiment:
    """A comparison of engines by the rays that they trace: one value, or a list of several, for each axis.

    `folder` is that of the file, where code that it names is looked for first; None for a command line.
    """

    name: str = key(LINE, "Title of the report, and name of the results folder; by default the name of the file.", None)
    question: str | None = key(LINE, "Question that the comparison answers.", None)
    scene: tuple[SceneFile, ...] = key(_OneOrMore(SceneKind()), "Scenes: names in scenes/, or paths beside the file.")
    rays: tuple[str, ...] = key(
        _OneOrMore(one_of(*KINDS)), "Sets of rays; shadow is answered by occluded, the others by trace.", [*KINDS]
    )
    engine: tuple[str, ...] = key(_OneOrMore(ENGINE), "Engines, as in experiments.", [*ENGINES])
    accelerator: tuple[Choice, ...] = key(
        _OneOrMore(ACCELERATOR), "Accelerators, as in experiments; an engine that lacks one is left out there.", ["auto"]
    )
    precision: tuple[str | None, ...] = key(_OneOrMore(PRECISION), "Precisions; null is the engine's own.", [None])
    threads: tuple[int, ...] = key(_OneOrMore(integer(1, 1024)), "Threads of the engines.", [1])
    count: int = key(integer(16, 10**8), "Rays per set.", 200_000)
    batch: int | None = key(OrNull(integer(1, 10**8)), "Rays per call; by default all in one.", None)
    bounces: int = key(integer(1, 64), "Bounces of the paths from whose hits incoherent rays start.", 3)
    checked: int = key(integer(0, 10**8), "Rays per set that are compared with exact answers; the whole set at most.", 10_000)
    hard: int = key(integer(0, 10**8), "Rays at edges and vertices that triangles share, by which leaks are counted.", 20_000)
    repeats: int = key(integer(1, 1000), "Blocks. Each measures every contestant once, in random order, in new processes.", 5)
    max_time_seconds: float = key(
        DURATION, "Time inside calls in a block: sets are traced again until it is reached.", "500ms", name="max_time"
    )
    timeout_seconds: float = key(
        DURATION, "Wall time after which the process of a contestant's block is killed.", "300s", name="timeout"
    )
    seed: int = key(SEED, "Seed of the rays and of the order.", 1)
    baseline: str | None = key(
        OrNull(NAME), "Engine that rates are compared with; by default the first that has results.", None
    )
    same_within: float = key(
        number(0.0, 1.0, open_low=True), "Largest difference of times that counts as the same, as a share.", 0.05
    )
    folder: Path | None = field(default=None, compare=False)

    @property
    def contestants(self) -> list[TraceContestant]:
        """Every engine with every accelerator, precision and number of threads."""
        return [TraceContestant(*each) for each in product(self.engine, self.accelerator, self.precision, self.threads)]

    def normalised(self) -> dict[str, Any]:
        """The whole as plain data that is a valid file, every default filled in."""
        return {TRACE: VERSION, **written(self)}


KEYS = Record(
    "A comparison of engines by the rays that they trace: one value, or a list of several, for each axis.",
    {TRACE: Key(version(VERSION), "Version of the format."), **keys_of(TraceExperiment)},
)


def trace_schema() -> Schema:
    """The JSON schema (draft 2020-12) of such files. It is no stricter than `load_trace`, which has the last word."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **KEYS.schema(),
        "title": "raybench trace",
        "patternProperties": {r"^\.": {}},
    }


def load_trace(given: str | Path | ConfigFile, overrides: Iterable[str] = ()) -> TraceExperiment:
    """The comparison of a path, bare name or file that was read, with `key=value` overrides applied."""
    file = given if isinstance(given, ConfigFile) else read_file(given)
    return _parsed(file.overridden(overrides), file.path.parent, file.path.stem)


def trace_of(options: Mapping[str, Any]) -> TraceExperiment:
    """The comparison of keys from the command line, whose messages name them."""
    return _parsed(locate({TRACE: VERSION, **options}, "", ConfigError), None, "trace")


def recorded_trace(data: Any, where: str) -> TraceExperiment:
    """The comparison of which `normalised` made `data`, perhaps on another machine: what it names is not looked up.

    Raises `ConfigError` about the key `config` of the file `where`.
    """
    return _parsed(locate({"config": data}, where, ConfigError).value["config"], RECORDED, "")


def _parsed(root: Located, context: Any, stem: str) -> TraceExperiment:
    given = KEYS.read(top_level(root), context)
    found = TraceExperiment(**by_field(TraceExperiment, given.values), folder=None if context is RECORDED else context)
    if found.baseline is not None and found.baseline not in found.engine:
        raise given.at("baseline").refuse(f"must be one of the engines: {', '.join(found.engine)}")
    return replace(
        found, name=found.name or stem, scene=tuple(dict.fromkeys(found.scene)), rays=tuple(dict.fromkeys(found.rays))
    )
