"""An experiment file becomes an `Experiment`: strict, with file, line and the nearest key in every refusal.

`Experiment` and its sections say every key of a file; `settings.Combination` says those of a cell. These stand at the top level
for all cells or in `matrix` and `zip` as axes; `exclude`, `include` and `extend` then work on the combinations, in that order
(`combinations.expand`). An `include` entry is one whole cell: what it leaves out comes from the top level, else from the first
value of that axis, else from the default.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.schema.keys import Key, Record, Schema
from engines.schema.kinds import BOOLEAN
from engines.schema.yaml_file import Located, locate
from harness.config import sections
from harness.config.combinations import MATRIX, expand
from harness.config.files import ConfigFile, read_file, top_level
from harness.config.filters import CONTESTANTS, Filter
from harness.config.keys import by_field, key, keys_of, written
from harness.config.kinds import LINE, RECORDED, SEED, ListOf, OrNull, integer, number, one_of, version
from harness.config.sections import (
    MOST_REPLICATES,
    Checkpoints,
    EquivalenceConfig,
    Limits,
    Order,
    Pair,
    Quality,
    RaySets,
    ReferenceConfig,
    VerifyConfig,
)
from harness.config.settings import SETTINGS, Combination

EXPERIMENT = "raybench_experiment"
SCHEMA_VERSION = 1
FORMER_RAYS = (
    "comparisons by rays are experiments now: `rays` stands in `matrix` as `engine` does, `count`, `batch`, `bounces`, "
    "`checked` and `hard` in `ray_sets`, `max_time` and `timeout` in `budget` (configs/rays.yaml is an example)"
)
IMAGES = ("all", "some", "last", "none")
PREFERRED_BASELINES = ("numpy", "numba", "embree")
"""The engine whose images others are compared with where a config names none: the first of these that it has."""
FEWEST_TWINS = 4
"""A/A twins of a run. Fewer tell little of what persists between equal contestants."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment.

    `combinations` hold one value of every setting; repeats multiply them later. `source` is the file's name for messages,
    `folder` that of the file, where code that it names is looked for first.
    """

    name: str = key(LINE, "Title of the report, and name of the results folder; by default the name of the file.", None)
    question: str | None = key(LINE, "Question that the experiment answers; the report begins with it.", None)
    revision: str | dict[str, str] | None = key(
        sections.REVISION,
        "Commit or version of the renderer under test, for `raybench history`; or, where one run measures several builds, that "
        "of each, by the name of its engine in tables. By default the commit of the experiment's folder.",
        None,
    )
    repeats: int = key(integer(1, 1000), "Blocks. Each measures every combination once, in random order, with another seed.", 3)
    seed: int = key(SEED, "Seed of the first block; each further block adds one.", 1)
    aa_twin: bool = key(
        BOOLEAN,
        f"Whether some contestants run under a second label, too, as their A/A twins: {FEWEST_TWINS} in all, or one of every "
        "scene if there are more. By default from three repeats on, where times count.",
        None,
    )
    remeasure: int = key(
        integer(0, 100), "Rounds, at the end of a run, in which contended cells are measured again, where times count.", 2
    )
    timing: bool = key(BOOLEAN, "Whether times count. Otherwise cells may run in parallel, on any machine of a cluster.", True)
    images: str = key(
        one_of(*IMAGES),
        "Checkpoints whose images are kept; some: 1, 4 and 16 samples and the last, all of the first block.",
        "some",
    )
    baseline: Filter | None = key(
        OrNull(CONTESTANTS),
        "Filter of the contestant that all others of a race are compared with; a bare name is an engine's. Of several, and "
        "where it matches none of a race, or none is given, the one that has the first value, as written, of every axis.",
        None,
    )
    pairs: tuple[Pair, ...] = key(
        ListOf(sections.PAIR),
        "Further ratios of times, beside those to the baseline of the race and those along each axis.",
        [],
    )
    same_within: float = key(
        number(0.0, 1.0, open_low=True), "Largest difference of times that counts as the same, as a share.", 0.05
    )
    checkpoints: Checkpoints = key(sections.CHECKPOINTS, default={})
    limits: Limits = key(sections.LIMITS, default={})
    order: Order = key(sections.ORDER, default={})
    ray_sets: RaySets = key(sections.RAY_SETS, default={})
    reference: ReferenceConfig = key(sections.REFERENCE, default={})
    quality: Quality = key(sections.QUALITY, default={})
    equivalence: EquivalenceConfig = key(sections.EQUIVALENCE, default={})
    verify: VerifyConfig | None = key(sections.VERIFY, default=None)
    combinations: tuple[Combination, ...] = ()
    warnings: tuple[str, ...] = field(default=(), compare=False)
    source: str = field(default="", compare=False)
    folder: Path = field(default=Path(), compare=False)

    @property
    def renders(self) -> bool:
        """Whether any cell renders, and so needs a reference: others trace rays."""
        return any(combination.rays is None for combination in self.combinations)

    def normalised(self) -> dict[str, Any]:
        """The experiment as plain data that is a valid file: every default filled in, and every combination an `include` entry.

        What the file says of this machine stays as it is: a scene is named as a bare name or a path finds it here.
        """
        include = [written(combination) for combination in self.combinations]
        return {EXPERIMENT: SCHEMA_VERSION, **written(self), "include": include}


KEYS = Record(
    "An experiment.",
    {EXPERIMENT: Key(version(SCHEMA_VERSION), "Version of the format."), **keys_of(Experiment), **SETTINGS, **MATRIX},
)


def experiment_schema() -> Schema:
    """The JSON schema (draft 2020-12) of experiment files: every key with its type, default, unit and meaning, for editors
    and for the documentation. It is no stricter than `load`, which has the last word, but for the former `order.policy`."""
    found = {**KEYS.schema(), "title": "raybench experiment", "patternProperties": {r"^\.": {}}}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def load(given: str | Path | ConfigFile, overrides: Iterable[str] = ()) -> Experiment:
    """The experiment of a path, bare name or file that was read, with `key.key=value` overrides applied."""
    file = given if isinstance(given, ConfigFile) else read_file(given)
    return parse(file.overridden(overrides), file.path.parent, file.path.stem, file.name)


def recorded(data: Any, where: str) -> Experiment:
    """The experiment of which `normalised` made `data`, perhaps on another machine: what it names is not looked up.

    Raises `ConfigError` about the key `config` of the file `where`.
    """
    return parse(locate({"config": data}, where, ConfigError).value["config"], RECORDED, "", where)


def parse(root: Located, context: Any, stem: str = "experiment", source: str = "") -> Experiment:
    """The experiment of a YAML tree. Files that it names are looked up beside `context`, a folder, or not at all where that is
    `RECORDED`; `stem` is the name of one that gives none."""
    top = top_level(root)
    if EXPERIMENT not in top.value:
        former = f"; {FORMER_RAYS}" if "raybench_trace" in top.value else ": this is no experiment"
        raise root.refuse(f"'{EXPERIMENT}: {SCHEMA_VERSION}' is expected{former}")
    top, former = _without_policy(top)
    given = KEYS.read(top, context)
    combinations, warnings = expand(given)
    found = Experiment(
        **by_field(Experiment, given.values),
        combinations=tuple(combinations),
        warnings=(*former, *warnings),
        source=source,
        folder=Path() if context is RECORDED else context,
    )
    _seeds_differ(root, found)
    twin: bool | None = found.aa_twin
    return replace(
        found,
        name=found.name or stem,
        aa_twin=found.repeats >= 3 and found.timing if twin is None else twin,
        remeasure=found.remeasure if found.timing else 0,
    )


def _without_policy(top: Located) -> tuple[Located, list[str]]:
    """The file without `order.policy`, which former files may say, with a warning where it has its only value."""
    order = top.value.get("order")
    policy = order.value.get("policy") if order is not None and isinstance(order.value, dict) else None
    if order is None or policy is None or policy.value != "blocks":
        return top, []
    seed = replace(order, value={name: node for name, node in order.value.items() if name != "policy"})
    warning = f"{policy.where} is no longer needed: cells always run in blocks"
    return replace(top, value={**top.value, "order": seed}), [warning]


def read_quality(root: Located, context: Any = None) -> Quality:
    """The quality of a tree that has the key `quality` and no other."""
    return Record("A quality.", {"quality": KEYS.keys["quality"]}).read(root, context)["quality"]


def _seeds_differ(root: Located, found: Experiment) -> None:
    """Cells may not draw the reference's numbers: the reference would hold the cell's own noise."""
    if not found.renders:
        return
    seed, repeats, reference = found.seed, found.repeats, found.reference
    used = MOST_REPLICATES if reference.spp is None else reference.replicates[1]
    if seed < reference.seed + used and reference.seed < seed + repeats:
        raise root.origin.error(
            f"{root.at(('reference', 'seed')).where}: seeds {reference.seed} and up are the reference's, "
            f"{seed} to {seed + repeats - 1} the cells': choose another reference.seed"
        )
