"""The sections of an experiment file beside its matrix: what each holds, and the keys that describe and read it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from typing import Any

from engines.errors import suggestion
from engines.packages import install_extra
from engines.registry import is_file, split
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, Kind
from engines.schema.yaml_file import Located
from harness.config.settings import SETTINGS
from harness.config.validators import DURATION, NAME, SIZE, ListOf, OrNull, integer, number, one_of
from harness.suites import suite

AUTOMATIC = "auto"
"""The certifier that `plan.certifiers` takes."""
METRICS = ("relmse", "mse", "mape", "smape", "psnr", "ssim", "flip")
SEED = integer(0, 2**63 - 1)


@dataclass(frozen=True, slots=True)
class Checkpoints:
    """Samples per pixel at which the error is measured: `measure.schedule.checkpoints`."""

    ratio: float
    start: int

    def describe(self) -> dict[str, Any]:
        """What a cell's id is a hash of. The root of two once gave other numbers (11, 23, ...), and so has a mark now."""
        return {**asdict(self), **({"between": "3/2"} if self.ratio == 2.0**0.5 else {})}


def exact_root(ratio: float) -> float:
    """A root of two where `ratio` is one to four digits, so that 1.4142 is the root itself; else `ratio`."""
    root = 2.0 ** (1.0 / max(1, round(1.0 / math.log2(ratio)))) if ratio <= 2.0 else ratio
    return root if abs(root - ratio) < 1e-4 * ratio else ratio


CHECKPOINTS = Record(
    "Samples per pixel at which the error is measured; by default 1, 2, 3, 4, 6, 8, 12, 16, 24, ...",
    {
        "ratio": Key(
            number(1.01, 1024.0),
            "Ratio of one checkpoint to the one before, in whole samples. 1.4142, the root of two, stands for 3/2 and 4/3 in "
            "turn: powers of two times the start, and three times them.",
            1.4142,
        ),
        "start": Key(integer(1, 2**31), "Samples per pixel of the first checkpoint.", 1),
    },
    lambda given, context: Checkpoints(exact_root(given["ratio"]), given["start"]),
)


@dataclass(frozen=True, slots=True)
class Limits:
    """What a cell may use. `memory_bytes` None stands for a share of the machine's memory: `memory.default_limit`."""

    memory_bytes: int | None = None


LIMITS = Record(
    "What a cell may use beside its budget.",
    {
        "memory": Key(
            SIZE, "Memory that its processes may hold before they are killed, as 8 GiB; by default 3/4 of the machine's.", None
        )
    },
    lambda given, context: Limits(given["memory"]),
)


ORDER = Record(
    "Order in which cells run.",
    {
        "policy": Key(one_of("blocks"), "Block after block, at random within each.", "blocks"),
        "seed": Key(SEED, "Seed of the random order.", 1),
    },
)


def _side(given: Given, context: Any) -> dict[str, Any]:
    if not given.written:
        raise given.node.refuse("at least one setting is expected")
    return given.written


_SIDE = Record(
    "Contestants, by some of their settings; choices by their names alone.",
    {
        "engine": Key(NAME, "Engine, by the name that tables use.", None),
        "accelerator": Key(NAME, "Accelerator.", None),
        "sampler": Key(NAME, "Sampler.", None),
        "precision": Key(NAME, "Precision.", None),
        "threads": Key(integer(1, 1024), "Threads.", None),
    },
    _side,
)
PAIR = Record(
    "A ratio of times to form, in however many settings the two differ.",
    {
        "contestant": Key(_SIDE, "Contestant whose times are compared."),
        "baseline": Key(_SIDE, "Contestant that it is compared with; of several, the one that shares the most settings."),
    },
    lambda given, context: dict(given.values),
)


