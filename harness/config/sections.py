"""The sections of an experiment file beside its matrix: what each holds, with the keys that describe and read it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

from engines.choices import Choice
from engines.errors import suggestion
from engines.packages import install_extra
from engines.registry import is_file, split
from engines.schema.keys import Given, Schema
from engines.schema.kinds import BOOLEAN, Kind
from engines.schema.yaml_file import Located
from harness.config.filters import CONTESTANTS, Filter
from harness.config.keys import Section, key
from harness.config.kinds import DURATION, LINE, NAME, RECORDED, SEED, SIZE, ListOf, OrNull, integer, number, one_of
from harness.config.settings import ACCELERATOR, ENGINE, PRECISION, SAMPLER, SHADER
from harness.metrics import DEFAULT_MARGINS, METRICS, Margins
from harness.suites import suite

AUTOMATIC = "auto"
"""The certifier that `plan.certifiers` takes, and as many samples of a reference as its targets need."""
REFERENCE_ENGINE = "numba"
"""The engine of references where a config names none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoints:
    """Samples per pixel at which the error is measured; by default 1, 2, 3, 4, 6, 8, 12, 16, 24, ...

    `measure.schedule.checkpoints` counts them.
    """

    ratio: float = key(
        number(1.01, 1024.0),
        "Ratio of one checkpoint to the one before, in whole samples. 1.4142, the root of two, means 3/2 and 4/3 in turn: "
        "powers of two times the start, and three times them.",
        1.4142,
    )
    start: int = key(integer(1, 2**31), "Samples per pixel of the first checkpoint.", 1)

    def describe(self) -> dict[str, Any]:
        """What a cell's id is a hash of. The root of two once gave other numbers (11, 23, ...), and so has a mark now."""
        return {"ratio": self.ratio, "start": self.start, **({"between": "3/2"} if self.ratio == 2.0**0.5 else {})}


def exact_root(ratio: float) -> float:
    """A root of two where `ratio` is one to four digits, so that 1.4142 is the root itself; else `ratio`."""
    root = 2.0 ** (1.0 / max(1, round(1.0 / math.log2(ratio)))) if ratio <= 2.0 else ratio
    return root if abs(root - ratio) < 1e-4 * ratio else ratio


