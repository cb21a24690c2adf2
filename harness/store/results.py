"""A results folder as the tables, plots and report see it: contestants, each with its seeds' curves.

Only manifest.json, events.jsonl and images are read. A contestant is one configuration on one scene: everything in
a cell's spec except its seed and block.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.config import Experiment
from harness.metrics import Reference, as_error, higher_is_better, metric_name
from harness.statistics.convergence import Curve, curve
from harness.store import reference_files
from harness.store.events import check_results, events_file, last_event, latest_cells, read_events
from harness.store.folder import config_of, image_file, read_manifest

PHASES = ("import", "load", "build", "compile", "render")
AXES = ("engine", "accelerator", "shader", "sampler", "precision", "threads", "size", "label", "division", "machine")
"""The settings in which contestants of a scene may differ, in the order in which labels name them."""
Event = Mapping[str, Any]
BRUTE_FORCE = "brute force"
"""What tables call the accelerator `none`."""


class Settings(NamedTuple):
    """The settings of a contestant. Choices are text, such as `path_tracer(max_depth=6)`; `size` is `256x256`."""

    scene: str
    engine: str
    accelerator: str
    shader: str
    sampler: str
    precision: str
    threads: int
    size: str
    label: str
    machine: str
    division: str = "closed"


@dataclass
class Contestant:
    """One configuration on one scene with its cells, by block. `name` is unique among those of its scene."""

    settings: Settings
    cells: list[Event]
    name: str = ""

    @property
    def race(self) -> str:
        """The shader whose image it races towards, that of the reference: its own, unless the config has one for all."""
        raced = self.cells[0].get("raced") if self.cells else None
        return choice_text(raced) if raced else self.settings.shader

    @cached_property
    def done(self) -> list[Event]:
        """Cells that were measured to their end."""
        return [cell for cell in self.cells if cell["state"] == "done" and cell.get("points")]

    @property
    def runs(self) -> list[Event]:
        """Cells that had their chance: done, failed and those out of time. What these have counts, the rest is open."""
        return [c for c in self.cells if c["state"] in ("failed", "timeout") or (c["state"] == "done" and c.get("points"))]

    def fixed_seconds(self, cell: Event) -> float:
        """Import, scene load, build and compilation: what a cold start pays before its first ray."""
        return sum(phase_seconds(cell, phase) for phase in PHASES[:-1])


@dataclass
class Results:
    """All that is known of a run. `config` is the manifest's experiment, `metric` the quality metric's column, `targets` its
    goals, hardest last.

    `environments` are the events that hold the preimages of environment ids, `certificates` those of reference ids,
    `check_results` those of verify jobs, `archived_verdicts` what was concluded from images that an archive lacks,
    `calibration` the figures of the run that an archive is a copy of.
    """

    folder: Path
    manifest: Mapping[str, Any]
    config: Experiment
    cells: list[Event]
    references: dict[str, Event]
    metric: str
    targets: list[float]
    runs: list[Event]
    environments: dict[str, Event] = field(default_factory=dict)
    certificates: dict[str, Event] = field(default_factory=dict)
    check_results: list[Event] = field(default_factory=list)
    archived_verdicts: Event | None = None
    calibration: Event | None = None
    contestants: list[Contestant] = field(default_factory=list)

    @property
    def scenes(self) -> list[str]:
        """Scenes in the order of the contestants: that of the config."""
        return list(dict.fromkeys(contestant.settings.scene for contestant in self.contestants))

    @property
    def engines(self) -> list[str]:
        """Engines in alphabetical order."""
        return sorted({contestant.settings.engine for contestant in self.contestants})

    @property
    def epsilon(self) -> float:
        """The epsilon of relMSE (radiance squared): that of the metric's name, else of the config."""
        named = self.metric.startswith("relmse_e")
        return float(self.metric.partition("_e")[2]) if named else self.config.quality.epsilon

    @property
    def relative_metric(self) -> str:
        """relMSE, whatever the quality metric: slopes of the RMSE and biases are about mean squares."""
        return metric_name("relmse", self.epsilon)

    def of_scene(self, scene: str) -> list[Contestant]:
        """The scene's contestants that have something to show."""
        return [c for c in self.contestants if c.settings.scene == scene and c.done]

    def curve(self, cell: Event, metric: str = "") -> Curve:
        """A cell's error by `metric`, which is that of the targets without one: see `point_error`."""
        return curve_of(cell, metric or self.metric)

    def reference(self, reference_id: str | None) -> Reference | None:
        """The reference's arrays; None where it is missing or unreadable."""
        event = self.references.get(reference_id or "")
        if event is None:
            return None
        from engines.errors import RaybenchError

        name, scene_hash = event["reference_id"], event["scene_hash"]
        try:
            return reference_files.read(reference_files.of_results(self.folder, name, scene_hash), name, scene_hash)
        except (RaybenchError, OSError, ValueError, KeyError):
            return None

    def image(self, point: Event) -> np.ndarray | None:
        """A checkpoint's image (h, w, 3); None where it was not kept or cannot be read."""
        return read_image(image_file(self.folder, point["image"])) if point.get("image") else None


