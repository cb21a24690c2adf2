"""The types of what a results folder says: events, manifest, a reference's metadata. Data, no behaviour.

Fields are those that programs read; a record may hold others. Numbers are as JSON has them, none converted; ids and paths
are as `confined` wants them. The kinds of events and what they are for: docs/harness.md.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from harness.store import confined
from harness.verify.check_result import CheckResult


def _path(text: str) -> str:
    if not confined.is_relative(text):
        raise ValueError("a relative path without '..' is expected")
    return text


def _metric(text: str) -> str:
    if text.startswith("relmse_e"):
        if not 0.0 < float(text.removeprefix("relmse_e")) <= 1e6:
            raise ValueError("an epsilon in (0, 1e6] is expected")
    elif text not in ("mse", "mape", "smape", "psnr", "ssim", "flip"):
        raise ValueError("the name of a metric is expected, such as relmse_e0.01")
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
    """A checkpoint. `seconds` and `rays` count from the start of the cell, or of the checkpoint's own render in a cell of
    `separate_renders`, where `sampler` says how its sampler was set. `film_variance`: what the spread of the film's own samples
    says of the variance of a pixel, averaged. `mean_spp`: samples of a pixel on average, of an engine that renders more than
    `spp`."""

    spp: Samples
    mean_spp: Annotated[float, Field(gt=0)] | None = None
    seconds: Seconds
    rays: float | None = None
    sampler: Choice | None = None
    metrics: Numbers
    film_variance: Annotated[float, Field(ge=0)] | None = None
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
    """`lineage` is that of `engine`; a certificate without lineages, or of the reference's own, certifies nothing.

    Bounds are there unless the verdict is `impossible`; `inconclusive` is of older runs, which had none.
    """

    event: Literal["certificate"]
    certificate_id: Id
    reference_id: Id
    scene: str
    engine: str
    lineage: str | None = None
    reference_lineage: str | None = None
    spp: Samples
    width: Pixels | None = None
    height: Pixels | None = None
    message: str
    verdict: Literal["identical", "equivalent", "different", "unresolved", "inconclusive", "impossible"]
    difference: float | None = None
    low: float | None = None
    high: float | None = None
    image_bound: float | None = None
    tile_bound: float | None = None

    @model_validator(mode="after")
    def _compared(self) -> Certificate:
        known = (self.difference, self.low, self.high, *((self.image_bound, self.tile_bound) if self.lineage else ()))
        if self.verdict != "impossible" and None in known:
            raise ValueError("difference, low, high and bounds are expected")
        return self


class Sentinel(Record):
    """In older results: the time of a fixed kernel, which predicted nothing. It is not read."""

    event: Literal["sentinel"]


class Start(Record):
    event: Literal["start"]
    cell_id: Id


class Measurement(Record):
    """A cell's state and what was measured of it. Checkpoints rise in samples, and their seconds do not fall, unless each is
    a render of its own. `attempt` 2 and up: measured again, because the one before was contended."""

    cell_id: Id
    attempt: Annotated[int, Field(ge=1, le=1000)] = 1
    separate_renders: bool = False
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
    smooth_sampler: bool = False
    reproducible: bool = False
    division: Literal["closed", "open"] = "closed"
    engine: str
    shader: Choice
    raced: Choice | None = None
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
    wall_seconds: Seconds | None = None

    @model_validator(mode="after")
    def _rising(self) -> Self:
        for before, after in zip(self.points, self.points[1:], strict=False):
            falls = after.seconds < before.seconds and not self.separate_renders
            if after.spp <= before.spp or falls:
                raise ValueError(f"points: that of {after.spp} samples does not come after that of {before.spp}")
        return self


class Cell(Measurement):
    """The measurement of a cell that counts: the last of these events."""

    event: Literal["cell"]


class Attempt(Measurement):
    """A measurement of a cell that does not count: it was contended, or failed, where the cell had been measured before."""

    event: Literal["attempt"]


def _settings(row: list[str | int]) -> list[str | int]:
    if [type(value) for value in row[:10]] != [str] * 6 + [int] + [str] * 3 or row[10:] not in ([], ["closed"], ["open"]):
        raise ValueError("a contestant's settings are expected: six texts, the threads, three texts, and the division")
    return row


SettingsRow = Annotated[list[str | int], AfterValidator(_settings)]


class Bias(BaseModel):
    """The fields of `statistics.BiasEstimate`; older archives have the first three."""

    model_config = ConfigDict(strict=True, extra="forbid")
    of: SettingsRow
    squared: float
    se: float
    pairs: Count
    weight: float = math.nan
    difference: float = math.nan
    image_z: float = math.nan
    image_bound: float = math.nan
    tile_difference: float = math.nan
    tile_z: float = math.nan
    tile_bound: float = math.nan
    worst_tile: Annotated[list[Count], Field(min_length=2, max_length=2)] = [0, 0]


class Verdict(BaseModel):
    """The fields of `statistics.Equivalence`."""

    model_config = ConfigDict(strict=True, extra="forbid")
    verdict: Literal["identical", "equivalent", "different", "unresolved"]
    difference: float
    low: float
    high: float
    image_bound: float
    tile_bound: float
    worst_tile: Annotated[list[Count], Field(min_length=2, max_length=2)]
    image_margin: float
    tile_margin: float
    same_pixels: float = math.nan
    alpha: float = 0.01


class OldVerdict(Record):
    """What archives had before there were bounds: it counts as unresolved."""

    verdict: Literal["equivalent", "different", "inconclusive"]
    pixel_p: float
    alpha: float = 0.01


class Beside(Verdict):
    of: SettingsRow


class OldBeside(OldVerdict):
    of: SettingsRow


class Pair(Record):
    first: SettingsRow
    second: SettingsRow
    found: Verdict | OldVerdict
    replicates: Annotated[list[Count], Field(min_length=2, max_length=2)]
    spp: Annotated[list[Count], Field(min_length=2, max_length=2)]
    paired: bool


class ArchivedVerdicts(Record):
    event: Literal["archived_verdicts"]
    bias: list[Bias] = []
    baseline: list[Beside | OldBeside] = []
    pairs: list[Pair] = []


Share = Annotated[float, Field(ge=0, le=1)]


class RaceFigures(BaseModel):
    """The fields of `statistics.calibration.RaceFigures`."""

    model_config = ConfigDict(strict=True, extra="forbid")
    false_winners: Share
    coverage: Share
    power: Annotated[list[Share], Field(min_length=2, max_length=2)]


class BiasFigures(BaseModel):
    """The fields of `statistics.calibration.BiasFigures`."""

    model_config = ConfigDict(strict=True, extra="forbid")
    smallest_image: Annotated[float, Field(ge=0)]
    smallest_tile: Annotated[float, Field(ge=0)]
    found_image: Share
    found_tile: Share
    false_alarms: Share


class Calibration(Record):
    """In archives: what the run's own noise says about its verdicts. See `analysis.calibration`."""

    event: Literal["calibration"]
    races: RaceFigures | None
    bias: BiasFigures | None
    race_count: Count
    image_count: Count
    repetitions: Count
    image_repetitions: Count
    without_twins: Count


class VerifyJob(Record):
    event: Literal["verify_job"]
    verify_job_id: Id
    env_id: Id | None = None
    state: Literal["done", "failed", "timeout"]
    message: str = ""
    results: list[CheckResult]


Event = Annotated[
    Run
    | Environment
    | Targets
    | Reference
    | Certificate
    | Sentinel
    | Start
    | Cell
    | Attempt
    | ArchivedVerdicts
    | Calibration
    | VerifyJob,
    Field(discriminator="event"),
]


class Manifest(Record):
    raybench_results: int
    name: str | None = None
    config_name: str | None = None
    config: dict[str, Any] = {}
    cell_ids: list[Id] = []
    verify_job_ids: list[Id] | None = None
    warnings: list[str] = []
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
