"""The sets of rays that cells need, as cells that render need references."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from harness.config.kinds import DURATION
from harness.config.sections import RaySets
from harness.config.settings import Budget, SceneFile
from harness.hashing import digest


@dataclass(frozen=True, slots=True)
class PlannedRaySet:
    """Rays of one of `RAY_KINDS` in a scene, of which `config` says how many; a function of `seed`."""

    scene: SceneFile
    scene_hash: str
    kind: str
    config: RaySets
    seed: int

    @property
    def spec(self) -> dict[str, Any]:
        """What the set is a function of."""
        sizes = {name: getattr(self.config, name) for name in ("count", "bounces", "checked", "hard")}
        return {"rays": self.kind, "seed": self.seed, **sizes}

    @property
    def ray_set_id(self) -> str:
        return digest({"scene": self.scene_hash, **self.spec})

    def describe(self) -> str:
        """Scene, kind and number in a few words."""
        return f"{self.scene.name}, {self.config.count} {self.kind} rays"

    def options(self, budget: Budget) -> list[str]:
        """The options of `raybench race` for one measurement of the set."""
        sizes = {name: value for name, value in self.spec.items() if name not in ("rays", "seed")}
        sizes |= {"batch": self.config.batch} if self.config.batch else {}
        changes = [f"seed={self.seed}", *(f"ray_sets.{name}={value}" for name, value in sizes.items())]
        words = ["--rays", self.kind, "--time", DURATION.write(budget.max_time_seconds), "--repeats", "1"]
        return [*words, *(word for change in changes for word in ("--set", change))]
