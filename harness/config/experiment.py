"""An experiment file becomes an `Experiment`: strict, with file, line and the nearest key in every refusal.

Keys: HARNESS.md and docs. Settings (`SETTINGS`) stand at the top level for all cells or in `matrix` and `zip` as axes;
`exclude`, `include` and `extend` then work on the combinations, in that order. An `include` entry is one whole cell:
what it leaves out comes from the top level, else from the first value of that axis, else from the default.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from engines.errors import ConfigError, suggestion
from engines.registry import is_file
from engines.scene.yaml_file import Located, Origin, parse_yaml, read_yaml
from harness.config import matrix, paths, validators
from harness.config.settings import SETTING_READERS, Budget

SCHEMA_VERSION = 1
SETTINGS = tuple(SETTING_READERS)
METRICS = ("relmse", "mse", "mape", "smape", "psnr", "ssim", "flip")
IMAGES = ("all", "some", "last", "none")
SEED_LIMIT = 2**63 - 1
TOP_DEFAULTS: Mapping[str, Any] = {"repeats": 3, "seed": 1, "images": "some", "timing": True}


@dataclass(frozen=True, slots=True)
class Checkpoints:
    """Samples per pixel at which the error is measured: start, start*ratio, start*ratio^2, ... in whole numbers."""

    ratio: float = 2**0.5
    start: int = 1


@dataclass(frozen=True, slots=True)
class ReferenceConfig:
    """How the image compared with is made. `threads` 0 means every core; it changes no pixel.

    `certify` names a second engine that is to make the same image from other random numbers.
    """

    engine: str = "embree"
    spp: int = 8192
    seed: int = 9000
    sampler: Mapping[str, Any] | str = "sobol"
    accelerator: Mapping[str, Any] | str = "auto"
    precision: str | None = None
    threads: int = 0
    certify: str | None = None

    @property
    def replicates(self) -> tuple[int, int]:
        """(samples per pixel, number) of the independent images it is the mean of.

        Powers of two suit Sobol points; 256 is the same for every large `spp`, so that one can be extended. The number
        is even: they go to the two halves in turn.
        """
        each = 2 ** int(math.log2(min(256, max(1, self.spp // 8))))
        count = -(-self.spp // each)
        return each, count + count % 2


@dataclass(frozen=True, slots=True)
class Quality:
    """The metric that targets are set on; `targets` None stands for `auto`: resolved once, from the first results."""

    metric: str = "relmse"
    epsilon: float = 0.01
    targets: tuple[float, ...] | None = (1e-1, 1e-2, 1e-3)

    @property
    def name(self) -> str:
        """The metric's name with its parameters, as in events and tables."""
        from harness.metrics import metric_name

        return metric_name(self.metric, self.epsilon)


@dataclass(frozen=True, slots=True)
class VerifyConfig:
    """Cases of the accuracy suite (ids or sections) that a run includes; `quick` with fewer rays."""

    cases: tuple[str, ...] = ("stability",)
    quick: bool = False
    timeout_seconds: float = 300.0


@dataclass(frozen=True, slots=True)
class Limits:
    """What a cell may use. `memory_bytes` None stands for a share of the machine's memory: `memory.default_limit`."""

    memory_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class Experiment:
    """What a file asks for. `combinations` hold one value of every setting; repeats multiply them later."""

    name: str
    question: str
    combinations: tuple[Mapping[str, Any], ...]
    checkpoints: Checkpoints
    repeats: int
    seed: int
    order_seed: int
    reference: ReferenceConfig
    quality: Quality
    aa_twin: bool
    images: str
    timing: bool
    baseline: str | None
    warnings: tuple[str, ...]
    resolved: Mapping[str, Any]
    source: str = ""
    verify: VerifyConfig | None = None
    limits: Limits = Limits()


def load(given: str | Path, overrides: Iterable[str] = ()) -> Experiment:
    """The experiment of a path or bare name, with `key.key=value` overrides applied."""
    path = paths.find("configs", str(given))
    shown = paths.shown(path)
    root = read_yaml(path, ConfigError, shown)
    for text in overrides:
        root = override(root, text)
    return parse(root, path.parent, path.stem, shown)


# --- overrides ------------------------------------------------------------------------------------------------------


def override(root: Located, text: str) -> Located:
    """`root` with one `a.b=value` set; the value is YAML. A key that does not exist is made, and checked later."""
    key, equals, value = text.partition("=")
    steps = tuple(key.strip().split("."))
    if not equals or not all(steps):
        raise ConfigError(f"--set {text}: must look like budget.max_time=5s")
    parsed = parse_yaml(value, f"--set {key}", ConfigError)
    validators.mapping(root)
    return _with(root, steps, parsed)


