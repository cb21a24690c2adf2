"""From an experiment to cells: the spec of each, its id, and what cannot be done.

All engines and scenes are loaded here once, so that every mistake in a name is found before anything runs.
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
from engines.choices import SAMPLERS, Choice, resolve
from engines.errors import ConfigError, RaybenchError, UnknownName, suggestion
from engines.film import BYTES_A_PIXEL as FILM_BYTES
from engines.interface import Engine
from engines.registry import engine as engine_of
from engines.registry import is_file, lineage_of
from engines.scene import Scene
from harness.config import SCHEMA_VERSION, Experiment
from harness.config.experiment import FEWEST_TWINS, PREFERRED_BASELINES
from harness.config.filters import Filter
from harness.config.paths import shown
from harness.config.sections import AUTOMATIC, REFERENCE_ENGINE
from harness.config.settings import Budget, Combination, SceneFile
from harness.hashing import digest
from harness.measure.machine import usable_cores
from harness.measure.schedule import Schedule
from harness.metrics import as_error
from harness.plan import answers, certifiers
from harness.plan.cells import Cell, Plan, flow
from harness.plan.names import names_of
from harness.plan.patterns import full_patterns
from harness.plan.ray_sets import PlannedRaySet
from harness.plan.references import Certifier, PlannedReference
from harness.plan.verify_jobs import planned
from harness.processes import allow_here
from harness.settings import CellSettings, TracerSettings, completed, require_commands, require_imports
from harness.source_hashes import engine_code, environment_of, plugin_codes
from harness.statistics.reference_noise import SAMPLES_KNOWN
from harness.trace import rays

BYTES_A_PIXEL = 2 * FILM_BYTES + 4 * 3 * 8
"""Of a cell: a film where it is rendered and one here, and the reference's mean, halves and variance."""
AA_LABEL = "A/A"
"""Of the first twin of a contestant; that of its second is `A/A 2`."""
DEFAULT_SPP = 8192
"""Of a reference where neither the config nor its targets say how many, and the most that its certifier renders."""


def make(
    experiment: Experiment, allow_imports: bool = False, allow_commands: bool = False, allow_outside: bool = False
) -> Plan:
    """The plan of an experiment. Raises `RaybenchError` for names, options and scenes that do not exist."""
    allow_here(allow_imports, experiment.folder)
    known = _Known(experiment, allow_imports, allow_commands, allow_outside)
    found = [_configured(experiment, combination, known) for combination in experiment.combinations]
    references = _with_time(experiment, found)
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


class _Known:
    """Every engine and scene that the experiment names, loaded once."""

    def __init__(self, experiment: Experiment, allow_imports: bool, allow_commands: bool, allow_outside: bool) -> None:
        self.allow_imports, self.allow_outside, self._source = allow_imports, allow_outside, experiment.source
        names = dict.fromkeys(combination.engine for combination in experiment.combinations)
        self.engines: dict[str, Engine] = {}
        reference = experiment.reference
        certify = None if reference.certify == AUTOMATIC else reference.certify
        self.reference_engines = (
            (reference.engine,) if reference.engine else (REFERENCE_ENGINE, *list(names)[: len(names) == 1])
        )
        for name in filter(None, [*names, *((*self.reference_engines, certify) if experiment.renders else ())]):
            require_imports(name, allow_imports)
            require_commands(name, allow_commands)
            answers.accelerators(self.engines.setdefault(name, engine_of(name)))  # raises: it cannot list them
        self.names = names_of(self.engines)
        self.candidates: dict[str, Engine | None] = {}
        self._codes: dict[str, str] = {}
        files = dict.fromkeys(self.file(combination) for combination in experiment.combinations)
        self.scenes: dict[SceneFile, Scene] = {file: file.load(allow_imports) for file in files}

    def file(self, combination: Combination) -> SceneFile:
        """The scene's file, as it may be read."""
        return replace(combination.scene, allow_outside=self.allow_outside)

    def code(self, name: str) -> str:
        """The hash of an engine's code."""
        if name not in self._codes:
            engine = self.candidate(name)
            assert engine is not None
            self._codes[name] = engine_code(engine, name)
        return self._codes[name]

    def candidate(self, name: str) -> Engine | None:
        """An engine, whether or not the experiment names it; None where it cannot be loaded."""
        if name in self.engines:
            return self.engines[name]
        if name not in self.candidates:
            try:
                self.candidates[name] = engine_of(name)
            except RaybenchError:
                self.candidates[name] = None
        return self.candidates[name]

    def completed(self, kind: str, given: Choice) -> Choice:
        """A choice with all options of the plugin that it names. Raises `ConfigError` with the experiment's file."""
        try:
            return completed(kind, given, self.allow_imports)
        except RaybenchError as error:
            raise ConfigError(f"{self._source}: {error}") from error

    def accelerator(self, name: str, given: Choice) -> tuple[Choice, str | None]:
        """The accelerator with its options, and why the engine has none such. Unknown to all engines is an error."""
        if ":" in given.name:
            return self.completed("accelerator", given), None
        if answers.resolves(self.engines[name], given):
            return answers.resolved(self.engines[name], given), None
        if any(answers.resolves(other, given) for other in self.engines.values()):
            return given, f"the engine {name} has no accelerator {flow(given)}"
        for other in self.engines.values():
            if given.name in answers.accelerators(other):
                answers.resolved(other, given)  # raises: it knows the name, but not the options
        raise UnknownName("accelerator", given.name, {a for e in self.engines.values() for a in answers.accelerators(e)})


