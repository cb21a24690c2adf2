"""From an experiment to cells: what is asked of which engine, under which id, and what cannot be done.

A configuration is one combination of settings; a cell is a configuration in one block, under that block's seed. All
engines and scenes are loaded here once, so that every mistake in a name is found before anything runs.
"""

from __future__ import annotations

import random
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from engines import choices, memory
from engines.errors import ConfigError, RaybenchError, UnknownName, suggestion
from engines.film import BYTES_A_PIXEL as FILM_BYTES
from engines.interface import Engine
from engines.registry import engine as engine_of
from engines.registry import is_file, load_attribute
from engines.scene import Scene, load_scene
from harness import catalog
from harness.config import SCHEMA_VERSION, Experiment
from harness.examinations import Examination, planned
from harness.identity import digest
from harness.references import Certifier, ReferenceWanted
from harness.settings import Budget, SceneFile, engine_settings, require_commands, require_imports
from harness.sources import engine_code, plugin_code

BYTES_A_PIXEL = 2 * FILM_BYTES + 4 * 3 * 8
"""Of a cell: a film where it is rendered and one here, and the reference's mean, halves and variance."""
CONTROL_LABEL = "A/A"
WARM_UP_SEED = 1 << 40
"""Added to a cell's seed for the pass that is discarded."""
OVERHEAD_SECONDS = 4.0
"""A guess at what a cell costs beside its rendering, where nothing has been measured yet."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One point of a sweep. `asked` is the preimage of `cell_id`; `settings` are plain data for the engine."""

    cell_id: str
    configuration: str
    asked: Mapping[str, Any]
    block: int
    order: int
    seed: int
    label: str | None
    scene: SceneFile
    scene_hash: str
    engine: str
    engine_name: str
    settings: Mapping[str, Any]
    budget: Budget
    reference_id: str | None
    skip: str | None
    primitives: int = 0
    """Triangles, spheres and planes of the scene."""

    def command(self, spp: int) -> str:
        """The command that renders `spp` samples of this cell again, to the bit."""
        from shlex import quote

        engine = _from_here(Path(self.engine)) if is_file(self.engine) else self.engine
        plain = {kind: self.settings[kind] for kind in ("shader", "sampler", "accelerator")}
        words = ["raybench", "render", _scene_word(self.scene), "--engine", engine]
        for kind, choice in plain.items():
            words += [f"--{kind}", flow(choice)]
        words += ["--threads", str(self.settings["threads"]), "--precision", self.settings["precision"]]
        words += ["--size", f"{self.settings['width']}x{self.settings['height']}", "--seed", str(self.seed)]
        words += ["--spp", str(spp), "-o", "image.exr", *(["--allow-commands"] if is_file(self.engine) else [])]
        return " ".join(quote(word) for word in words)


@dataclass(frozen=True, slots=True)
class Plan:
    """Cells in the order in which they run, the references they need by id, and what is asked of the battery."""

    experiment: Experiment
    cells: tuple[Cell, ...]
    references: Mapping[str, ReferenceWanted]
    warnings: tuple[str, ...]
    examinations: tuple[Examination, ...] = ()


def _scene_word(scene: SceneFile) -> str:
    """A scene for a command line: its bare name where that finds it, else its path, from here if it lies below."""
    path = Path(scene.path)
    if scene.name in (known := catalog.shipped("scenes")) and known[scene.name].resolve() == path:
        return scene.name
    return _from_here(path)


