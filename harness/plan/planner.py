"""From an experiment to cells: the spec of each, its id, and what cannot be done.

`loaded` has the engines and scenes, `reference_specs` plans the references.
"""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from engines import memory
from engines.choices import Choice
from engines.errors import ConfigError, suggestion
from engines.film import BYTES_A_PIXEL as FILM_BYTES
from engines.registry import is_file
from engines.scene import Scene, counted, primitives_of
from engines.schema.yaml_file import locate
from harness.config import SCHEMA_VERSION, Experiment
from harness.config.experiment import FEWEST_TWINS, PREFERRED_BASELINES
from harness.config.filters import Filter
from harness.config.paths import shown
from harness.config.settings import SHADER, Budget, Combination
from harness.hashing import digest
from harness.measure.schedule import Schedule
from harness.metrics import as_error
from harness.plan import answers
from harness.plan.cells import Cell, Plan
from harness.plan.loaded import Loaded
from harness.plan.patterns import full_patterns
from harness.plan.ray_sets import PlannedRaySet
from harness.plan.reference_specs import by_id, reference_of
from harness.plan.references import PlannedReference
from harness.plan.verify_jobs import planned
from harness.processes import allow_here
from harness.settings import CellSettings, TracerSettings
from harness.source_hashes import environment_of, plugin_codes
from harness.trace import rays

BYTES_A_PIXEL = 2 * FILM_BYTES + 4 * 3 * 8
"""Of a cell: a film where it is rendered and one here, and the reference's mean, halves and variance."""
AA_LABEL = "A/A"
"""Of the first twin of a contestant; that of its second is `A/A 2`."""


def make(
    experiment: Experiment, allow_imports: bool = False, allow_commands: bool = False, allow_outside: bool = False
) -> Plan:
    """The plan of an experiment. Raises `RaybenchError` for names, options and scenes that do not exist."""
    allow_here(allow_imports, experiment.folder)
    known = Loaded(experiment, allow_imports, allow_commands, allow_outside)
    found = [_configured(experiment, combination, known) for combination in experiment.combinations]
    references = by_id(experiment, found)
    _one_division(experiment, found)
    _one_budget(experiment, found)
    _stops_behind_the_targets(experiment, found)
    configurations = _with_aa_twins(experiment, [cell for cell, _ in found])
    cells: list[Cell] = []
    for block in range(experiment.repeats):
        members = sorted((_in_block(cell, experiment, block) for cell in configurations), key=lambda cell: cell.cell_id)
        # The order depends on the seed and on the specs, not on how the file is written.
        random.Random(f"{experiment.order.seed}/{block}").shuffle(members)
        cells += [replace(cell, order=len(cells) + index) for index, cell in enumerate(members)]
    unique = {cell.cell_id: cell for cell in reversed(cells)}
    cells = [cell for cell in cells if unique[cell.cell_id] is cell]
    warned = [f"{shown(Path(file.path))}: {text}" for file, scene in known.scenes.items() for text in scene.warnings]
    _baseline_exists(experiment, configurations)
    _pairs_exist(experiment, configurations)
    compared = dict.fromkeys(combination.engine for combination in experiment.combinations)
    verify_jobs = planned(experiment.verify, {name: known.engines[name] for name in compared})
    return Plan(experiment, tuple(cells), references, (*experiment.warnings, *warned), verify_jobs)


def _baseline_exists(experiment: Experiment, configurations: Iterable[Cell]) -> None:
    """Refuses a baseline that is no contestant of the experiment, under the names that tables use."""
    if experiment.baseline is not None:
        _matching(experiment.baseline, [settings_of(cell) for cell in configurations], f"{experiment.source} baseline")


def settings_of(cell: Cell) -> SimpleNamespace:
    """What a filter of contestants is asked about: the settings by the names of their keys, the engine by that of tables."""
    settings = cell.settings
    own = settings.fields()
    if isinstance(settings, CellSettings):
        own["resolution"] = (settings.width, settings.height)
    rays = None if cell.ray_set is None else cell.ray_set.kind
    return SimpleNamespace(scene=cell.scene.name, engine=cell.engine_name, rays=rays, division=cell.division, **own)


def _matching(given: Filter, runs: Sequence[SimpleNamespace], where: str) -> list[SimpleNamespace]:
    """The contestants that a filter matches. Where it matches none, the refusal names the setting that none has."""
    if found := [each for each in runs if given.matches(each)]:
        if idle := given.idle_members(runs):
            key, _, written = idle[0]
            raise ConfigError(f"{where} = {given}: no contestant of this experiment has {key} {json.dumps(written)}")
        return found
    for key, condition in given.conditions.items():
        named = isinstance(given.written[key], str)
        values = list(dict.fromkeys(_words(getattr(each, key), named) for each in runs if hasattr(each, key)))
        if not any(hasattr(each, key) and condition(getattr(each, key)) for each in runs):
            value = given.written[key]
            near = suggestion(value, values) if isinstance(value, str) else f"known: {', '.join(values) or 'none'}"
            if len(given.written) == 1 and isinstance(value, str):
                raise ConfigError(f"{where}{_inner(given)} = {value!r}: no {key} of this experiment: {near}")
            raise ConfigError(f"{where} = {given}: no contestant of this experiment has these settings; {key}: {near}")
    raise ConfigError(f"{where} = {given}: no contestant of this experiment has these settings together")