def _checkpoints(found: Checkpoints, given: Given, context: Any) -> Checkpoints:
    return replace(found, ratio=exact_root(found.ratio))


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What a cell may use beside its budget.

    `memory_bytes` None stands for a share of the machine's memory: `memory.default_limit`.
    """

    memory_bytes: int | None = key(
        SIZE,
        "Memory that its processes may hold before they are killed, as 8 GiB; by default 3/4 of the machine's.",
        None,
        name="memory",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RaySets:
    """The sets of rays that cells with `rays` trace, one for each scene and kind, made from the experiment's `seed`."""

    count: int = key(integer(16, 10**8), "Rays per set.", 200_000)
    batch: int | None = key(OrNull(integer(1, 10**8)), "Rays per call; by default all in one.", None)
    bounces: int = key(integer(1, 64), "Bounces of the paths from whose hits incoherent rays start.", 3)
    checked: int = key(integer(0, 10**8), "Rays per set that are compared with exact answers; the whole set at most.", 10_000)
    hard: int = key(integer(0, 10**8), "Rays at edges and vertices that triangles share, by which leaks are counted.", 20_000)


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Order in which cells run: block after block, at random within each."""

    seed: int = key(SEED, "Seed of the random order.", 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """A further ratio of times, in however many settings the two differ."""

    contestant: Filter = key(CONTESTANTS, "Filter of the contestants whose times are compared; a bare name is an engine's.")
    baseline: Filter = key(
        CONTESTANTS, "Filter of the contestant that they are compared with; of several, the one that shares the most settings."
    )


@dataclass(frozen=True, slots=True)
class _Certifier:
    """An engine, `auto`, or null."""

    def read(self, node: Located, context: Any = None) -> str | None:
        return AUTOMATIC if node.value == AUTOMATIC else OrNull(ENGINE).read(node, context)

    def write(self, value: str | None) -> Any:
        return AUTOMATIC if value == AUTOMATIC else OrNull(ENGINE).write(value)

    def schema(self) -> Schema:
        return {"anyOf": [{"const": AUTOMATIC}, *OrNull(ENGINE).schema()["anyOf"]]}


REPLICATE_SPP, FEWEST_REPLICATES, MOST_REPLICATES = 32, 8, 4096
"""Of a reference that has as many samples as the targets need: samples per pixel of each of its images, and their number."""
_SPP = integer(2, 2**31)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceConfig:
    """How the reference is made: the mean of independent images.

    `engine` None is the engine numba, or the experiment's only engine where numba declines; `spp` None stands for `auto`.
    """

    engine: str | None = key(
        OrNull(ENGINE),
        "Engine that renders it; by default numba, or the experiment's only engine where numba cannot render the scene.",
        None,
    )
    spp: int | None = key(
        Kind(
            lambda node: None if node.value == AUTOMATIC else _SPP.read(node),
            {"anyOf": [{"const": AUTOMATIC}, _SPP.schema()]},
            lambda spp: AUTOMATIC if spp is None else spp,
        ),
        "Samples per pixel in all. auto: 16 times the samples that the smallest target needs (an error of that size is then 10 "
        "standard errors above zero), within max_time, at least 256; 8192 where the metric is neither relmse nor mse, or where "
        "targets are auto.",
        AUTOMATIC,
    )
    max_time_seconds: float | None = key(
        OrNull(DURATION),
        "Time inside render calls after which spp: auto adds no image; by default that of all cells that the reference serves.",
        None,
        name="max_time",
    )
    seed: int = key(SEED, "Seed of the first of its images; no cell may have one of its seeds.", 9000)
    sampler: Choice = key(SAMPLER, "Sampler, as for cells.", "sobol")
    accelerator: Choice = key(ACCELERATOR, "Accelerator, as for cells.", "auto")
    precision: str | None = key(PRECISION, "Precision, as for cells.", None)
    threads: int = key(integer(0, 1024), "Threads; 0 is every core. They change no pixel.", 0)
    certify: str | None = key(
        _Certifier(),
        "An engine of another lineage that renders the image again: the report says whether it is the same. "
        "By default one that is fast enough; null: none.",
        AUTOMATIC,
    )
    shader: Choice | None = key(
        OrNull(SHADER),
        "Shader of one reference that contestants of all shaders race towards; null: each "
        "shader has its own reference, and its own race.",
        None,
    )

    @property
    def replicates(self) -> tuple[int, int]:
        """(samples per pixel, number) of the independent images it is the mean of.

        Powers of two suit Sobol points; 256 is the same for every large `spp`, so that one can be extended. The number
        is even: they go to the two halves in turn. Of `auto` the number is the smallest.
        """
        if self.spp is None:
            return REPLICATE_SPP, FEWEST_REPLICATES
        each = 2 ** int(math.log2(min(256, max(1, self.spp // 8))))
        count = -(-self.spp // each)
        return each, count + count % 2


def makes_references(engine: str) -> bool:
    """Whether an engine may make or certify a reference: the file of a renderer, and an engine with a Python of its own, may
    not."""
    return not is_file(engine) and split(engine)[1] is None


def _reference(found: ReferenceConfig, given: Given, context: Any) -> ReferenceConfig:
    """Refuses engines that give no variance between samples."""
    for name in ("engine", "certify"):
        if given[name] and not makes_references(given[name]):
            raise given.at(name).refuse("a renderer by process, or with a Python of its own, is raced, but makes no reference")
    if found.certify == (found.engine or REFERENCE_ENGINE):
        raise given.at("certify").refuse(
            f"another engine than the reference's, {found.engine or REFERENCE_ENGINE}, is expected"
        )
    return found


def _revision(node: Located) -> str | dict[str, str]:
    if not isinstance(node.value, dict):
        return str(LINE.read(node))
    if len(node.value) < 2:
        raise node.refuse("a line of text, or the revisions of two engines or more by their names, is expected")
    return {name: str(LINE.read(child)) for name, child in node.value.items()}


REVISION = OrNull(Kind(_revision, {"anyOf": [LINE.json, {"type": "object", "minProperties": 2}]}))


_TARGETS = ListOf(number(0.0, 1e30, open_low=True), 1)


def _read_targets(node: Located) -> tuple[float, ...] | None:
    if node.value == "auto":
        return None
    if not isinstance(node.value, list) or not node.value:
        raise node.refuse("a list of errors, or auto, is expected")
    return tuple(sorted(set(_TARGETS.read(node)), reverse=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """Metric of the error, and the target errors.

    `targets` None stands for `auto`: they are chosen once, from the first results.
    """

    metric: str = key(one_of(*METRICS), "Metric of targets and plots.", "relmse")
    epsilon: float = key(number(0.0, 1e6, open_low=True), "Added to the square of each reference pixel in relMSE.", 0.01)
    targets: tuple[float, ...] | None = key(
        Kind(
            _read_targets,
            {"oneOf": [{"const": "auto"}, _TARGETS.schema()]},
            lambda targets: "auto" if targets is None else [*targets],
        ),
        "Errors to reach, or auto: four half a decade apart, chosen once from the first results.",
        [0.1, 0.01, 0.001],
    )

    @property
    def name(self) -> str:
        """The metric's name with its parameters, as in events and tables."""
        from harness.metrics import metric_name

        return metric_name(self.metric, self.epsilon)


