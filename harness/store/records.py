"""The records of a results folder: its events, what they are made of, its manifest and a reference's metadata.

A record is parsed once, when its line is read, and is the same where it is made, written, kept and analysed; it does not
change. In files numbers are as JSON has them, none converted; ids and paths are as `confined` expects them; keys without a
name here are let through and not kept.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from engines.choices import Choice
from harness.check_results import CheckResult
from harness.statistics.bias import BiasEstimate
from harness.statistics.calibration import BiasFigures, RaceFigures
from harness.statistics.equivalence import Equivalence
from harness.store.fields import (
    AsObject,
    Count,
    Id,
    ImagePath,
    MetricName,
    Numbers,
    Pixels,
    Samples,
    Seconds,
    Setting,
    Target,
    Text,
    Threads,
)

BROKEN = ("failed", "timeout")
"""States of a cell that had its chance and has no whole measurement."""


class Record(BaseModel):
    """Types as they are in JSON, none converted; keys that have no name here are let through."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True)

    def replaced(self, **changes: Any) -> Self:
        """A copy with other values, which are not checked, in some fields."""
        return self.model_copy(update=changes)


Value = TypeVar("Value")


def transformed(value: Value, function: Callable[[Any], Any]) -> Value:
    """The same record, or part of one, with `function` applied to every number and text in it."""
    made: Any = value
    if isinstance(value, Record):
        return value.replaced(**{name: transformed(getattr(value, name), function) for name in value.model_fields_set})
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value)]
        return dataclasses.replace(value, **{name: transformed(getattr(value, name), function) for name in names})
    if isinstance(value, Mapping):
        made = {key: transformed(child, function) for key, child in value.items()}
    elif isinstance(value, tuple) and hasattr(value, "_fields"):
        made = type(value)(*(transformed(child, function) for child in value))
    elif isinstance(value, (list, tuple)):
        made = type(value)(transformed(child, function) for child in value)
    else:
        made = function(value)
    return made


# --- runs, machines, references -------------------------------------------------------------------------------------


class Run(Record):
    event: Literal["run"] = "run"
    time: str
    run_id: str
    command: tuple[Text, ...]
    config_name: Text | None = None


class Environment(Record):
    """`preimage` is what the id is a hash of: the machine and its libraries."""

    event: Literal["environment"] = "environment"
    env_id: Id
    preimage: dict[str, Any]


class Targets(Record):
    event: Literal["targets"] = "targets"
    metric: MetricName
    targets: tuple[Target, ...]


class Reference(Record):
    event: Literal["reference"] = "reference"
    scene: Text
    scene_hash: Id
    reference_id: Id
    engine: str
    spp: Samples
    width: Pixels
    height: Pixels
    shader: Setting
    seconds: Seconds


class Certificate(Record):
    """Whether `engine`, of another `lineage`, makes the reference's image, at 1 / `factor` of its width and height.

    The figures, those of `statistics.Equivalence`, are there unless the verdict is `impossible`.
    """

    event: Literal["certificate"] = "certificate"
    certificate_id: Id
    reference_id: Id
    reference_lineage: str
    engine: str
    engine_version: str = ""
    lineage: str
    factor: Count = 1
    settings: dict[str, Any] = {}
    replicates: Count = 0
    replicate_spp: Count = 0
    margins: tuple[float, ...] = ()
    alpha: float = 0.0
    scene: Text
    reference_engine: str = ""
    spp: Samples
    width: Pixels
    height: Pixels
    message: Text
    time: str = ""
    verdict: Literal["identical", "equivalent", "different", "unresolved", "impossible"]
    difference: float | None = None
    low: float | None = None
    high: float | None = None
    image_bound: float | None = None
    tile_bound: float | None = None
    worst_tile: tuple[Count, Count] | None = None
    image_margin: float | None = None
    tile_margin: float | None = None
    same_pixels: float | None = None

    @model_validator(mode="after")
    def _compared(self) -> Certificate:
        if self.verdict != "impossible" and None in (self.difference, self.low, self.high, self.image_bound, self.tile_bound):
            raise ValueError("difference, low, high and bounds are expected")
        return self

    @property
    def bounds(self) -> tuple[float, float]:
        """What the image means, and any tile, differ by at most, as shares of the radiance; NaN where it is `impossible`."""
        image, tile = (math.nan if bound is None else bound for bound in (self.image_bound, self.tile_bound))
        return image, tile