def _inner(given: Filter) -> str:
    (key,) = given.written
    return "" if key == "engine" else f".{key}"


def _words(value: Any, named: bool) -> str:
    """A setting as a message prints it; where a name was given, choices without their options."""
    if isinstance(value, tuple):
        return "x".join(map(str, value))
    return value.name if named and isinstance(value, Choice) else str(value)


def _one_division(experiment: Experiment, found: Iterable[tuple[Cell, Any]]) -> None:
    """Refuses a contestant that is in both divisions."""
    divisions: dict[str, str] = {}
    for cell, _ in found:
        if divisions.setdefault(cell.configuration, cell.division) != cell.division:
            raise ConfigError(
                f"{experiment.source} division: {cell.scene.name} by {cell.engine_name} is in both, closed and open: "
                "a contestant is in one"
            )


def _one_budget(experiment: Experiment, found: Iterable[tuple[Cell, Any]]) -> None:
    """Refuses a contestant that has several budgets in a scene: its results would stand together, as those of one."""
    budgets: dict[Any, Budget] = {}
    for cell, _ in found:
        contestant = cell.scene, cell.engine_name, cell.ray_set, json.dumps(cell.settings.describe(), sort_keys=True)
        if budgets.setdefault(contestant, cell.budget) != cell.budget:
            raise ConfigError(
                f"{experiment.source} budget: {cell.scene.name} by {cell.engine_name} has several with the same settings "
                "otherwise: a contestant has one"
            )


def _stops_behind_the_targets(experiment: Experiment, found: Iterable[tuple[Cell, Any]]) -> None:
    """Refuses cells that end at an error before the smallest target."""
    quality = experiment.quality
    smallest = min((as_error(quality.metric, target) for target in quality.targets or ()), default=0.0)
    for cell, _ in found:
        stop = cell.budget.stop_at_error
        if stop is not None and 0 < smallest < stop:
            raise ConfigError(
                f"{experiment.source} budget.stop_at_error = {stop:g}: at most the smallest target, {smallest:g}, is expected"
            )


def _pairs_exist(experiment: Experiment, configurations: Iterable[Cell]) -> None:
    """Refuses a pair with a side that is no contestant of the experiment, and one whose sides are in different divisions."""
    runs = [settings_of(cell) for cell in configurations if cell.ray_set is None]
    if experiment.pairs and not runs:
        raise ConfigError(f"{experiment.source} pairs: they are of cells that render, and all of this experiment trace rays")
    for index, pair in enumerate(experiment.pairs):
        where = f"{experiment.source} pairs[{index}]"
        sides = (("contestant", pair.contestant), ("baseline", pair.baseline))
        divisions = [{each.division for each in _matching(given, runs, f"{where}.{side}")} for side, given in sides]
        if not set.intersection(*divisions):
            raise ConfigError(f"{where}: its sides are in different divisions, which are not compared")


def _shader_of(scene: Scene) -> Choice:
    """The shader that the scene's file names, or its media need."""
    return SHADER.read(locate(scene.shader or "path_tracer", "", ConfigError))


def _configured(experiment: Experiment, combination: Combination, known: Loaded) -> tuple[Cell, PlannedReference | None]:
    """A configuration as a cell without block and seed, and the reference it needs."""
    if combination.rays is not None:
        return _tracing(experiment, combination, combination.rays, known), None
    file = known.file(combination)
    scene, engine = known.scenes[file], known.engines[combination.engine]
    accelerator, lacking = known.accelerator(combination.engine, combination.accelerator)
    width, height = combination.resolution or scene.camera.resolution
    memory.require(BYTES_A_PIXEL * width * height, f"{experiment.source} resolution: a cell of {width}x{height} pixels")
    settings = CellSettings(
        shader=known.completed("shader", combination.shader or _shader_of(scene)),
        sampler=known.completed("sampler", combination.sampler),
        accelerator=accelerator,
        precision=combination.precision or "float64",
        threads=combination.threads,
        width=int(width),
        height=int(height),
    )
    if combination.precision is None and not lacking:
        settings = replace(settings, precision=answers.precision(engine, scene, settings, known.allow_imports))
    skip = lacking or answers.why_not(engine, scene, settings, known.allow_imports)
    wanted, unreferenced = reference_of(experiment, file, scene, settings, known)
    skip = skip or unreferenced
    budget = combination.budget
    patterns = None if skip else full_patterns(engine, settings.sampler, Schedule.of(experiment.checkpoints, budget))
    if patterns == ():
        skip = f"no whole pattern of its sampler has at most {budget.max_spp} samples per pixel, the budget.max_spp"
    more = {
        "max_spp": budget.max_spp,
        "checkpoints": experiment.checkpoints.describe(),
        **({"patterns": [asdict(each) for each in patterns]} if patterns else {}),
        **({"stop_at_error": budget.stop_at_error} if budget.stop_at_error is not None else {}),
    }
    cell = _cell(
        combination,
        known,
        settings,
        more,
        skip,
        reference_id=wanted.reference_id if wanted and not skip else None,
        smooth_sampler=answers.is_smooth(engine, settings.sampler, known.allow_imports),
        reproducible=answers.is_reproducible(engine),
        patterns=patterns or (),
        raced=experiment.reference.shader,
        auto_accelerator="" if skip else answers.auto_accelerator(engine, scene, settings, known.allow_imports),
    )
    return cell, None if skip else wanted


