"""An experiment file becomes an `Experiment`: strict, with file, line and the nearest key in every refusal.

`KEYS` describes them all. Settings stand at the top level for all cells or in `matrix` and `zip` as axes; `exclude`,
`include` and `extend` then work on the combinations, in that order. An `include` entry is one whole cell: what it leaves
out comes from the top level, else from the first value of that axis, else from the default.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.schema.keys import Key, Record, Schema
from engines.schema.kinds import BOOLEAN, Kind
from engines.schema.yaml_file import Located, Origin, parse_yaml, read_yaml
from harness.config import matrix, paths, sections
from harness.config.sections import SEED, Checkpoints, Limits, Quality, ReferenceConfig, VerifyConfig
from harness.config.settings import BUDGET, SETTINGS
from harness.config.validators import LINE, NAME, ListOf, OrNull, integer, mapping, number, one_of

SCHEMA_VERSION = 1
IMAGES = ("all", "some", "last", "none")
PREFERRED_BASELINES = ("numpy", "numba", "embree")
"""The engine that all are compared with where a config names none: the first of these that it has."""


def _version(node: Located) -> int:
    if node.value != SCHEMA_VERSION or node.value is True:
        raise node.refuse(f"must be {SCHEMA_VERSION}")
    return SCHEMA_VERSION


def _section(record: Record) -> Key:
    return Key(record, record.meaning, {})


KEYS = Record(
    "An experiment.",
    {
        "raybench_experiment": Key(Kind(_version, {"const": SCHEMA_VERSION}), "Version of the format."),
        "name": Key(LINE, "Title of the report, and name of the results folder; by default the name of the file.", None),
        "question": Key(LINE, "Question that the experiment answers; the report begins with it.", None),
        "repeats": Key(
            integer(1, 1000), "Blocks. Each measures every combination once, in random order, with a seed of its own.", 3
        ),
        "seed": Key(SEED, "Seed of the first block; each further block adds one.", 1),
        "aa_twin": Key(
            BOOLEAN,
            "Whether one contestant of every scene runs under a second label, too, its A/A twin: the baseline engine's "
            "first configuration there, else the first of all. By default from three repeats on, where times count.",
            None,
        ),
        "remeasure": Key(
            integer(0, 100), "Rounds, at the end of a run, in which contended cells are measured again, where times count.", 2
        ),
        "timing": Key(BOOLEAN, "Whether times count. Otherwise cells may run in parallel, on any machine of a cluster.", True),
        "images": Key(
            one_of(*IMAGES),
            "Checkpoints whose images are kept; some: 1, 4 and 16 samples and the last, all of the first block.",
            "some",
        ),
        "baseline": Key(
            OrNull(NAME), "Engine that speed-ups and images are compared with; by default numpy, else numba, else embree.", None
        ),
        "pairs": Key(
            ListOf(sections.PAIR),
            "Ratios of times between contestants that differ in several settings; others are formed where one differs.",
            [],
        ),
        "same_within": Key(
            number(0.0, 1.0, open_low=True), "Largest difference of times that counts as the same, as a share.", 0.05
        ),
        **SETTINGS,
        **matrix.MATRIX,
        "checkpoints": _section(sections.CHECKPOINTS),
        "limits": _section(sections.LIMITS),
        "order": _section(sections.ORDER),
        "reference": _section(sections.REFERENCE),
        "quality": _section(sections.QUALITY),
        "equivalence": _section(sections.EQUIVALENCE),
        "verify": Key(sections.VERIFY, sections.VERIFY.meaning, None),
    },
)


def experiment_schema() -> Schema:
    """The JSON schema (draft 2020-12) of experiment files: every key with its type, default, unit and meaning, for editors
    and for the documentation. It is no stricter than `load`, which has the last word."""
    found = {**KEYS.schema(), "title": "raybench experiment", "patternProperties": {r"^\.": {}}}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


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
    remeasure: int
    images: str
    timing: bool
    baseline: str | None
    pairs: tuple[Mapping[str, Mapping[str, Any]], ...]
    same_within: float
    warnings: tuple[str, ...]
    resolved: Mapping[str, Any]
    source: str
    verify: VerifyConfig | None
    limits: Limits
    equivalence: Mapping[str, float]
    folder: Path
    """That of the file, where code that it names is looked for first."""


def load(given: str | Path, overrides: Iterable[str] = ()) -> Experiment:
    """The experiment of a path or bare name, with `key.key=value` overrides applied."""
    path = paths.find("configs", str(given))
    shown = paths.shown(path)
    root = read_yaml(path, ConfigError, shown)
    for text in overrides:
        root = override(root, text)
    return parse(root, path.parent, path.stem, shown)


def parse(root: Located, folder: Path, stem: str = "experiment", source: str = "") -> Experiment:
    """The experiment of a YAML tree; scene paths are looked up beside `folder`."""
    top = {key: node for key, node in mapping(root).items() if not key.startswith(".")}
    if "raybench_experiment" not in top:
        raise root.refuse(f"'raybench_experiment: {SCHEMA_VERSION}' is expected: this is no experiment")
    given = KEYS.read(replace(root, value=top), folder)
    settings = {key: given[key] for key in SETTINGS} | {"budget": BUDGET.merged(given["budget"])}
    combinations, warnings = matrix.expand(given, settings)
    repeats, seed, timing = given["repeats"], given["seed"], given["timing"]
    aa_twin = repeats >= 3 and timing if given["aa_twin"] is None else given["aa_twin"]
    _seeds_differ(root, seed, repeats, given["reference"])
    experiment = Experiment(
        name=given["name"] or stem,
        question=given["question"] or "",
        combinations=tuple(combinations),
        checkpoints=given["checkpoints"],
        repeats=repeats,
        seed=seed,
        order_seed=given["order"]["seed"],
        reference=given["reference"],
        quality=given["quality"],
        aa_twin=aa_twin,
        remeasure=given["remeasure"] if timing else 0,
        images=given["images"],
        warnings=tuple(warnings),
        resolved={},
        source=source,
        verify=given["verify"],
        timing=timing,
        baseline=given["baseline"],
        limits=given["limits"],
        equivalence=given["equivalence"],
        pairs=tuple(given["pairs"]),
        same_within=given["same_within"],
        folder=folder,
    )
    return replace(experiment, resolved=_resolved(experiment))


def read_quality(root: Located) -> Quality:
    """The quality of a tree that has the key `quality` and no other."""
    return Record("A quality.", {"quality": KEYS.keys["quality"]}).read(root)["quality"]


# --- overrides ------------------------------------------------------------------------------------------------------


def override(root: Located, text: str) -> Located:
    """`root` with one `a.b=value` set; the value is YAML. A key that does not exist is made, and checked later."""
    key, equals, value = text.partition("=")
    steps = tuple(key.strip().split("."))
    if not equals or not all(steps):
        raise ConfigError(f"--set {text}: must look like budget.max_time=5s")
    parsed = parse_yaml(value, f"--set {key}", ConfigError)
    mapping(root)
    return _with(root, steps, parsed)


def _with(node: Located, steps: tuple[str, ...], value: Located) -> Located:
    children = dict(mapping(node))
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


# --- whole experiments ----------------------------------------------------------------------------------------------


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
        "raybench_experiment": SCHEMA_VERSION,
        "name": experiment.name,
        "question": experiment.question,
        "source": experiment.source,
        "combinations": [matrix.plain(combination) for combination in experiment.combinations],
        "checkpoints": asdict(experiment.checkpoints),
        "repeats": experiment.repeats,
        "seed": experiment.seed,
        "order": {"policy": "blocks", "seed": experiment.order_seed},
        "aa_twin": experiment.aa_twin,
        "remeasure": experiment.remeasure,
        "images": experiment.images,
        "timing": experiment.timing,
        "baseline": experiment.baseline,
        "pairs": list(experiment.pairs),
        "same_within": experiment.same_within,
        "verify": asdict(experiment.verify) if experiment.verify else None,
        "limits": asdict(experiment.limits),
        "reference": asdict(experiment.reference),
        "equivalence": experiment.equivalence,
        "quality": {**asdict(experiment.quality), "targets": list(experiment.quality.targets or []) or "auto"},
    }
