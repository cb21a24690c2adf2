"""trace.json: what a comparison by rays has measured, as plain data with the version of the format."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from engines.errors import ConfigError
from engines.input_files import open_regular
from harness.trace.experiment import TraceExperiment, recorded_trace

FILE = "trace.json"
FORMAT_VERSION = 3
Count = Annotated[int, Field(ge=0, le=2**62)]
Seconds = Annotated[float, Field(ge=0, le=1e10)]


class _Record(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")


class Timing(_Record):
    """A block of a contestant: `seconds` of wall time and `cpu_seconds` of processor time of `passes` over the set."""

    block: Count
    order: Count
    passes: Annotated[int, Field(ge=1)]
    seconds: Annotated[float, Field(gt=0, le=1e10)]
    cpu_seconds: Seconds | None
    contended: bool
    load_seconds: Seconds
    build_seconds: Seconds
    first_call_seconds: Seconds


class Answers(_Record):
    """What was wrong with the answers to `checked` rays and to `hard` ones, and quantiles of the relative error of t."""

    checked: Count
    wrong: Count
    missed: Count
    false_hits: Count
    hard: Count
    leaks: Count
    t_median: float | None = None
    t_p999: float | None = None
    t_worst: float | None = None

    @property
    def faults(self) -> int:
        """Answers that are wrong in any way."""
        return self.wrong + self.missed + self.false_hits


class Entry(_Record):
    """A contestant with one set of rays of one scene. `twin`: it is another's A/A twin. `unstable`: its answers were not the
    same in all blocks."""

    scene: str
    primitives: Count
    rays: str
    count: Count
    engine: str
    version: str = ""
    accelerator: str
    precision: str | None
    threads: Annotated[int, Field(ge=1)]
    twin: bool = False
    baseline: bool = False
    state: Literal["done", "failed", "timeout", "skipped"]
    message: str = ""
    unstable: bool = False
    answers: Answers | None = None
    timings: list[Timing] = []

    @property
    def race(self) -> tuple[str, str, int]:
        """Contestants are compared where these are the same."""
        return self.scene, self.rays, self.threads


class TraceResults(_Record):
    """A whole file."""

    raybench_trace_results: Literal[3] = FORMAT_VERSION
    name: str
    time: str
    command: list[str] = []
    config: dict[str, Any]
    machine: dict[str, Any]
    entries: list[Entry]

    @property
    def experiment(self) -> TraceExperiment:
        """What was compared. Raises `ConfigError` where `config` is no comparison by rays."""
        return recorded_trace(self.config, "trace.json")


def text_of(results: TraceResults) -> str:
    """The file's text."""
    return json.dumps(results.model_dump(mode="json"), indent=1, allow_nan=False) + "\n"


def read_trace(path: Path) -> TraceResults:
    """The results in a trace.json. Raises `ConfigError` for what is none, and for one of another format version."""
    try:
        with open_regular(path) as file:
            data = json.loads(file.read())
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read as JSON: {error}") from error
    version = data.get("raybench_trace_results") if isinstance(data, dict) else None
    if type(version) is not int:
        raise ConfigError(f"{path}: not results of raybench trace: the key 'raybench_trace_results' is missing")
    if version != FORMAT_VERSION:
        raise ConfigError(f"{path}: format {version}, this raybench reads {FORMAT_VERSION}: run raybench trace again")
    try:
        found = TraceResults.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    recorded_trace(found.config, str(path))
    return found