# --- cells ----------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, slots=True)
class Settings:
    """The settings of a contestant: what its cells have in common but for their seed and block.

    `label` is that of an A/A twin, else empty; `machine` the beginning of the id of the environment.
    """

    scene: str
    engine: str
    accelerator: Setting
    shader: Setting
    sampler: Setting
    precision: str
    threads: Threads
    width: Pixels
    height: Pixels
    label: str
    machine: str
    division: Literal["closed", "open"]

    @property
    def size(self) -> str:
        """`256x256`."""
        return f"{self.width}x{self.height}"

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height, as a filter asks for them."""
        return self.width, self.height

    def order(self) -> tuple[Any, ...]:
        """What contestants are sorted by."""
        choices = self.accelerator, self.shader, self.sampler
        rest = self.precision, self.threads, self.size, self.label, self.machine, self.division
        return self.scene, self.engine, *choices, *rest


@dataclasses.dataclass(frozen=True, slots=True)
class RaySettings:
    """As `Settings`, of a contestant that traces rays of a kind."""

    scene: str
    rays: str
    engine: str
    accelerator: Choice
    precision: str | None
    threads: int
    label: str
    machine: str


class Point(Record):
    """A checkpoint. `seconds` and `rays` count from the start of the cell, or of the checkpoint's own render in a cell of
    `separate_renders`, where `sampler` says how its sampler was set. `film_variance`: what the spread of the film's own samples
    says of the variance of a pixel, averaged. `mean_spp`: samples of a pixel on average, of an engine that renders more than
    `spp`."""

    spp: Samples
    mean_spp: Annotated[float, Field(gt=0)] | None = None
    seconds: Seconds
    rays: float | None = None
    sampler: Setting | None = None
    metrics: Numbers
    film_variance: Annotated[float, Field(ge=0)] | None = None
    image: ImagePath | None

    @property
    def samples(self) -> float:
        """Samples of a pixel, on average."""
        return float(self.spp if self.mean_spp is None else self.mean_spp)


class Phases(Record):
    """Seconds of what comes before and between the timed calls, and of these; None for a phase that was not reached.

    `warm_build_seconds` are those of the second build, of the renderer that is timed.
    """

    import_seconds: float | None = None
    load_seconds: float | None = None
    build_seconds: float | None = None
    compile_seconds: float | None = None
    render_seconds: float | None = None
    warm_build_seconds: float | None = None


class Machine(Record):
    """The machine over the timed calls of a cell. None: it was not counted.

    `timed_seconds` are wall time, `cpu_seconds` processor time of the child and of what it started and awaited,
    `off_clock_cpu_seconds` that of other threads than the calling one between timed calls, `run_queue_seconds` the time that
    its threads waited for a processor, `other_cpu_seconds` that of other processes on the usable cores. `contention_rule` says
    by which rule of docs/how/clock.md the cell is contended.
    """

    load_1m: float | None = None
    timed_seconds: float | None = None
    cpu_seconds: float | None = None
    off_clock_cpu_seconds: float | None = None
    run_queue_seconds: float | None = None
    steal_seconds: float | None = None
    other_cpu_seconds: float | None = None
    involuntary_switches: Annotated[int, Field(ge=-(2**62), le=2**62)] | None = None
    contended: bool | None = None
    contention_rule: str | None = None


class Measurement(Record):
    """A cell's state, and what is said of it whether it renders or traces rays. `attempt` 2 and up: measured again, because the
    one before was contended. `configuration` is the same for cells that differ in seed and block alone."""

    cell_id: Id
    configuration: str = ""
    env_id: Id
    label: Text | None = None
    state: Literal["done", "failed", "timeout", "skipped", "outdated"]
    message: Text = ""
    block: Count
    order: Count = 0
    seed: Count
    scene: Text
    scene_hash: Id
    primitives: Count = 0
    division: Literal["closed", "open"] = "closed"
    engine: str
    engine_version: str = ""
    accelerator: Setting
    threads: Threads
    spec: dict[str, Any] = {}
    command: Text = ""
    time: str = ""
    phases: Phases = Phases()
    counters: Numbers = {}
    machine: Machine = Machine()
    attempt: Annotated[int, Field(ge=1, le=1000)] = 1
    wall_seconds: Seconds | None = None
    worker: str | None = None
    measured_as: Id | None = None


class Rendered(Measurement):
    """A cell that renders. Checkpoints rise in samples, and their seconds do not fall, unless each is a render of its own.
    `raced` is the shader of the reference where that is not the cell's own."""

    smooth_sampler: bool = False
    reproducible: bool = False
    raced: Setting | None = None
    shader: Setting
    sampler: Setting
    precision: str
    width: Pixels
    height: Pixels
    reference_id: Id | None
    separate_renders: bool = False
    points: tuple[Point, ...] = ()

    @model_validator(mode="after")
    def _rising(self) -> Self:
        for before, after in zip(self.points, self.points[1:], strict=False):
            falls = after.seconds < before.seconds and not self.separate_renders
            if after.spp <= before.spp or falls:
                raise ValueError(f"points: that of {after.spp} samples does not come after that of {before.spp}")
        return self

    @property
    def settings(self) -> Settings:
        """The settings of its contestant."""
        return Settings(
            self.scene,
            self.engine,
            self.accelerator,
            self.shader,
            self.sampler,
            self.precision,
            self.threads,
            self.width,
            self.height,
            self.label or "",
            self.env_id[:8],
            self.division,
        )

    @property
    def reference_shader(self) -> Choice:
        """The shader of the reference: the cell's own, unless the experiment has one for all cells."""
        return self.raced or self.shader

    @property
    def render_seconds(self) -> float | None:
        """Seconds inside the render calls of all checkpoints; None before the first. In a cell of `separate_renders` the phase
        has those of the last call alone."""
        if self.separate_renders and self.points:
            return sum(point.seconds for point in self.points)
        return self.phases.render_seconds

    @property
    def end(self) -> Point:
        """The last checkpoint, of a cell that has one."""
        return self.points[-1]


