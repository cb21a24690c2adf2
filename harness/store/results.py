"""A results folder as the tables, plots and report see it: contestants, each with its seeds' curves.

Only manifest.json, events.jsonl and images are read. A contestant is one configuration on one scene: everything in
a cell's spec except its seed and block.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from engines.choices import Choice
from harness.check_results import CheckResult
from harness.config import Experiment
from harness.metrics import Reference, as_error, epsilon_of, higher_is_better, metric_name
from harness.statistics.convergence import Curve, curve
from harness.store import records, reference_files
from harness.store.events import check_results, events_file, last_event, latest_cells, of_kind, read_events
from harness.store.folder import config_of, image_file, read_manifest
from harness.store.records import (
    BROKEN,
    AnyCell,
    AnyEvent,
    ArchivedVerdicts,
    Calibration,
    Cell,
    Certificate,
    Environment,
    Manifest,
    Measurement,
    Point,
    RayCell,
    Run,
    Settings,
    Targets,
)
from harness.store.validation import FORMAT_VERSION

PHASES = ("import", "load", "build", "compile", "render")
AXES = ("engine", "accelerator", "shader", "sampler", "precision", "threads", "size", "label", "division", "machine")
"""The settings in which contestants of a scene may differ, in the order in which labels name them."""
CHOICES = ("accelerator", "shader", "sampler")
BRUTE_FORCE = "brute force"
"""What tables call the accelerator `none`."""


@dataclass(frozen=True)
class Contestant:
    """One configuration on one scene with its cells, by block; equal to one of the same settings. `name` is unique among those
    of its scene."""

    settings: Settings
    cells: tuple[Cell, ...] = field(compare=False)
    name: str = field(default="", compare=False)

    @cached_property
    def done(self) -> list[Cell]:
        """Cells that were measured to their end."""
        return [cell for cell in self.cells if cell.state == "done" and cell.points]

    @property
    def runs(self) -> list[Cell]:
        """Cells that had their chance: done, failed and those out of time. What these have counts, the rest is open."""
        return [cell for cell in self.cells if cell.state in BROKEN or (cell.state == "done" and cell.points)]


@dataclass
class Results:
    """All that is known of a run. `config` is the manifest's experiment; `metric` is the quality metric's
    column, `targets` its goals, hardest last.

    `environments` are the events that hold the preimages of environment ids, `certificates` those of reference ids,
    `check_results` those of verify jobs, `archived_verdicts` what was concluded from images that an archive lacks,
    `calibration` the figures of the run that an archive is a copy of. `cells` and `contestants` are those that render,
    `ray_cells` those that trace rays.
    """

    folder: Path
    manifest: Manifest
    config: Experiment
    cells: list[Cell]
    references: dict[str, records.Reference]
    metric: str
    targets: list[float]
    runs: list[Run]
    environments: dict[str, Environment] = field(default_factory=dict)
    certificates: dict[str, Certificate] = field(default_factory=dict)
    check_results: list[CheckResult] = field(default_factory=list)
    archived_verdicts: ArchivedVerdicts | None = None
    calibration: Calibration | None = None
    ray_cells: list[RayCell] = field(default_factory=list)
    contestants: list[Contestant] = field(default_factory=list)

    @property
    def all_cells(self) -> list[AnyCell]:
        """The cells of both kinds."""
        return [*self.cells, *self.ray_cells]

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
        return epsilon_of(self.metric) or self.config.quality.epsilon

    @property
    def relative_metric(self) -> str:
        """relMSE, whatever the quality metric: slopes of the RMSE and biases are about mean squares."""
        return metric_name("relmse", self.epsilon)

    def of_scene(self, scene: str) -> list[Contestant]:
        """The scene's contestants that have something to show."""
        return [c for c in self.contestants if c.settings.scene == scene and c.done]

    def reference(self, reference_id: str | None) -> Reference | None:
        """The reference's arrays; None where it is missing or unreadable."""
        found = self.references.get(reference_id or "")
        if found is None:
            return None
        from engines.errors import RaybenchError

        name, scene_hash = found.reference_id, found.scene_hash
        try:
            return reference_files.read(reference_files.of_results(self.folder, name, scene_hash), name, scene_hash)
        except (RaybenchError, OSError, ValueError, KeyError):
            return None

    def image(self, point: Point | None) -> np.ndarray | None:
        """A checkpoint's image (h, w, 3); None where it was not kept or cannot be read."""
        return read_image(image_file(self.folder, point.image)) if point is not None and point.image else None