def _from_here(path: Path) -> str:
    """A path as it can be written in the working directory: short where it lies below."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def flow(choice: Mapping[str, Any]) -> str:
    """A choice as a command line takes it: its name, or a YAML flow mapping."""
    import json

    if set(choice) == {"name"}:
        return choice["name"]
    pairs = [f"{key}: {value if key == 'name' else json.dumps(value)}" for key, value in choice.items()]
    return "{" + ", ".join(pairs) + "}"


def words(choice: Mapping[str, Any]) -> str:
    """A choice as people read it: path_tracer(max_depth=6)."""
    options = ", ".join(f"{key}={value}" for key, value in choice.items() if key != "name")
    return f"{choice['name']}({options})" if options else str(choice["name"])


def make(experiment: Experiment, allow_imports: bool = False, allow_commands: bool = False) -> Plan:
    """The plan of an experiment. Raises `RaybenchError` for names, options and scenes that do not exist."""
    known = _Known(experiment, allow_imports, allow_commands)
    found = [_configured(experiment, combination, known) for combination in experiment.combinations]
    references = {wanted.reference_id: wanted for cell, wanted in found if wanted is not None}
    configurations = _with_control(experiment, [cell for cell, _ in found])
    cells: list[Cell] = []
    for block in range(experiment.repeats):
        members = sorted((_in_block(cell, experiment, block) for cell in configurations), key=lambda cell: cell.cell_id)
        # The order depends on the seed and on what is asked, not on how the file is written.
        random.Random(f"{experiment.order_seed}/{block}").shuffle(members)
        cells += [replace(cell, order=len(cells) + index) for index, cell in enumerate(members)]
    unique = {cell.cell_id: cell for cell in reversed(cells)}
    cells = [cell for cell in cells if unique[cell.cell_id] is cell]
    scenes = {path: scene.warnings for path, scene in known.scenes.items()}
    warned = [f"{path}: {warning}" for path, told in scenes.items() for warning in told]
    _baseline_runs(experiment, {cell.engine_name for cell in cells})
    compared = {str(combination["engine"]): None for combination in experiment.combinations}
    examinations = planned(experiment.verify, {name: known.engines[name] for name in compared})
    return Plan(experiment, tuple(cells), references, (*experiment.warnings, *warned), examinations)


def _baseline_runs(experiment: Experiment, engines: set[str]) -> None:
    """Refuses a baseline that is no engine of the experiment, under the name that tables use."""
    if experiment.baseline is not None and experiment.baseline not in engines:
        near = suggestion(experiment.baseline, engines)
        raise ConfigError(f"{experiment.source} baseline = {experiment.baseline!r}: no engine of this experiment: {near}")


class _Known:
    """Every engine and scene that the experiment names, loaded once."""

    def __init__(self, experiment: Experiment, allow_imports: bool, allow_commands: bool) -> None:
        self.allow_imports = allow_imports
        names = dict.fromkeys(str(combination["engine"]) for combination in experiment.combinations)
        self.engines: dict[str, Engine] = {}
        for name in filter(None, [*names, experiment.reference.engine, experiment.reference.certify]):
            require_imports(name, allow_imports)
            require_commands(name, allow_commands)
            _accelerators(self.engines.setdefault(name, engine_of(name)))  # raises: it cannot list them
        self._codes: dict[str, str] = {}
        paths = dict.fromkeys(combination["scene"].path for combination in experiment.combinations)
        self.scenes: dict[str, Scene] = {path: load_scene(path, allow_imports=allow_imports) for path in paths}

    def code(self, name: str) -> str:
        """The hash of an engine's code."""
        if name not in self._codes:
            self._codes[name] = engine_code(self.engines[name], name)
        return self._codes[name]

    def accelerator(self, name: str, given: Mapping[str, Any]) -> tuple[dict[str, Any], str | None]:
        """The accelerator with its options, and why the engine has none such. Unknown to all engines is an error."""
        if ":" in given["name"]:
            require_imports(given["name"], self.allow_imports)
            return dict(given), None
        if _resolves(self.engines[name], given):
            return _resolved(self.engines[name], given), None
        if any(_resolves(other, given) for other in self.engines.values()):
            return dict(given), f"the engine {name} has no accelerator {flow(given)}"
        for other in self.engines.values():
            if given["name"] in _accelerators(other):
                _resolved(other, given)  # raises: it knows the name, but not the options
        raise UnknownName("accelerator", given["name"], {a for e in self.engines.values() for a in _accelerators(e)})


def _accelerators(engine: Engine) -> Mapping[str, Any]:
    try:
        found: Any = engine.accelerators()
    except RaybenchError:
        raise
    except (Exception, SystemExit) as error:
        message = f"engine {engine.name}: accelerators failed: {type(error).__name__}: {error}"
        raise ConfigError(message) from error
    if not isinstance(found, Mapping) or not all(isinstance(options, Mapping) for options in found.values()):
        raise ConfigError(
            f"engine {engine.name}: accelerators returned {found!r}: a mapping from names to mappings of options is wanted"
        )
    return {"auto": {}, **found}


def _resolved(engine: Engine, given: Mapping[str, Any]) -> dict[str, Any]:
    return choices.resolve("accelerator", dict(given), _accelerators(engine)).describe()


def _resolves(engine: Engine, given: Mapping[str, Any]) -> bool:
    try:
        _resolved(engine, given)
    except RaybenchError:
        return False
    return True