class Cell(Rendered):
    """The measurement of a cell that counts: the last of these events."""

    event: Literal["cell"] = "cell"


class Attempt(Rendered):
    """A measurement of a cell that does not count: it was contended, or failed, where the cell had been measured before."""

    event: Literal["attempt"] = "attempt"


class Answers(Record):
    """What was wrong with the answers to `checked` rays and to `hard` ones, and quantiles of the relative error of t.

    `sha256` is that of all answers. `wrong`: hits of another surface or at another distance. `missed`: misses where something
    is hit. `false_hits`: hits where nothing is.
    """

    sha256: str
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


RayKind = Literal["camera", "shadow", "incoherent"]
"""One of `harness.config.settings.RAY_KINDS`."""


class Traced(Measurement):
    """A cell that traces a set of `count` rays of a kind: `passes` times in `seconds` of timed calls."""

    precision: str | None
    rays: RayKind
    ray_set_id: Id
    count: Count
    passes: Count = 0
    seconds: Seconds = 0.0
    answers: Answers | None = None

    @property
    def settings(self) -> RaySettings:
        """The settings of its contestant."""
        own = self.engine, self.accelerator, self.precision, self.threads
        return RaySettings(self.scene, self.rays, *own, self.label or "", self.env_id[:8])


class RayCell(Traced):
    """As `Cell`, of a cell that traces rays."""

    event: Literal["ray_cell"] = "ray_cell"


class RayAttempt(Traced):
    """As `Attempt`, of a cell that traces rays."""

    event: Literal["ray_attempt"] = "ray_attempt"


AnyCell = Cell | RayCell
AnyAttempt = Attempt | RayAttempt


def attempt_of(cell: AnyCell) -> AnyAttempt:
    """The same measurement, which does not count."""
    kept = {name: getattr(cell, name) for name in cell.model_fields_set - {"event"}}
    return RayAttempt(**kept) if isinstance(cell, RayCell) else Attempt(**kept)