def load_results(folder: str | Path) -> Results:
    """Reads a results folder. Raises ConfigError where there is none, and where it has no events."""
    from engines.errors import ConfigError

    folder = Path(folder)
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder; one written by `raybench run` is expected")
    if events_file(folder) is None:
        raise ConfigError(f"{folder}: has no events.jsonl; a folder written by `raybench run` is expected")
    events = read_events(folder)
    manifest = read_manifest(folder) if (folder / "manifest.json").exists() else None
    if not events and manifest is None:
        raise ConfigError(f"{folder}: has an empty events.jsonl and no manifest.json; a folder of `raybench run` is expected")
    return results_of(folder, manifest or Manifest(raybench_results=FORMAT_VERSION), events)


def results_of(folder: Path, manifest: Manifest, events: Sequence[AnyEvent]) -> Results:
    """Arranges events. Cells that a changed config no longer asks for (outdated) are left out, and so are targets that stand
    for no error above zero, as an SSIM of 1, which configs may not have."""
    config, targets = config_of(manifest), last_event(events, Targets)
    quality = config.quality
    metric = targets.metric if targets else quality.name
    asked = quality.targets if manifest.config else None  # without a config none were asked for
    goals = [goal for goal in (targets.targets if targets else asked or ()) if as_error(metric, goal) > 0]
    cells = [cell for cell in latest_cells(events).values() if cell.state != "outdated"]
    results = Results(
        folder,
        manifest,
        config,
        of_kind(cells, Cell),
        {event.reference_id: event for event in of_kind(events, records.Reference)},
        metric,
        sorted(goals, reverse=not higher_is_better(metric)),
        of_kind(events, Run),
        {event.env_id: event for event in of_kind(events, Environment)},
        {event.reference_id: event for event in of_kind(events, Certificate)},
        check_results(events, manifest.verify_job_ids),
        last_event(events, ArchivedVerdicts),
        last_event(events, Calibration),
        of_kind(cells, RayCell),
    )
    results.contestants = _contestants(results.cells, list(dict.fromkeys(each.scene.name for each in config.combinations)))
    return results


def phase_seconds(cell: Measurement, phase: str) -> float:
    """Seconds of a phase, one of `PHASES`; 0 where it was not recorded."""
    value: float | None = getattr(cell.phases, f"{phase}_seconds")
    if phase == "render" and isinstance(cell, Cell):
        value = cell.render_seconds
    return value if value is not None and math.isfinite(value) else 0.0


def fixed_seconds(cell: Measurement) -> float:
    """Import, scene load, build and compilation: what a cold start pays before its first ray."""
    return sum(phase_seconds(cell, phase) for phase in PHASES[:-1])


def curve_of(points: Sequence[Point], metric: str, smooth: bool, reproducible: bool) -> Curve:
    """The errors of checkpoints by `metric`, see `point_error`, of a sampler and an engine that are such."""
    errors, spreads = np.array([point_error(point, metric) for point in points]).reshape(-1, 2).T
    kind = {"smooth": smooth, "reproducible": reproducible}
    return curve([point.spp for point in points], [point.seconds for point in points], errors, spreads, **kind)


def point_error(point: Point, metric: str) -> tuple[float, float]:
    """(error, its standard error) of a checkpoint: the corrected metric if it was measured, else the plain one.

    NaN for what was not measured.
    """
    value = point.metrics.get(f"{metric}_corrected", point.metrics.get(metric))
    se = point.metrics.get(f"{metric}_se")
    return (math.nan if value is None else as_error(metric, value)), (math.nan if se is None else se)