def _with(node: Located, steps: tuple[str, ...], value: Located) -> Located:
    children = dict(validators.mapping(node))
    path = (*node.path, steps[0])
    if len(steps) == 1:
        children[steps[0]] = _moved(value, Origin("--set", ConfigError), path)
    else:
        inside = children.get(steps[0], Located({}, Origin("--set", ConfigError), path))
        children[steps[0]] = _with(inside, steps[1:], value)
    return replace(node, value=children)


def _moved(node: Located, origin: Origin, path: tuple[str | int, ...]) -> Located:
    value = node.value
    if isinstance(value, dict):
        value = {key: _moved(child, origin, (*path, key)) for key, child in value.items()}
    elif isinstance(value, list):
        value = [_moved(child, origin, (*path, index)) for index, child in enumerate(value)]
    return Located(value, origin, path)


# --- sections -------------------------------------------------------------------------------------------------------


def parse(root: Located, folder: Path, stem: str = "experiment", source: str = "") -> Experiment:
    """The experiment of a YAML tree; scene paths are looked up beside `folder`."""
    top = validators.mapping(root)
    top = {key: node for key, node in top.items() if not key.startswith(".")}
    root = replace(root, value=top)
    _version(root, top)
    validators.mapping(root, TOP_KEYS)
    budget = Budget().merged(matrix.read("budget", top["budget"], folder)) if "budget" in top else Budget()
    combinations, warnings = matrix.expand(root, folder, budget)
    read = {**TOP_DEFAULTS, **{key: reader(top[key]) for key, reader in _SCALARS.items() if key in top}}
    reference = _section(top, "reference", _REFERENCE, ReferenceConfig)
    if reference.certify == reference.engine:
        raise root.at(("reference", "certify")).refuse(
            f"another engine than the reference's, {reference.engine}, is wanted"
        )
    quality = read_quality(top)
    repeats, seed = read["repeats"], read["seed"]
    _seeds_differ(root, seed, repeats, reference)
    if "order" in top:
        validators.mapping(top["order"], ("policy", "seed"))
    order = {key: _ORDER[key](node) for key, node in (top["order"].value if "order" in top else {}).items()}
    experiment = Experiment(
        name=read.get("name", stem), question=read.get("question", ""), combinations=tuple(combinations),
        checkpoints=_checkpoints(top), repeats=repeats, seed=seed, order_seed=order.get("seed", 1),
        reference=reference, quality=quality, aa_twin=read.get("aa_twin", repeats >= 3),
        images=read["images"], warnings=tuple(warnings), resolved={}, source=source,
        verify=_verify(top), timing=read["timing"], baseline=read.get("baseline"), limits=_limits(top),
    )  # fmt: skip
    return replace(experiment, resolved=_resolved(experiment))


def _version(root: Located, top: Mapping[str, Located]) -> None:
    if "raybench_experiment" not in top:
        raise root.refuse(f"'raybench_experiment: {SCHEMA_VERSION}' is wanted: this is no experiment")
    if top["raybench_experiment"].value != SCHEMA_VERSION or top["raybench_experiment"].value is True:
        raise top["raybench_experiment"].refuse(f"must be {SCHEMA_VERSION}")


def _switch(node: Located) -> bool:
    if not isinstance(node.value, bool):
        raise node.refuse("must be true or false")
    return node.value


def _choice(kind: str) -> Any:
    return lambda node: matrix.read(kind, node, Path())


_SCALARS: dict[str, Any] = {
    "name": validators.line_of_text,
    "question": validators.line_of_text,
    "repeats": validators.integer(1, 1000),
    "seed": validators.integer(0, SEED_LIMIT),
    "aa_twin": _switch,
    "timing": _switch,
    "images": validators.one_of(*IMAGES),
    "baseline": lambda node: None if node.value is None else validators.text(node),
}
_ORDER = {"policy": validators.one_of("blocks"), "seed": validators.integer(0, SEED_LIMIT)}
_CHECKPOINTS = {"ratio": validators.number(1.01, 1024.0), "start": validators.integer(1, 2**31)}


def _image_maker(node: Located) -> str:
    """An engine that can make references: one that gives the variance between samples."""
    if isinstance(node.value, str) and is_file(node.value):
        raise node.refuse("a renderer by process is raced, but makes no reference")
    return matrix.read("engine", node, Path())


_REFERENCE: dict[str, Any] = {
    "engine": _image_maker, "spp": validators.integer(2, 2**31), "seed": validators.integer(0, SEED_LIMIT),
    "sampler": _choice("sampler"), "accelerator": _choice("accelerator"), "precision": _choice("precision"),
    "threads": validators.integer(0, 1024),
    "certify": lambda node: None if node.value is None else _image_maker(node),
}  # fmt: skip
SECTIONS = (
    "matrix", "zip", "exclude", "include", "extend", "checkpoints", "limits", "order", "reference", "quality", "verify",
)  # fmt: skip
TOP_KEYS = ("raybench_experiment", *_SCALARS, *SECTIONS, *SETTINGS)