class Start(Record):
    """A cell is being measured."""

    event: Literal["start"] = "start"
    cell_id: Id
    attempt: Annotated[int, Field(ge=1, le=1000)] = 1
    time: str = ""


class VerifyJob(Record):
    event: Literal["verify_job"] = "verify_job"
    verify_job_id: Id
    spec: dict[str, Any] = {}
    env_id: Id | None = None
    state: Literal["done", "failed", "timeout"]
    message: Text = ""
    results: tuple[CheckResult, ...]
    wall_seconds: Seconds | None = None
    time: str = ""


# --- what archives keep of conclusions ------------------------------------------------------------------------------


class ArchivedBias(Record):
    of: Settings
    found: Annotated[BiasEstimate, AsObject]


class ArchivedEquivalence(Record):
    """A contestant's image beside that of its baseline."""

    of: Settings
    found: Equivalence


class ArchivedPair(Record):
    """Two engines; `replicates` and `spp` are of each side, see `analysis.equivalence.Comparison`."""

    first: Settings
    second: Settings
    found: Equivalence
    replicates: tuple[Count, Count]
    spp: tuple[Count, Count]
    paired: bool


class ArchivedVerdicts(Record):
    """In archives: what was concluded from images that they lack."""

    event: Literal["archived_verdicts"] = "archived_verdicts"
    bias: tuple[ArchivedBias, ...] = ()
    baseline: tuple[ArchivedEquivalence, ...] = ()
    pairs: tuple[ArchivedPair, ...] = ()


class Calibration(Record):
    """What a run's own noise says about its verdicts; in archives that of the run. `races` and `bias` are None where the run is
    too small for them. They rest on `race_count` races and `image_count` contestants, `repetitions` and `image_repetitions`
    times in all. `without_twins`: races of a machine without A/A twins."""

    event: Literal["calibration"] = "calibration"
    races: Annotated[RaceFigures | None, AsObject]
    bias: Annotated[BiasFigures | None, AsObject]
    race_count: Count
    image_count: Count
    repetitions: Count
    image_repetitions: Count
    without_twins: Count


OfArchives = ArchivedVerdicts | Calibration
AnyEvent = Run | Environment | Targets | Reference | Certificate | Start | AnyCell | AnyAttempt | OfArchives | VerifyJob
Event = Annotated[AnyEvent, Field(discriminator="event")]


# --- manifest -------------------------------------------------------------------------------------------------------


class Manifest(Record):
    """What was run. `config` is the experiment as a file with every default filled in, which `folder.config_of` reads; `merged`
    are the manifests of the folders that were merged, `reference_spp` the samples per pixel of the references as made."""

    model_config = ConfigDict(extra="allow")
    raybench_results: int
    name: str | None = None
    config_name: str | None = None
    config: dict[str, Any] = {}
    env_id: Id | None = None
    cell_ids: tuple[Id, ...] = ()
    verify_job_ids: tuple[Id, ...] | None = None
    warnings: tuple[Text, ...] = ()
    time: str | None = None
    command: tuple[Text, ...] = ()
    machine: dict[str, Any] = {}
    merged: tuple[dict[str, Any], ...] = ()
    reference_spp: dict[Id, int] = {}


# --- references on disk ---------------------------------------------------------------------------------------------


class ReferenceSpec(Record):
    """What a reference's id is the hash of."""

    model_config = ConfigDict(extra="allow")
    replicates: Annotated[int, Field(ge=2, le=2**31)]
    replicate_spp: Samples
    width: Pixels
    height: Pixels

    @property
    def preimage(self) -> dict[str, Any]:
        """All of it, as plain data."""
        return self.model_dump()


class ReferenceMeta(Record):
    """How far a reference is, and the `file` of its film so far. `cut_short`: its time ended before it had the samples that its
    target needs."""

    reference_id: Id
    family: str
    scene: str
    scene_hash: Id
    spec: ReferenceSpec
    done: Count
    complete: bool
    cut_short: bool = False
    file: Annotated[str, Field(pattern=r"^film-[0-9]{1,10}\.npz$")]
    sha256: str
    seconds: Seconds
    time: str
    machine: dict[str, Any] = {}