def _configured(experiment: Experiment, combination: Combination, known: _Known) -> tuple[Cell, PlannedReference | None]:
    """A configuration as a cell without block and seed, and the reference it needs."""
    if combination.rays is not None:
        return _tracing(experiment, combination, combination.rays, known), None
    file = known.file(combination)
    scene, engine = known.scenes[file], known.engines[combination.engine]
    accelerator, lacking = known.accelerator(combination.engine, combination.accelerator)
    width, height = combination.resolution or scene.camera.resolution
    memory.require(BYTES_A_PIXEL * width * height, f"{experiment.source} resolution: a cell of {width}x{height} pixels")
    settings = CellSettings(
        shader=known.completed("shader", combination.shader),
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
    wanted, unreferenced = _reference(experiment, file, scene, settings, known)
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


def _tracing(experiment: Experiment, combination: Combination, kind: str, known: _Known) -> Cell:
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
    known: _Known,
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
    """Triangles, spheres and other shapes: what a tree is built over."""
    parts = (getattr(shape, "faces", getattr(shape, "radii", None)) for shape in scene.shapes)
    return sum(1 if part is None else len(part) for part in parts)


def _reference(
    experiment: Experiment, file: SceneFile, scene: Scene, settings: CellSettings, known: _Known
) -> tuple[PlannedReference | None, str | None]:
    """The reference of a scene, shader and size; or why no engine that may can make it."""
    reasons: dict[str, str] = {}
    for name in dict.fromkeys(known.reference_engines):
        planned, why_not = _reference_by(name, experiment, file, scene, settings, known)
        if planned is not None:
            return planned, None
        reasons[name] = f"no reference by {name}: {why_not}"
    return None, "; ".join(reasons.values())


def _reference_by(
    name: str, experiment: Experiment, file: SceneFile, scene: Scene, settings: CellSettings, known: _Known
) -> tuple[PlannedReference | None, str | None]:
    """The reference by an engine; or why it cannot make it. A sampler that no config names may be independent numbers, too."""
    given = experiment.reference
    engine = known.engines[name]
    settings = replace(
        settings,
        precision=given.precision or "float64",
        threads=1,
        sampler=given.sampler,
        shader=known.completed("shader", given.shader or settings.shader),
        accelerator=answers.resolved(engine, given.accelerator),
    )
    if given.precision is None:
        settings = replace(settings, precision=answers.precision(engine, scene, settings, known.allow_imports))
    why_not = answers.why_not(engine, scene, settings, known.allow_imports)
    if why_not and given.engine is None and name != REFERENCE_ENGINE:
        settings = replace(settings, sampler=resolve("sampler", "random", SAMPLERS))
        why_not = answers.why_not(engine, scene, settings, known.allow_imports)
    if why_not:
        return None, why_not
    until = _until(experiment)
    if given.spp is None and until is None:
        given = replace(given, spp=DEFAULT_SPP)
    each, count = given.replicates
    plain = settings.describe()
    spec = {
        "schema": SCHEMA_VERSION,
        "scene": scene.identity,
        "engine": name,
        "engine_version": str(engine.version),
        "replicate_spp": each,
        "replicates": count,
        **({"until": until} if given.spp is None else {}),
        "seed": given.seed,
        **{key: value for key, value in plain.items() if key != "threads"},
    }
    spec["code"] = {"engine": known.code(name), **plugin_codes(plain)}
    planned = PlannedReference(
        file,
        scene.identity,
        spec,
        replace(settings, threads=given.threads or len(usable_cores())),
        lineage_of(engine),
        margins=experiment.equivalence.margins,
    )
    return replace(planned, certifier=_certifier(experiment, scene, planned, known)), None


def _until(experiment: Experiment) -> dict[str, Any] | None:
    """What decides the samples of a reference whose number is not given; None where no formula does."""
    quality, most = experiment.quality, experiment.reference.max_time_seconds
    if quality.targets is None or quality.metric not in SAMPLES_KNOWN:
        return None
    return {
        "metric": quality.metric,
        "epsilon": quality.epsilon if quality.metric == "relmse" else None,
        "target": min(as_error(quality.metric, target) for target in quality.targets),
        **({} if most is None else {"max_seconds": most}),
    }


def _with_time(experiment: Experiment, found: Iterable[tuple[Cell, PlannedReference | None]]) -> dict[str, PlannedReference]:
    """The references by id, each with the time that it may take: that of the config, else that of its cells."""
    references: dict[str, PlannedReference] = {}
    for cell, wanted in found:
        if wanted is not None:
            before = references.get(wanted.reference_id)
            seconds = cell.budget.max_time_seconds * experiment.repeats + (before.max_seconds if before else 0.0)
            references[wanted.reference_id] = replace(wanted, max_seconds=seconds)
    given = experiment.reference.max_time_seconds
    return {key: each if given is None else replace(each, max_seconds=given) for key, each in references.items()}


def _certifier(experiment: Experiment, scene: Scene, wanted: PlannedReference, known: _Known) -> Certifier | None:
    """The engine that the config names, or the first able one of another lineage."""
    name, width, height = experiment.reference.certify, wanted.spec["width"], wanted.spec["height"]
    if name is None:
        return None
    if name == AUTOMATIC:
        names = certifiers.candidates(width, height)
        return certifiers.first_able(names, wanted.lineage, lambda name: _as_certifier(name, scene, wanted, known))
    engine, by = known.engines[name], wanted.spec["engine"]
    where = f"{experiment.source} reference.certify"
    certifiers.refuse_own_lineage(where, engine, name, known.engines[by], by)
    return _as_certifier(name, scene, wanted, known)


def _as_certifier(name: str, scene: Scene, wanted: PlannedReference, known: _Known) -> Certifier | None:
    """How an engine would certify: its own accelerator and precision; None where it cannot be loaded."""
    engine = known.candidate(name)
    if engine is None:
        return None
    lineage = lineage_of(engine)
    spp = DEFAULT_SPP if wanted.until else wanted.spp
    share = certifiers.share(lineage, wanted.spec["width"], wanted.spec["height"], spp)
    given = certifiers.smaller(wanted.settings, share.factor)
    given = replace(given, accelerator=answers.resolved(engine, Choice("auto")))
    why_not: str | None = None
    for sampler in (given.sampler, *certifiers.samplers(share.spp)):
        given = replace(given, sampler=sampler)
        given = replace(given, precision=answers.precision(engine, scene, given, known.allow_imports))
        why_not = answers.why_not(engine, scene, given, known.allow_imports)
        if why_not is None:
            break
    return Certifier(name, lineage, f"{engine.version}+{known.code(name)[:8]}", given, share.spp, share.factor, why_not)


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
