"""What a results folder may say: the types of events, of the manifest and of a reference's metadata.

Folders come from other machines and other people. `event`, `manifest` and `reference_meta` check data as it was loaded
from JSON, once, at the door; whoever reads it afterwards may rely on it. Keys that are not named here may hold anything
plain. Numbers fit 64 bits, text is Unicode, ids and paths are as `confined` wants them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from engines.errors import ConfigError
from harness import confined

FORMAT_VERSION = 1
"""Of manifest and events together: the manifest's `raybench_results`."""
MAX_DEPTH = 64
LARGEST_INTEGER = 2**63


def _path(text: str) -> str:
    if not confined.is_relative(text):
        raise ValueError("a relative path without '..' is wanted")
    return text


def _metric(text: str) -> str:
    if text.startswith("relmse_e"):
        Quality(metric="relmse", epsilon=float(text.removeprefix("relmse_e")))
    elif text not in ("mse", "mape", "smape", "psnr", "ssim", "flip"):
        raise ValueError("the name of a metric is wanted, such as relmse_e0.01")
    return text


Id = Annotated[str, Field(pattern=confined.ID)]
ImagePath = Annotated[str, AfterValidator(_path)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Amount = Annotated[float, Field(ge=0, le=1e18)]
Seconds = Annotated[float, Field(ge=0, le=1e10)]
Count = Annotated[int, Field(ge=0, le=2**62)]
Samples = Annotated[int, Field(ge=1, le=2**40)]
Pixels = Annotated[int, Field(ge=1, le=65_536)]
MetricName = Annotated[str, AfterValidator(_metric)]
Target = Annotated[float, Field(gt=0, le=1e30)]
Numbers = dict[str, float | None]
Scalar = str | bool | int | float | None


class Record(BaseModel):
    """Types as they are in JSON, none converted; keys that have no name here are let through."""

    model_config = ConfigDict(strict=True, extra="ignore")


class Choice(Record):
    """A shader, sampler or accelerator with its options."""

    name: str


class Point(Record):
    """A checkpoint. `seconds` and `rays` count from the start of the cell."""

    spp: Samples
    seconds: Seconds
    rays: Amount | None = None
    metrics: Numbers
    image: ImagePath | None


class Run(Record):
    event: Literal["run"]
    time: str
    run_id: str
    command: list[str]
    config_name: str | None = None


class Environment(Record):
    """`preimage` is what the id is a hash of: the machine and its libraries."""

    event: Literal["environment"]
    env_id: Id
    preimage: dict[str, Any]


class Targets(Record):
    event: Literal["targets"]
    metric: MetricName
    targets: list[Target]


class Reference(Record):
    event: Literal["reference"]
    scene: str
    scene_hash: Id
    reference_id: Id
    engine: str
    spp: Samples
    width: Pixels
    height: Pixels
    shader: Choice
    seconds: Seconds


class Certificate(Record):
    """`difference`, `low`, `high` are there unless the verdict is `impossible`."""

    event: Literal["certificate"]
    certificate_id: Id
    reference_id: Id
    scene: str
    engine: str
    spp: Samples
    message: str
    verdict: Literal["equivalent", "different", "inconclusive", "impossible"]
    difference: float | None = None
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _compared(self) -> Certificate:
        if self.verdict != "impossible" and None in (self.difference, self.low, self.high):
            raise ValueError("difference, low and high are wanted")
        return self


class Sentinel(Record):
    event: Literal["sentinel"]
    block: Count
    seconds: Seconds
    env_id: Id | None = None


class Start(Record):
    event: Literal["start"]
    cell_id: Id


class Cell(Record):
    """A cell's state and what was measured of it. Checkpoints rise in samples, and their seconds do not fall."""

    event: Literal["cell"]
    cell_id: Id
    env_id: Id | None = None
    label: str | None = None
    state: Literal["done", "failed", "timeout", "skipped", "outdated"]
    message: str = ""
    block: Count
    order: Count = 0
    seed: Count
    scene: str
    scene_hash: Id
    primitives: Count | None = None
    engine: str
    shader: Choice
    sampler: Choice
    accelerator: Choice
    precision: str | None = None
    threads: Annotated[int, Field(ge=1, le=65_536)]
    width: Pixels
    height: Pixels
    reference_id: Id | None
    asked: dict[str, Any] = {}
    command: str | None = None
    time: str | None = None
    phases: Numbers
    points: list[Point]
    counters: Numbers
    machine: dict[str, Scalar]
    sentinel_seconds: Seconds | None = None
    wall_seconds: Seconds | None = None

    @model_validator(mode="after")
    def _rising(self) -> Cell:
        for before, after in zip(self.points, self.points[1:], strict=False):
            if after.spp <= before.spp or after.seconds < before.seconds:
                raise ValueError(f"points: that of {after.spp} samples does not come after that of {before.spp}")
        return self


def _settings(row: list[str | int]) -> list[str | int]:
    if [type(value) for value in row] != [str] * 6 + [int] + [str] * 3:
        raise ValueError("a contender's settings are wanted: six texts, the threads, three texts")
    return row


SettingsRow = Annotated[list[str | int], AfterValidator(_settings)]


class Bias(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")
    of: SettingsRow
    squared: float
    se: float
    pairs: Count


class Verdict(BaseModel):
    """The fields of `statistics.Equivalence`."""

    model_config = ConfigDict(strict=True, extra="forbid")
    pixel_p: float
    pixel_threshold: float
    pixels_outside: Count
    tile_p: float
    tile_threshold: float
    image_p: float
    ks_p: float
    difference: float
    low: float
    high: float
    detectable: float
    verdict: Literal["equivalent", "different", "inconclusive"]
    alpha: float = 0.01


class Beside(Verdict):
    of: SettingsRow


class Pair(Record):
    first: SettingsRow
    second: SettingsRow
    found: Verdict
    replicates: Annotated[list[Count], Field(min_length=2, max_length=2)]
    spp: Annotated[list[Count], Field(min_length=2, max_length=2)]
    paired: bool


class Conclusions(Record):
    event: Literal["conclusions"]
    bias: list[Bias] = []
    baseline: list[Beside] = []
    pairs: list[Pair] = []


class Finding(Record):
    """The fields of `verify.battery.Finding`."""

    engine: str
    version: str
    precision: str
    tracing: str
    accelerator: str
    section: str
    case: str
    asked: str
    source: str
    parameter: str
    count: Count
    error: float
    unit: str
    allowed: float
    verdict: str
    median: float
    tail: float
    worst: float
    seconds: float
    note: str = ""
    typical: float = 0.0


class Examination(Record):
    event: Literal["examination"]
    examination_id: Id
    env_id: Id | None = None
    state: Literal["done", "failed", "timeout"]
    message: str = ""
    findings: list[Finding]


Event = Annotated[
    Run | Environment | Targets | Reference | Certificate | Sentinel | Start | Cell | Conclusions | Examination,
    Field(discriminator="event"),
]


class Quality(Record):
    metric: Literal["relmse", "mse", "mape", "smape", "psnr", "ssim", "flip"] = "relmse"
    epsilon: Annotated[float, Field(gt=0, le=1e6)] = 0.01
    targets: list[Target | Literal["auto"]] | Literal["auto"] = "auto"


class Scene(Record):
    name: str = ""


class Combination(Record):
    scene: Scene | str | None = None


class Config(Record):
    name: str | None = None
    baseline: str | None = None
    quality: Quality | None = None
    combinations: list[Combination] | None = None


class Manifest(Record):
    raybench_results: int
    name: str | None = None
    config_name: str | None = None
    config: Config | None = None
    cell_ids: list[Id] = []
    examination_ids: list[Id] | None = None
    command: list[str] = []
    machine: dict[str, Any] = {}
    merged: list[dict[str, Any]] = []


class Asked(Record):
    """What a reference's id is the hash of."""

    replicates: Annotated[int, Field(ge=2, le=2**31)]
    replicate_spp: Samples
    width: Pixels
    height: Pixels


class ReferenceMeta(Record):
    reference_id: Id
    family: str
    scene: str
    scene_hash: Id
    asked: Asked
    done: Count
    complete: bool
    file: Annotated[str, Field(pattern=r"^film-[0-9]{1,10}\.npz$")]
    sha256: str
    seconds: Seconds
    time: str
    machine: dict[str, Any] = {}


# --- checking -------------------------------------------------------------------------------------------------------


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def event(data: Any, where: str) -> None:
    """Raises `ConfigError`, one line that begins with `where`, if this is no event."""
    _check(Event, data, where)


def manifest(data: Any, where: str) -> None:
    """Raises `ConfigError` if this is no manifest, or one of another version of the format."""
    version = data.get("raybench_results") if isinstance(data, dict) else None
    if not isinstance(version, int) or isinstance(version, bool):
        raise ConfigError(f"{where}: 'raybench_results: {FORMAT_VERSION}' is wanted: this is no manifest of results")
    if version != FORMAT_VERSION:
        age = "a newer raybench wrote it" if version > FORMAT_VERSION else "an older raybench wrote it"
        raise ConfigError(f"{where}: results of format {version}, and this raybench reads {FORMAT_VERSION}: {age}")
    _check(Manifest, data, where)
    for index, source in enumerate(data.get("merged", [])):
        manifest({"raybench_results": FORMAT_VERSION, **source}, f"{where} merged[{index}]")


def reference_meta(data: Any, where: str) -> None:
    """Raises `ConfigError` if this is no metadata of a reference."""
    _check(ReferenceMeta, data, where)


def _check(kind: Any, data: Any, where: str) -> None:
    try:
        _plain(data)
        _adapter(kind).validate_python(data)
    except ValidationError as error:
        raise ConfigError(f"{where}: {_first(error)}") from None
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from None


def _plain(value: Any, depth: int = 0) -> None:
    """Raises `ValueError` for what JSON can say and programs cannot hold."""
    if isinstance(value, str):
        if not value.isascii() and any("\ud800" <= letter <= "\udfff" for letter in value):
            raise ValueError("text that is no Unicode: half of a surrogate pair")
    elif isinstance(value, int):
        if not -LARGEST_INTEGER <= value < LARGEST_INTEGER:
            raise ValueError("an integer of more than 64 bits")
    elif isinstance(value, (dict, list)):
        if depth == MAX_DEPTH:
            raise ValueError(f"nested deeper than {MAX_DEPTH}")
        for child in value:
            _plain(child, depth + 1)
            if isinstance(value, dict):
                _plain(value[child], depth + 1)


def _first(error: ValidationError) -> str:
    """The first thing that is wrong, in a line: where in the data, what was found, what is wanted."""
    found = error.errors(include_url=False, include_context=False)[0]
    field = re.sub(r"\.(\d+)", r"[\1]", ".".join(map(str, found["loc"])))
    message = found["msg"].removeprefix("Value error, ")
    shown = found["input"]
    said = "" if isinstance(shown, (Mapping, list)) else f" = {shown!r:.120}"
    return " ".join(f"{field or 'the whole'}{said}: {message}".split())
