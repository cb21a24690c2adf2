"""Cells, the points of a sweep, and the plan that holds them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any

from engines.choices import Choice
from engines.interface import FullPattern
from engines.registry import is_file, names_a_program, split
from harness.config import Checkpoints, Experiment, paths
from harness.config.settings import Budget, SceneFile
from harness.measure.requests import CellRequest
from harness.measure.schedule import Schedule
from harness.plan.ray_sets import PlannedRaySet
from harness.plan.references import PlannedReference
from harness.plan.verify_jobs import VerifyJob
from harness.settings import CHOICES, CellSettings, TracerSettings

WARM_UP_SEED = 1 << 40
"""Added to a cell's seed for the pass that is discarded."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One point of a sweep. `spec` is the preimage of `cell_id`."""

    cell_id: str
    configuration: str
    spec: Mapping[str, Any]
    block: int
    order: int
    seed: int
    label: str | None
    scene: SceneFile
    scene_hash: str
    engine: str
    engine_name: str
    settings: CellSettings | TracerSettings
    budget: Budget
    skip: str | None
    reference_id: str | None = None
    primitives: int = 0
    """Triangles, spheres and other shapes of the scene."""
    smooth_sampler: bool = False
    """Whether the sampler's error falls smoothly from sample to sample."""
    reproducible: bool = False
    """Whether the engine promises the same images at every repetition."""
    division: str = "closed"
    """The ranking it stands in. No part of the spec: another one is written down without measuring again."""
    raced: Choice | None = None
    """The shader of the reference, where cells of all shaders race towards it."""
    auto_accelerator: str = ""
    """Which accelerator `auto` takes, and why, where the engine says so."""
    patterns: tuple[FullPattern, ...] = ()
    """The checkpoints of a sampler with whole patterns: each is a render of its own."""
    ray_set: PlannedRaySet | None = None
    """The rays that the cell traces; None where it renders."""

    @property
    def needed_id(self) -> str | None:
        """The id of the reference or of the ray set without which it cannot be measured."""
        return self.reference_id if self.ray_set is None else self.ray_set.ray_set_id

    def command(self, spp: int) -> str:
        """The command that renders `spp` samples of this cell again, to the bit, or that traces its rays again."""
        settings = self.settings
        words = ["raybench", "render" if self.ray_set is None else "race", _scene_word(self.scene)]
        words += ["--engine", _engine_word(self.engine)]
        for name, value in self.scene.parameters:
            words += ["-D", f"{name}={value}"]
        words += ["--allow-outside"] if self.scene.allow_outside else []
        if isinstance(settings, CellSettings):
            settings = replace(settings, sampler=self.sampler(spp))
        chosen = {kind: choice for kind in CHOICES if (choice := getattr(settings, kind, None))}
        for kind, choice in chosen.items():
            words += [f"--{kind}", flow(choice)]
        words += ["--threads", str(settings.threads)]
        words += ["--precision", settings.precision] if settings.precision else []
        if isinstance(settings, CellSettings):
            words += ["--size", f"{settings.width}x{settings.height}", "--seed", str(self.seed)]
            words += ["--spp", str(spp), "-o", "image.exr"]
        else:
            assert self.ray_set is not None
            words += self.ray_set.options(self.budget)
        names = (self.engine, *(choice.name for choice in chosen.values()))
        words += ["--allow-commands"] if names_a_program(self.engine) else []
        words += ["--allow-imports"] if any(":" in split(name)[0] for name in names) else []
        return " ".join(quote(word) for word in words)

    def sampler(self, spp: int) -> Choice:
        """The sampler of the checkpoint at `spp` of a cell that renders."""
        assert isinstance(self.settings, CellSettings)
        return next((Choice.of(each.sampler) for each in self.patterns if each.spp == spp), self.settings.sampler)

    def request(self, checkpoints: Checkpoints) -> CellRequest:
        """What a worker is asked for of a cell that renders."""
        assert isinstance(self.settings, CellSettings)
        schedule, warm_up_seed = Schedule.of(checkpoints, self.budget), self.seed + WARM_UP_SEED
        return CellRequest(self.scene, self.scene_hash, self.settings, self.seed, warm_up_seed, schedule, self.patterns)


@dataclass(frozen=True, slots=True)
class Plan:
    """Cells in the order in which they run, the references they need by id, and the verify jobs."""

    experiment: Experiment
    cells: tuple[Cell, ...]
    references: Mapping[str, PlannedReference]
    warnings: tuple[str, ...]
    verify_jobs: tuple[VerifyJob, ...] = ()


def _scene_word(scene: SceneFile) -> str:
    """A scene for a command line: its bare name where that finds it, else its path, from here if it lies below."""
    path = Path(scene.path)
    if scene.name in (known := paths.shipped("scenes")) and known[scene.name].resolve() == path:
        return scene.name
    return _from_here(path)


def _engine_word(engine: str) -> str:
    """An engine for a command line, the path in it as short as it can be written here."""
    if is_file(engine):
        return _from_here(Path(engine))
    name, python = split(engine)
    return f"{name}@{_from_here(Path(python))}" if names_a_program(engine) and python else engine


def _from_here(path: Path) -> str:
    """A path as it can be written in the working directory: short where it lies below."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def flow(choice: Choice) -> str:
    """A choice as a command line takes it: its name, or a YAML flow mapping."""
    plain = choice.describe()
    if set(plain) == {"name"}:
        return choice.name
    pairs = [f"{key}: {value if key == 'name' else json.dumps(value)}" for key, value in plain.items()]
    return "{" + ", ".join(pairs) + "}"