def read_image(path: Path) -> np.ndarray | None:
    """(h, w, 3) float64, or None where the file is missing or damaged: a report never fails over a picture."""
    from engines.errors import RaybenchError
    from engines.image import read_image as read

    try:
        return np.asarray(read(path), np.float64)
    except (RaybenchError, OSError):
        return None


# --- settings as text, and names -------------------------------------------------------------------------------------


def setting_text(axis: str, value: Any) -> str:
    """A setting of `AXES` as tables, legends and messages print it: the accelerator `none` is brute force."""
    return BRUTE_FORCE if axis == "accelerator" and value.name == "none" else str(value)


def _contestants(cells: Sequence[Cell], config_scenes: Sequence[str]) -> list[Contestant]:
    """Cells by configuration, named by what differs within a `scope` among those that were measured, or from them, where none
    was among all; a single shader by its options alone.

    Scenes come in the order of the config, others after them as they appear; contestants of a scene in that of their settings
    as texts.
    """
    groups: dict[Settings, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(cell.settings, []).append(cell)
    scenes = list(dict.fromkeys([*config_scenes, *(settings.scene for settings in groups)]))
    contestants = [
        Contestant(settings, tuple(sorted(groups[settings], key=lambda cell: cell.block)))
        for settings in sorted(groups, key=lambda s: (scenes.index(s.scene), s.order()))
    ]
    choices = choices_of(contestants)
    words = [name_words(contestant, choices) for contestant in contestants]
    if len({contestant.settings.shader.name for contestant in contestants}) == 1:
        words = [own | {"shader": own["shader"].partition("(")[2].removesuffix(")")} for own in words]
    measured = {scope(axis, contestant) for contestant in contestants if contestant.done for axis in AXES}
    seen: dict[tuple[str, str], set[str]] = {}
    for contestant, own in zip(contestants, words, strict=True):
        for axis in AXES:
            if contestant.done or scope(axis, contestant) not in measured:
                seen.setdefault(scope(axis, contestant), set()).add(own[axis])
    named = []
    for contestant, own in zip(contestants, words, strict=True):
        shown = [own[a] for a in AXES if a == "engine" or seen[scope(a, contestant)] - {own[a]}]
        named.append(replace(contestant, name=" ".join(word for word in shown if word)))
    return named


def scope(axis: str, contestant: Contestant) -> tuple[str, str]:
    """Among whom an axis must differ to be in names: accelerators those of one engine, sizes those of one scene, else all."""
    return axis, {"accelerator": contestant.settings.engine, "size": contestant.settings.scene}.get(axis, "")


def choices_of(contestants: Sequence[Contestant]) -> dict[tuple[str, str], list[Choice]]:
    """The different choices of accelerators, shaders and samplers in each scope."""
    found: dict[tuple[str, str], dict[Choice, None]] = {}
    for contestant in contestants:
        for axis in CHOICES:
            found.setdefault(scope(axis, contestant), {})[getattr(contestant.settings, axis)] = None
    return {key: list(choices) for key, choices in found.items()}


def name_words(contestant: Contestant, choices: Mapping[tuple[str, str], Sequence[Choice]]) -> dict[str, str]:
    """Axis -> its word in a name, "" for the closed division. Options only where two choices of one name differ in them."""
    settings = contestant.settings
    words = {axis: str(getattr(settings, axis)) for axis in AXES if axis not in CHOICES}
    words["threads"] = f"{settings.threads} thread{'s' if settings.threads != 1 else ''}"
    words["division"] = "" if settings.division == "closed" else f"{settings.division} division"
    for axis in CHOICES:
        words[axis] = brief_choice(getattr(settings, axis), choices[scope(axis, contestant)])
    return words


def brief_choice(choice: Choice, others: Sequence[Choice]) -> str:
    """A choice with only those options that differ among the choices of the same name; `none` is brute force."""
    if choice.name == "none":
        return BRUTE_FORCE
    same = [other.options for other in others if other.name == choice.name]
    differing = {key: value for key, value in choice.options.items() if any(other.get(key) != value for other in same)}
    return str(Choice(choice.name, differing))