def load_results(folder: str | Path) -> Results:
    """Reads a results folder. Raises ConfigError where there is none, and where it has no events."""
    from engines.errors import ConfigError

    folder = Path(folder)
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder; one written by `raybench run` is expected")
    if events_file(folder) is None:
        raise ConfigError(f"{folder}: has no events.jsonl; a folder written by `raybench run` is expected")
    events = read_events(folder)
    manifest = read_manifest(folder) if (folder / "manifest.json").exists() else {}
    if not events and not manifest:
        raise ConfigError(f"{folder}: has an empty events.jsonl and no manifest.json; a folder of `raybench run` is expected")
    return results_of(folder, manifest, events)


def results_of(folder: Path, manifest: Mapping[str, Any], events: Sequence[Event]) -> Results:
    """Arranges events; cells that a changed config no longer asks for (outdated) are left out."""
    targets = (of_kind(events, "targets") or [{}])[-1]
    config = config_of(manifest)
    metric = targets.get("metric") or config.quality.name
    goals = targets.get("targets", config.quality.targets or [])
    references = {event["reference_id"]: event for event in of_kind(events, "reference")}
    cells: list[Event] = [cell for cell in latest_cells(events).values() if cell["state"] != "outdated"]
    results = Results(
        folder,
        manifest,
        config,
        cells,
        references,
        metric,
        sorted(map(float, goals), reverse=not higher_is_better(metric)),
        of_kind(events, "run"),
        {event["env_id"]: event for event in of_kind(events, "environment")},
        {event["reference_id"]: event for event in of_kind(events, "certificate")},
        check_results(events, manifest.get("verify_job_ids")),
        last_event(events, "archived_verdicts"),
        last_event(events, "calibration"),
    )
    results.contestants = _contestants(results.cells, list(dict.fromkeys(each.scene.name for each in config.combinations)))
    return results


def of_kind(events: Sequence[Event], kind: str) -> list[Event]:
    return [event for event in events if event.get("event") == kind]


def choice_text(choice: Any) -> str:
    """`{"name": "bvh", "leaf": 4}` as `bvh(leaf=4)`; names stay as they are, None becomes empty."""
    if not isinstance(choice, Mapping):
        return "" if choice is None else str(choice)
    options = ", ".join(f"{key}={choice[key]}" for key in sorted(choice) if key != "name")
    return f"{choice.get('name', '?')}({options})" if options else str(choice.get("name", "?"))


def phase_seconds(cell: Event, phase: str) -> float:
    """Seconds of a phase; 0 where it was not recorded."""
    value = (cell.get("phases") or {}).get(f"{phase}_seconds")
    return float(value) if value is not None and math.isfinite(value) else 0.0


def curve_of(cell: Event, metric: str) -> Curve:
    """The errors of a cell's checkpoints by `metric`: see `point_error`."""
    points = cell.get("points") or []
    errors, spreads = np.array([point_error(point, metric) for point in points]).reshape(-1, 2).T
    kind = {"smooth": bool(cell.get("smooth_sampler")), "reproducible": bool(cell.get("reproducible"))}
    return curve([point["spp"] for point in points], [point["seconds"] for point in points], errors, spreads, **kind)


def samples_of(point: Event) -> float:
    """Samples of a pixel at a checkpoint, on average: `spp`, or more from an engine that overshoots."""
    return float(point.get("mean_spp") or point["spp"])


def point_error(point: Event, metric: str) -> tuple[float, float]:
    """(error, its standard error) of a checkpoint: the corrected metric if it was measured, else the plain one.

    NaN for what was not measured.
    """
    metrics = point.get("metrics") or {}
    value = metrics.get(f"{metric}_corrected", metrics.get(metric))
    se = metrics.get(f"{metric}_se")
    return (math.nan if value is None else as_error(metric, float(value))), (math.nan if se is None else float(se))


def read_image(path: Path) -> np.ndarray | None:
    """(h, w, 3) float64, or None where the file is missing or damaged: a report never fails over a picture."""
    from engines.errors import RaybenchError
    from engines.image import read_image as read

    try:
        return np.asarray(read(path), np.float64)
    except (RaybenchError, OSError):
        return None


