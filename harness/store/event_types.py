"""The types of what a results folder says: events, manifest, a reference's metadata. Data, no behaviour.

Fields are those that programs read; a record may hold others. Numbers are as JSON has them, none converted; ids and paths
are as `confined` wants them. The kinds of events and what they are for: docs/harness.md.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from harness.store import confined
from harness.verify.check_result import CheckResult


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
    rays: float | None = None
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
    spec: dict[str, Any] = {}
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


class ArchivedVerdicts(Record):
    event: Literal["archived_verdicts"]
    bias: list[Bias] = []
    baseline: list[Beside] = []
    pairs: list[Pair] = []


class VerifyJob(Record):
    event: Literal["verify_job"]
    verify_job_id: Id
    env_id: Id | None = None
    state: Literal["done", "failed", "timeout"]
    message: str = ""
    results: list[CheckResult]


Event = Annotated[
    Run | Environment | Targets | Reference | Certificate | Sentinel | Start | Cell | ArchivedVerdicts | VerifyJob,
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
    verify_job_ids: list[Id] | None = None
    command: list[str] = []
    machine: dict[str, Any] = {}
    merged: list[dict[str, Any]] = []


class ReferenceSpec(Record):
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
    spec: ReferenceSpec
    done: Count
    complete: bool
    file: Annotated[str, Field(pattern=r"^film-[0-9]{1,10}\.npz$")]
    sha256: str
    seconds: Seconds
    time: str
    machine: dict[str, Any] = {}
