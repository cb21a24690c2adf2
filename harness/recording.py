"""What a cell's worker tells while it is measured, taken down as the parts of its event."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from harness import store
from harness.config import Checkpoints
from harness.plan import WARM_UP_SEED, Cell
from harness.pool import Heard, WorkerFailed

if TYPE_CHECKING:
    from harness.sweep import Sweep

SHARED_SPP = (1, 4, 16)
"""Checkpoints of which `images: some` keeps every seed's picture: there engines of any speed can be compared."""


def request(cell: Cell, checkpoints: Checkpoints) -> dict[str, Any]:
    """What a worker is asked."""
    return {
        "scene_path": cell.scene.path, "scene_hash": cell.scene_hash, "settings": dict(cell.settings),
        "seed": cell.seed, "warm_up_seed": cell.seed + WARM_UP_SEED,
        "schedule": {
            **asdict(checkpoints), "max_spp": cell.budget.max_spp, "max_time_seconds": cell.budget.max_time_seconds,
        },
    }  # fmt: skip


class Recording:
    """What a cell's worker tells, as the parts of its event."""

    def __init__(self, sweep: Sweep, cell: Cell, env_id: str) -> None:
        self.sweep, self.cell, self.env_id = sweep, cell, env_id
        self.phases: dict[str, float] = {}
        self.points: list[dict[str, Any]] = []
        self.counters: dict[str, float] = {}
        self.disturbance: dict[str, Any] = {}
        self._last_film: Any = None

    def follow(self, heard: Iterable[Heard]) -> None:
        """Takes down what a worker tells, until its end; failures and timeouts come out of `heard`."""
        reference = self.sweep.reference(str(self.cell.reference_id))
        for message, film in heard:
            told = {key: value for key, value in message.items() if key != "did"}
            if message["did"] == "import":
                self._imported(**told)
            elif message["did"] == "prepared":
                self.phases.update(told)
            elif message["did"] == "point":
                self._point(told, film, reference)
            elif message["did"] == "end":
                self.counters, self.disturbance = {**told.get("counters", {}), **self.counters}, told.get("machine", {})

    def _imported(self, seconds: float, version: str, code: str) -> None:
        planned = str(self.cell.asked["engine_version"])
        if version != planned:
            raise WorkerFailed(
                f"the engine is version {version} where it was to render, {planned} where it was planned"
            )
        # Elsewhere native libraries of the same version may be other files.
        if self.env_id == self.sweep.env_id and code != self.cell.asked["code"]["engine"]:
            raise WorkerFailed("the engine's code has changed since the run began: run again")
        self.phases["import_seconds"] = seconds

    def _point(self, answer: Mapping[str, Any], film: Any, reference: Any) -> None:
        from harness import films, metrics

        self.phases["render_seconds"] = answer["seconds"]
        image = films.image_of(film)
        scores = metrics.measure(image, reference, self.sweep.plan.experiment.quality.epsilon)
        self.points.append({**answer, "metrics": {key: float(value) for key, value in scores.items()}, "image": None})
        self._last_film = film
        self.counters["bad_samples"] = float(film.bad_samples)
        if bad := films.bad_pixels(image):
            self._last_film = None
            raise WorkerFailed(
                f"{bad} of {film.width * film.height} pixels of the engine's image at {answer['spp']} spp are not finite: "
                "finite radiance is wanted"
            )
        images = self.sweep.plan.experiment.images
        wanted = self.cell.block == 0 or answer["spp"] in SHARED_SPP
        if images == "all" or (images == "some" and wanted and self.cell.label is None):
            self._keep(film)
        self.sweep.listener.point(answer["spp"], answer["seconds"])

    def keep_last_image(self) -> None:
        """Writes the image of the last checkpoint, if images are wanted and it is not there yet."""
        if self._last_film is not None and self.sweep.plan.experiment.images != "none" and self.points[-1]["image"] is None:
            self._keep(self._last_film)

    def _keep(self, film: Any) -> None:
        point = self.points[-1]
        path = store.image_path(self.cell.cell_id, point["spp"])
        target = store.image_file(self.sweep.folder, path)
        target.parent.mkdir(parents=True, exist_ok=True)
        told = {key: point[key] for key in ("spp", "seconds", "metrics")}
        identity = {"cell_id": self.cell.cell_id, "env_id": self.env_id, "asked": dict(self.cell.asked)}
        film.save(target, provenance={**identity, **told, "scene": self.cell.scene.name})
        point["image"] = path