def _precision(engine: Engine, scene: Scene, settings: Mapping[str, Any], allow_imports: bool) -> str:
    """The precision where none is asked for: float64, the same for all engines, but for one that has float32 alone."""
    double = {**settings, "precision": "float64"}
    single = {**settings, "precision": "float32"}
    able = _why_not(engine, scene, double, allow_imports) is None
    return "float64" if able or _why_not(engine, scene, single, allow_imports) else "float32"


def _configured(
    experiment: Experiment, combination: Mapping[str, Any], known: _Known
) -> tuple[Cell, ReferenceWanted | None]:
    """A configuration as a cell without block and seed, and the reference it needs."""
    file: SceneFile = combination["scene"]
    scene, engine = known.scenes[file.path], known.engines[combination["engine"]]
    accelerator, lacking = known.accelerator(combination["engine"], combination["accelerator"])
    width, height = combination["resolution"] or scene.camera.resolution
    memory.require(BYTES_A_PIXEL * width * height, f"{experiment.source} resolution: a cell of {width}x{height} pixels")
    settings = {
        "shader": combination["shader"], "sampler": combination["sampler"], "accelerator": accelerator,
        "precision": combination["precision"] or "float64", "threads": combination["threads"],
        "width": int(width), "height": int(height),
    }  # fmt: skip
    if combination["precision"] is None and not lacking:
        settings["precision"] = _precision(engine, scene, settings, known.allow_imports)
    skip = lacking or _why_not(engine, scene, settings, known.allow_imports)
    wanted, unreferenced = _reference(experiment, file, scene, settings, known)
    skip = skip or unreferenced
    budget: Budget = combination["budget"]
    by_place = ":" in combination["engine"] or is_file(combination["engine"])
    named = engine.name if by_place else combination["engine"]
    asked = {
        "schema": SCHEMA_VERSION, "scene": scene.content_hash, "engine": named, "engine_version": str(engine.version),
        **settings, "max_time_seconds": budget.max_time_seconds, "max_spp": budget.max_spp,
        "checkpoints": asdict(experiment.checkpoints), "label": None,
        "code": {"engine": known.code(combination["engine"]), **_plugin_codes(settings)},
    }  # fmt: skip
    cell = Cell(
        cell_id="", configuration=digest(asked), asked=asked, block=0, order=0, seed=0, label=None, scene=file,
        scene_hash=scene.content_hash, engine=combination["engine"], engine_name=named, settings=settings,
        budget=budget, reference_id=wanted.reference_id if wanted and not skip else None, skip=skip,
        primitives=primitive_count(scene),
    )  # fmt: skip
    return cell, None if skip else wanted


def primitive_count(scene: Scene) -> int:
    """Triangles, spheres and planes: what a tree is built over."""
    parts = (getattr(shape, "faces", getattr(shape, "radii", None)) for shape in scene.shapes)
    return sum(1 if part is None else len(part) for part in parts)


def _why_not(engine: Engine, scene: Scene, settings: Mapping[str, Any], allow_imports: bool) -> str | None:
    """The engine's answer. One that fails at it, or answers something else, is tried: the cell will tell."""
    plain = engine_settings(settings, 0, allow_imports)
    try:
        answer: Any = engine.why_not(scene, plain)
    except UnknownName as unknown:
        if unknown.kind == "sampler":  # an engine's own, which the configuration was right to name
            return f"the engine {engine.name} has no sampler {unknown.found}"
        raise
    except RaybenchError:
        raise
    except (Exception, SystemExit) as error:
        warnings.warn(f"engine {engine.name}: why_not failed: {type(error).__name__}: {error}: it is tried", stacklevel=2)
        return None
    if answer is not None and not isinstance(answer, str):
        warnings.warn(
            f"engine {engine.name}: why_not answered {answer!r}: None or a sentence is wanted: it is tried", stacklevel=2
        )
        return None
    return answer