def _section(top: Mapping[str, Located], key: str, readers: Mapping[str, Any], kind: Any) -> Any:
    if key not in top:
        return kind()
    return kind(**{name: readers[name](child) for name, child in validators.mapping(top[key], readers).items()})


def _checkpoints(top: Mapping[str, Located]) -> Checkpoints:
    given = _section(top, "checkpoints", _CHECKPOINTS, Checkpoints)
    return replace(given, ratio=exact_root(given.ratio))


def _limits(top: Mapping[str, Located]) -> Limits:
    given = validators.mapping(top["limits"], ("memory",)) if "limits" in top else {}
    return Limits(**{"memory_bytes": validators.size(given["memory"])} if "memory" in given else {})


def exact_root(ratio: float) -> float:
    """A root of two where `ratio` is one to four digits, so that 1.4142 hits every power of two; else `ratio`."""
    root = 2.0 ** (1.0 / max(1, round(1.0 / math.log2(ratio)))) if ratio <= 2.0 else ratio
    return root if abs(root - ratio) < 1e-4 * ratio else ratio


def read_quality(top: Mapping[str, Located]) -> Quality:
    """The section `quality` of a file's top level, or the default."""

    def targets(node: Located) -> tuple[float, ...] | None:
        if node.value == "auto":
            return None
        if not isinstance(node.value, list) or not node.value:
            raise node.refuse("a list of errors, or auto, is wanted")
        above_zero = validators.number(0.0, 1e30, open_low=True)
        return tuple(sorted({above_zero(child) for child in node.value}, reverse=True))

    readers = {"metric": validators.one_of(*METRICS), "epsilon": validators.number(0.0, 1e6, open_low=True), "targets": targets}
    found: Quality = _section(top, "quality", readers, Quality)
    _reachable(top, found)
    return found


def _reachable(top: Mapping[str, Located], quality: Quality) -> None:
    """Refuses targets that no image has, `auto` where qualities rise, and FLIP without its evaluator."""
    from harness.metrics import as_error, higher_is_better

    if quality.metric == "flip" and find_spec("flip_evaluator") is None:
        raise top["quality"].at(("metric",)).refuse("FLIP's evaluator is not installed: pip install 'raybench[flip]'")
    if not higher_is_better(quality.metric):
        return
    if quality.targets is None or "targets" not in top["quality"].value:
        raise top["quality"].refuse(f"targets are wanted with {quality.metric}: there is no default, and auto is for errors")
    if min(as_error(quality.metric, target) for target in quality.targets) <= 0.0:
        raise top["quality"].at(("targets",)).refuse("must be below 1")


def _verify(top: Mapping[str, Located]) -> VerifyConfig | None:
    def cases(node: Located) -> tuple[str, ...]:
        from harness.verify.suite import case_names

        known = case_names()
        for child in validators.listing(node, 1):
            if child.value not in known:
                raise child.refuse(f"unknown case or section: {suggestion(validators.text(child), known)}")
        return tuple(child.value for child in node.value)

    readers = {"cases": ("cases", cases), "quick": ("quick", _switch), "timeout": ("timeout_seconds", validators.duration)}
    if "verify" not in top:
        return None
    given = validators.mapping(top["verify"], readers)
    return VerifyConfig(**{readers[key][0]: readers[key][1](node) for key, node in given.items()})


def _seeds_differ(root: Located, seed: int, repeats: int, reference: ReferenceConfig) -> None:
    """Cells may not draw the reference's numbers: the reference would hold the cell's own noise."""
    used = reference.replicates[1]
    if seed < reference.seed + used and reference.seed < seed + repeats:
        raise root.origin.error(
            f"{root.at(('reference', 'seed')).where}: seeds {reference.seed} and up are the reference's, "
            f"{seed} to {seed + repeats - 1} the cells': choose another reference.seed"
        )


def _resolved(experiment: Experiment) -> dict[str, Any]:
    """The whole experiment as plain data, every default filled in, for the manifest."""
    return {
        "raybench_experiment": SCHEMA_VERSION, "name": experiment.name, "question": experiment.question,
        "source": experiment.source,
        "combinations": [matrix.plain(combination) for combination in experiment.combinations],
        "checkpoints": asdict(experiment.checkpoints), "repeats": experiment.repeats, "seed": experiment.seed,
        "order": {"policy": "blocks", "seed": experiment.order_seed}, "aa_twin": experiment.aa_twin,
        "images": experiment.images, "timing": experiment.timing, "baseline": experiment.baseline,
        "verify": asdict(experiment.verify) if experiment.verify else None, "limits": asdict(experiment.limits),
        "reference": asdict(experiment.reference),
        "quality": {**asdict(experiment.quality), "targets": list(experiment.quality.targets or []) or "auto"},
    }  # fmt: skip