def _quality(found: Quality, given: Given, context: Any) -> Quality:
    """Refuses targets that no image has, `auto` where qualities rise, and FLIP without its evaluator."""
    if not given.has("metric"):
        return found
    from harness.metrics import as_error, higher_is_better

    if found.metric == "flip" and context is not RECORDED and find_spec("flip_evaluator") is None:
        raise given.at("metric").refuse(f"FLIP's evaluator is not installed: {install_extra('flip')}")
    if not higher_is_better(found.metric):
        return found
    if found.targets is None or not given.has("targets"):
        expected = f"targets are expected with {found.metric}: there is no default, and auto is for errors"
        raise given.node.refuse(expected)
    if min(as_error(found.metric, target) for target in found.targets) <= 0.0:
        raise given.at("targets").refuse("must be below 1")
    return found


_MARGIN = number(0.0, 1.0, open_low=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class EquivalenceConfig:
    """Margins within which the images of two engines count as equivalent."""

    image: float = key(_MARGIN, "Largest difference of the image means, as a share of the radiance.", DEFAULT_MARGINS.image)
    tile: float = key(
        _MARGIN, "Largest difference of a tile of 16x16 pixels, as a share of the radiance.", DEFAULT_MARGINS.tile
    )

    @property
    def margins(self) -> Margins:
        """Both, as the tests of equivalence take them."""
        return Margins(self.image, self.tile)


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifyConfig:
    """Cases of `raybench verify` that run after all that is timed."""

    cases: tuple[str, ...] = key(ListOf(NAME, 1), "Ids of cases or names of sections.", ["stability"])
    quick: bool = key(BOOLEAN, "Whether to use fewer rays and parameters.", False)
    timeout_seconds: float = key(DURATION, "Wall time of a verify job.", "300s", name="timeout")


def _verify(found: VerifyConfig, given: Given, context: Any) -> VerifyConfig:
    """Refuses cases that the suite does not have."""
    for child in given.at("cases").value if given.has("cases") and context is not RECORDED else ():
        if child.value not in (names := suite().case_names()):
            raise child.refuse(f"unknown case or section: {suggestion(child.value, names)}")
    return found


CHECKPOINTS = Section(Checkpoints, _checkpoints)
LIMITS = Section(Limits)
RAY_SETS = Section(RaySets)
ORDER = Section(Order)
PAIR = Section(Pair)
REFERENCE = Section(ReferenceConfig, _reference)
QUALITY = Section(Quality, _quality)
EQUIVALENCE = Section(EquivalenceConfig)
VERIFY = Section(VerifyConfig, _verify)