def setting_text(axis: str, value: Any) -> str:
    """A setting of `Settings` as tables and legends print it."""
    return BRUTE_FORCE if (axis, value) == ("accelerator", "none") else str(value)


def settings_of(cell: Event) -> Settings:
    """The configuration of a cell."""
    return Settings(
        str(cell.get("scene", "?")),
        str(cell.get("engine", "?")),
        choice_text(cell.get("accelerator")),
        choice_text(cell.get("shader")),
        choice_text(cell.get("sampler")),
        str(cell.get("precision") or ""),
        int(cell.get("threads") or 1),
        f"{cell.get('width') or '?'}x{cell.get('height') or '?'}",
        str(cell.get("label") or ""),
        str(cell.get("env_id") or "")[:8],
        str(cell.get("division") or "closed"),
    )


def _contestants(cells: Sequence[Event], config_scenes: Sequence[str]) -> list[Contestant]:
    """Cells by configuration, named by what differs among those that were measured, or from them; a single shader by its
    options alone.

    Scenes come in the order of the config, others after them as they appear.
    """
    groups: dict[Settings, list[Event]] = {}
    for cell in cells:
        groups.setdefault(settings_of(cell), []).append(cell)
    scenes = list(dict.fromkeys([*config_scenes, *(settings.scene for settings in groups)]))
    contestants = [
        Contestant(settings, sorted(groups[settings], key=lambda cell: cell.get("block") or 0))
        for settings in sorted(groups, key=lambda s: (scenes.index(s.scene), s))
    ]
    choices = choices_of(contestants)
    words = [name_words(contestant, choices) for contestant in contestants]
    if len({own["shader"].partition("(")[0] for own in words}) == 1:
        words = [own | {"shader": own["shader"].partition("(")[2].removesuffix(")")} for own in words]
    measured = [bool(contestant.done) for contestant in contestants]
    seen: dict[tuple[str, str], set[str]] = {}
    for contestant, own, done in zip(contestants, words, measured, strict=True):
        if done or not any(measured):
            for axis in AXES:
                seen.setdefault(scope(axis, contestant), set()).add(own[axis])
    for contestant, own in zip(contestants, words, strict=True):
        shown = [own[a] for a in AXES if a == "engine" or seen.get(scope(a, contestant), set()) - {own[a]}]
        contestant.name = " ".join(word for word in shown if word)
    return contestants


def scope(axis: str, contestant: Contestant) -> tuple[str, str]:
    """Among whom an axis must differ to be in names: accelerators those of one engine, sizes those of one scene, else all."""
    return axis, {"accelerator": contestant.settings.engine, "size": contestant.settings.scene}.get(axis, "")


def choices_of(contestants: Sequence[Contestant]) -> dict[tuple[str, str], list[Any]]:
    """The different choices of accelerators, shaders and samplers in each scope."""
    found: dict[tuple[str, str], list[Any]] = {}
    for contestant in contestants:
        for axis in ("accelerator", "shader", "sampler"):
            known = found.setdefault(scope(axis, contestant), [])
            if contestant.cells[0].get(axis) not in known:
                known.append(contestant.cells[0].get(axis))
    return found


def name_words(contestant: Contestant, choices: Mapping[tuple[str, str], Sequence[Any]]) -> dict[str, str]:
    """Axis -> its word in a name, "" for the closed division. Options only where two choices of one name differ in them."""
    settings = contestant.settings
    words = {axis: str(getattr(settings, axis)) for axis in AXES}
    words["threads"] = f"{settings.threads} thread{'s' if settings.threads != 1 else ''}"
    words["division"] = "" if settings.division == "closed" else f"{settings.division} division"
    for axis in ("accelerator", "shader", "sampler"):
        words[axis] = brief_choice(contestant.cells[0].get(axis), choices[scope(axis, contestant)])
    return words


def brief_choice(choice: Any, others: Sequence[Any]) -> str:
    """`choice_text` with only those options that differ among the choices of the same name; `none` is brute force."""
    if isinstance(choice, Mapping) and choice.get("name") == "none":
        return BRUTE_FORCE
    if not isinstance(choice, Mapping):
        return choice_text(choice)
    same = [other for other in others if isinstance(other, Mapping) and other.get("name") == choice.get("name")]
    differing = {key: choice[key] for key in choice if any(other.get(key) != choice[key] for other in same)}
    return choice_text({"name": choice.get("name"), **differing})
