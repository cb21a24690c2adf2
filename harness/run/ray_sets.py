"""The sets of rays of a run: made once, kept in files that workers read, with the exact answers by which theirs are judged."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from engines.errors import ConfigError
from engines.scene import Scene
from engines.temporary import TemporaryFolder
from harness.config.settings import SceneFile
from harness.measure import tracing
from harness.measure.requests import RayRequest
from harness.measure.scratch import Unwritten
from harness.measure.tracing import Arrays
from harness.plan.ray_sets import PlannedRaySet
from harness.settings import TracerSettings
from harness.store.records import Answers
from harness.trace.judge import Faults, Judge, leaks
from harness.trace.rays import Rays, hard_rays, make_rays
from harness.trace.truth import Truth

QUANTILES = {"t_median": 0.5, "t_p999": 0.999, "t_worst": 1.0}


class RaySet:
    """Rays of a kind in a file, and the exact answers to those that are checked."""

    def __init__(self, planned: PlannedRaySet, scene: Scene, truth: Truth, hard: Rays, file: Path) -> None:
        """Raises `Unsupported` where the scene has no such rays, and `ConfigError` where the file cannot be written."""
        config, seed = planned.config, planned.seed
        rays = make_rays(planned.kind, scene, truth, config.count, config.bounces, seed)
        rng = np.random.default_rng([seed, 100])
        chosen = np.sort(rng.choice(config.count, min(config.checked, config.count), replace=False))
        self._judge, self._kind, self._hard = Judge(truth, rays.take(chosen)), planned.kind, hard
        self._judged: dict[str, Answers] = {}
        self._file, self._sizes = file, (len(chosen), len(hard.t_max))
        try:
            tracing.write_rays(file, rays, chosen, hard)
        except Unwritten as error:
            raise ConfigError(str(error)) from error

    def request(self, planned: PlannedRaySet, settings: TracerSettings, max_time_seconds: float) -> RayRequest:
        """What a worker is asked for."""
        own = str(self._file), planned.kind, planned.config.batch, max_time_seconds, *self._sizes
        return RayRequest(planned.scene, planned.scene_hash, settings, *own)

    def judged(self, answers: Arrays) -> Answers:
        """What is wrong with answers, as `tracing.read_answers` returns them. The same ones are judged once."""
        sha256 = _sha256(answers)
        if sha256 not in self._judged:
            self._judged[sha256] = self._compared(answers, sha256)
        return self._judged[sha256]

    def _compared(self, answers: Arrays, sha256: str) -> Answers:
        if self._kind == "shadow":
            faults, leaked = self._judge.occlusions(answers["blocked"]), int((~answers["hard_blocked"]).sum())
        else:
            faults = self._judge.hits(answers["t"], answers["shape"], answers["primitive"])
            leaked = leaks(self._hard, answers["hard_t"])
        counts = {name: getattr(faults, name) for name in ("checked", "wrong", "missed", "false_hits")}
        return Answers(sha256=sha256, **counts, hard=len(self._hard.t_max), leaks=leaked, **_quantiles(faults))


class MadeRaySets:
    """The sets of a run, each made when it is first asked for; their files last as long as the `with` does."""

    def __init__(self, allow_imports: bool) -> None:
        self._allow_imports = allow_imports
        self._folder: TemporaryFolder | None = None
        self._sets: dict[str, RaySet] = {}
        self._scenes: dict[SceneFile, tuple[Scene, Truth, Rays]] = {}

    def __enter__(self) -> MadeRaySets:
        return self

    def __exit__(self, *_: object) -> None:
        if self._folder is not None:
            self._folder.cleanup()

    def of(self, planned: PlannedRaySet) -> RaySet:
        """The set. Raises `RaybenchError` where the scene cannot be read, or has no such rays; `ConfigError` where the file
        cannot be written."""
        found = self._sets.get(planned.ray_set_id)
        if found is None:
            if planned.scene not in self._scenes:
                scene = planned.scene.load(self._allow_imports)
                truth = Truth(scene)
                self._scenes[planned.scene] = scene, truth, hard_rays(truth, planned.config.hard, planned.seed)
            self._folder = self._folder or TemporaryFolder()
            file = Path(self._folder.name) / f"{planned.ray_set_id}.npz"
            found = self._sets[planned.ray_set_id] = RaySet(planned, *self._scenes[planned.scene], file)
        return found


def _sha256(arrays: Arrays) -> str:
    found = hashlib.sha256()
    for name in sorted(arrays):
        found.update(name.encode())
        found.update(np.ascontiguousarray(arrays[name]).tobytes())
    return found.hexdigest()


def _quantiles(faults: Faults) -> Mapping[str, Any]:
    """Quantiles of the relative errors of t; none without right hits."""
    if not faults.errors.size:
        return {}
    return {name: float(np.quantile(faults.errors, share)) for name, share in QUANTILES.items()}