@dataclass(frozen=True, slots=True)
class ReferenceConfig:
    """How the image compared with is made. `threads` 0 means every core; it changes no pixel. `shader` None is the cells' own.

    `certify` names an engine of another lineage that is to make the same image from other random numbers; `auto` takes one.
    """

    engine: str
    spp: int
    seed: int
    sampler: Mapping[str, Any]
    accelerator: Mapping[str, Any]
    precision: str | None
    threads: int
    certify: str | None
    shader: Mapping[str, Any] | None = None

    @property
    def replicates(self) -> tuple[int, int]:
        """(samples per pixel, number) of the independent images it is the mean of.

        Powers of two suit Sobol points; 256 is the same for every large `spp`, so that one can be extended. The number
        is even: they go to the two halves in turn.
        """
        each = 2 ** int(math.log2(min(256, max(1, self.spp // 8))))
        count = -(-self.spp // each)
        return each, count + count % 2


def _reference(given: Given, context: Any) -> ReferenceConfig:
    """Refuses engines that give no variance between samples."""
    for key in ("engine", "certify"):
        if given[key] and (is_file(given[key]) or split(given[key])[1]):
            raise given.at(key).refuse("a renderer by process, or with a Python of its own, is raced, but makes no reference")
    if given["certify"] == given["engine"]:
        raise given.at("certify").refuse(f"another engine than the reference's, {given['engine']}, is expected")
    return ReferenceConfig(**given.values)


_ENGINE = SETTINGS["engine"].kind


def _certifier(node: Located) -> str | None:
    return AUTOMATIC if node.value == AUTOMATIC else OrNull(_ENGINE).read(node)


REFERENCE = Record(
    "How the reference is made: the mean of independent images.",
    {
        "engine": Key(_ENGINE, "Engine that renders it.", "embree"),
        "spp": Key(integer(2, 2**31), "Samples per pixel in all.", 8192),
        "seed": Key(SEED, "Seed of the first of its images; no cell may have one of its seeds.", 9000),
        "sampler": Key(SETTINGS["sampler"].kind, "Sampler, as for cells.", "sobol"),
        "accelerator": Key(SETTINGS["accelerator"].kind, "Accelerator, as for cells.", "auto"),
        "precision": Key(SETTINGS["precision"].kind, "Precision, as for cells.", None),
        "threads": Key(integer(0, 1024), "Threads; 0 is every core. They change no pixel.", 0),
        "certify": Key(
            Kind(_certifier, {"anyOf": [{"const": AUTOMATIC}, *OrNull(_ENGINE).schema()["anyOf"]]}),
            "An engine of another lineage that renders the image again: the report says whether it is the same. "
            "By default one that is fast enough; null: none.",
            AUTOMATIC,
        ),
        "shader": Key(
            OrNull(SETTINGS["shader"].kind),
            "Shader of one reference that contestants of all shaders race towards; null: each "
            "shader has its own reference, and its own race.",
            None,
        ),
    },
    _reference,
)


@dataclass(frozen=True, slots=True)
class Quality:
    """The metric that targets are set on; `targets` None stands for `auto`: resolved once, from the first results."""

    metric: str
    epsilon: float
    targets: tuple[float, ...] | None

    @property
    def name(self) -> str:
        """The metric's name with its parameters, as in events and tables."""
        from harness.metrics import metric_name

        return metric_name(self.metric, self.epsilon)


def _quality(given: Given, context: Any) -> Quality:
    """Refuses targets that no image has, `auto` where qualities rise, and FLIP without its evaluator."""
    quality = Quality(**given.values)
    if not given.has("metric"):
        return quality
    from harness.metrics import as_error, higher_is_better

    if quality.metric == "flip" and find_spec("flip_evaluator") is None:
        raise given.at("metric").refuse(f"FLIP's evaluator is not installed: {install_extra('flip')}")
    if not higher_is_better(quality.metric):
        return quality
    if quality.targets is None or not given.has("targets"):
        wanted = f"targets are expected with {quality.metric}: there is no default, and auto is for errors"
        raise given.node.refuse(wanted)
    if min(as_error(quality.metric, target) for target in quality.targets) <= 0.0:
        raise given.at("targets").refuse("must be below 1")
    return quality


_TARGETS = ListOf(number(0.0, 1e30, open_low=True), 1)


def _targets(node: Located) -> tuple[float, ...] | None:
    if node.value == "auto":
        return None
    if not isinstance(node.value, list) or not node.value:
        raise node.refuse("a list of errors, or auto, is expected")
    return tuple(sorted(set(_TARGETS.read(node)), reverse=True))


QUALITY = Record(
    "Metric of the error, and the target errors.",
    {
        "metric": Key(one_of(*METRICS), "Metric of targets and plots.", "relmse"),
        "epsilon": Key(number(0.0, 1e6, open_low=True), "Added to the square of each reference pixel in relMSE.", 0.01),
        "targets": Key(
            Kind(_targets, {"oneOf": [{"const": "auto"}, _TARGETS.schema()]}),
            "Errors to reach, or auto: four half a decade apart, chosen once from the first results.",
            [0.1, 0.01, 0.001],
        ),
    },
    _quality,
)


def _margin(default: float, of: str) -> Key:
    return Key(number(0.0, 1.0, open_low=True), f"Largest difference of {of}, as a share of the radiance.", default)


EQUIVALENCE = Record(
    "Margins within which the images of two engines count as equivalent.",
    {"image": _margin(0.005, "the image means"), "tile": _margin(0.05, "a tile of 16x16 pixels")},
    lambda given, context: given.values,
)


@dataclass(frozen=True, slots=True)
class VerifyConfig:
    """Cases of the accuracy suite (ids or sections) that a run includes; `quick` with fewer rays."""

    cases: tuple[str, ...]
    quick: bool
    timeout_seconds: float


def _verify(given: Given, context: Any) -> VerifyConfig:
    for child in given.at("cases").value if given.has("cases") else ():
        if child.value not in (names := suite().case_names()):
            raise child.refuse(f"unknown case or section: {suggestion(child.value, names)}")
    return VerifyConfig(tuple(given["cases"]), given["quick"], given["timeout"])


VERIFY = Record(
    "Cases of `raybench verify` that run after all that is timed.",
    {
        "cases": Key(ListOf(NAME, 1), "Ids of cases or names of sections.", ["stability"]),
        "quick": Key(BOOLEAN, "Whether to use fewer rays and parameters.", False),
        "timeout": Key(DURATION, "Wall time of a verify job.", "300s"),
    },
    _verify,
)