def _tracing(experiment: Experiment, combination: Combination, kind: str, known: Loaded) -> Cell:
    """A configuration that traces rays of a kind."""
    file = known.file(combination)
    scene, engine = known.scenes[file], known.engines[combination.engine]
    accelerator, skip = known.accelerator(combination.engine, combination.accelerator)
    settings = TracerSettings(accelerator, combination.precision, combination.threads)
    if is_file(combination.engine):
        skip = "an external renderer traces no single rays"
    skip = skip or rays.why_not(kind, scene) or answers.why_no_tracer(engine, scene, settings, known.allow_imports)
    ray_set = PlannedRaySet(file, scene.identity, kind, experiment.ray_sets, experiment.seed)
    more = {"ray_set": {**ray_set.spec, "batch": experiment.ray_sets.batch}}
    return _cell(combination, known, settings, more, skip, ray_set=ray_set)


def _cell(
    combination: Combination,
    known: Loaded,
    settings: CellSettings | TracerSettings,
    spec: Mapping[str, Any],
    skip: str | None,
    **more: Any,
) -> Cell:
    """A cell without block and seed. `spec` is what its own has besides engine, scene, settings and time; `more` are fields."""
    file = known.file(combination)
    scene, engine, named = known.scenes[file], known.engines[combination.engine], known.names[combination.engine]
    plain = settings.describe()
    whole = {
        "schema": SCHEMA_VERSION,
        "scene": scene.identity,
        "engine": named,
        "engine_version": str(engine.version),
        **plain,
        "max_time_seconds": combination.budget.max_time_seconds,
        "label": None,
        "code": {"engine": known.code(combination.engine), **plugin_codes(plain)},
        **({"environment": environment} if (environment := environment_of(engine)) else {}),
        **spec,
    }
    return Cell(
        cell_id="",
        configuration=digest(whole),
        spec=whole,
        block=0,
        order=0,
        seed=0,
        label=None,
        scene=file,
        scene_hash=scene.identity,
        engine=combination.engine,
        engine_name=named,
        settings=settings,
        budget=combination.budget,
        skip=skip,
        primitives=primitive_count(scene),
        division=combination.division,
        **more,
    )


def primitive_count(scene: Scene) -> int:
    """Triangles, spheres and other shapes that rays can hit; an instance has those of its group."""
    return sum(times * primitives_of(shape) for shape, times in counted(scene.shapes))


def _with_aa_twins(experiment: Experiment, configurations: list[Cell]) -> list[Cell]:
    """The configurations, and some of them again under another label: what persists between two equal ones is what the machine
    does. `FEWEST_TWINS`, or one in every scene (of rays: in every race) if these are more. Each is of a configuration that has
    the fewest so far, of these of an engine that has the fewest: in turn of a fast one and of a slow one."""
    if not experiment.aa_twin:
        return configurations
    races: dict[Any, list[Cell]] = {}
    for cell in configurations:
        if not cell.skip:
            race = cell.ray_set and (cell.ray_set.kind, cell.settings.threads)
            races.setdefault((cell.scene.path, cell.scene.parameters, race), []).append(cell)
    groups, twins = list(races.values()), list[Cell]()
    for number in range(max(FEWEST_TWINS, len(groups)) if groups else 0):
        lap, place = divmod(number, len(groups))
        twins.append(_twin(groups[place], twins, slow=(lap + place) % 2 == 1))
    return [*configurations, *twins]


def _twin(cells: list[Cell], twins: list[Cell], slow: bool) -> Cell:
    """One more beside `twins`, of one of `cells`."""
    of_it, of_engine = Counter(twin.configuration for twin in twins), Counter(twin.engine_name for twin in twins)
    sign = 1 if slow else -1
    original = min(cells, key=lambda cell: (of_it[cell.configuration], of_engine[cell.engine_name], sign * _speed_rank(cell)))
    count = of_it[original.configuration]
    return replace(original, label=f"{AA_LABEL} {count + 1}" if count else AA_LABEL)


def _speed_rank(cell: Cell) -> int:
    """Of the engine, as far as that is known without a measurement: numpy is the slowest."""
    return PREFERRED_BASELINES.index(cell.engine_name) if cell.engine_name in PREFERRED_BASELINES else len(PREFERRED_BASELINES)


def _in_block(cell: Cell, experiment: Experiment, block: int) -> Cell:
    seed = experiment.seed + block
    spec = {**cell.spec, "label": cell.label, "seed": seed}
    return replace(cell, spec=spec, cell_id=digest(spec), block=block, seed=seed)