def _reference(
    experiment: Experiment, file: SceneFile, scene: Scene, settings: Mapping[str, Any], known: _Known
) -> tuple[ReferenceWanted | None, str | None]:
    """The reference of a scene, shader and size; or why its engine cannot make it."""
    given = experiment.reference
    engine = known.engines[given.engine]
    accelerator = {"name": given.accelerator} if isinstance(given.accelerator, str) else given.accelerator
    sampler = {"name": given.sampler} if isinstance(given.sampler, str) else given.sampler
    asked_of = {
        **settings, "precision": given.precision, "threads": 1,
        "sampler": choices.resolve("sampler", sampler, choices.SAMPLERS).describe(),
        "accelerator": _resolved(engine, accelerator),
    }  # fmt: skip
    asked_of["precision"] = given.precision or _precision(engine, scene, asked_of, known.allow_imports)
    why_not = _why_not(engine, scene, asked_of, known.allow_imports)
    if why_not:
        return None, f"no reference by {given.engine}: {why_not}"
    each, count = given.replicates
    asked = {
        "schema": SCHEMA_VERSION, "scene": scene.content_hash, "engine": given.engine,
        "engine_version": str(engine.version), "replicate_spp": each, "replicates": count, "seed": given.seed,
        **{key: value for key, value in asked_of.items() if key != "threads"},
    }  # fmt: skip
    asked["code"] = {"engine": known.code(given.engine), **_plugin_codes(asked_of)}
    from harness.machine import usable_cores

    threads = given.threads or len(usable_cores())
    certifier = _certifier(given.certify, scene, {**asked_of, "threads": threads}, known) if given.certify else None
    wanted = ReferenceWanted(
        file.name, file.path, scene.content_hash, asked, {**asked_of, "threads": threads}, certifier
    )  # fmt: skip
    return wanted, None


def _certifier(name: str, scene: Scene, settings: Mapping[str, Any], known: _Known) -> Certifier:
    """The second engine, with its own accelerator and precision."""
    engine = known.engines[name]
    given = {**settings, "accelerator": _resolved(engine, {"name": "auto"})}
    given["precision"] = _precision(engine, scene, given, known.allow_imports)
    version = f"{engine.version}+{known.code(name)[:8]}"
    return Certifier(name, version, given, _why_not(engine, scene, given, known.allow_imports))


def _plugin_codes(settings: Mapping[str, Any]) -> dict[str, str]:
    """Hashes of the code of plugins named `module:attribute`: a changed file is another request."""
    names = [settings[kind]["name"] for kind in ("shader", "sampler", "accelerator")]
    return {name: plugin_code(load_attribute(name), name) for name in names if ":" in name}


def _with_control(experiment: Experiment, configurations: list[Cell]) -> list[Cell]:
    """The configurations, and one of them under a second label: how far apart two equal things are measured."""
    able = sorted((cell for cell in configurations if not cell.skip), key=lambda cell: cell.configuration)
    if not experiment.control or not able:
        return configurations
    return [*configurations, replace(able[0], label=CONTROL_LABEL)]


def _in_block(cell: Cell, experiment: Experiment, block: int) -> Cell:
    seed = experiment.seed + block
    asked = {**cell.asked, "label": cell.label, "seed": seed}
    return replace(cell, asked=asked, cell_id=digest(asked), block=block, seed=seed)


# --- what is left to do ---------------------------------------------------------------------------------------------


def up_to_date(cell: Cell, event: Mapping[str, Any] | None, metric: str) -> bool:
    """Whether an event still answers its cell: compared with today's reference, by the metric asked for."""
    if event is None or event["state"] == "outdated":
        return False
    if event["state"] == "skipped":
        return cell.skip is not None
    if cell.skip:
        return False
    points = event.get("points") or []
    return event["reference_id"] == cell.reference_id and all(metric in point["metrics"] for point in points)


def state_of(cell: Cell, event: Mapping[str, Any] | None, metric: str) -> str:
    """queued, done, failed, timeout, skipped or outdated."""
    if cell.skip:
        return "skipped"
    if event is None:
        return "queued"
    return event["state"] if up_to_date(cell, event, metric) else "outdated"


def expected_seconds(cells: Iterable[Cell], events: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[float, bool]]:
    """Wall seconds by cell id, and whether they were measured (on the same configuration) or are the most allowed."""
    measured: dict[str, list[float]] = {}
    for event in events.values():
        if event.get("wall_seconds") and event["state"] == "done":
            measured.setdefault(event.get("configuration", ""), []).append(event["wall_seconds"])
    found = {}
    for cell in cells:
        known = sorted(measured.get(cell.configuration, []))
        most = min(cell.budget.timeout_seconds, cell.budget.max_time_seconds + OVERHEAD_SECONDS)
        found[cell.cell_id] = (known[len(known) // 2], True) if known else (most, False)
    return found
