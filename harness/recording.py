"""What a cell's worker tells while it is measured, taken down as the parts of its event."""

from __future__ import annotations

from collections.abc import Mapping
from time import monotonic
from typing import TYPE_CHECKING, Any

from harness import store
from harness.plan import WARM_UP_SEED, Cell
from harness.pool import Pool, film_of

if TYPE_CHECKING:
    from harness.sweep import Sweep

SHARED_SPP = (1, 4, 16)
"""Checkpoints of which `images: some` keeps every seed's picture: there engines of any speed can be compared."""


class Recording:
    """What a cell's worker tells, as the parts of its event."""

    def __init__(self, sweep: Sweep, cell: Cell) -> None:
        self.sweep, self.cell = sweep, cell
        self.phases: dict[str, float] = {}
        self.points: list[dict[str, Any]] = []
        self.counters: dict[str, float] = {}
        self.disturbance: dict[str, Any] = {}
        self._last_film: Any = None

    def follow(self, pool: Pool) -> None:
        """Asks the worker and takes down its answers until the end, a failure or the timeout."""
        cell, sweep = self.cell, self.sweep
        reference = sweep.reference(str(cell.reference_id))
        worker = pool.worker(cell.engine)
        self.phases["import_seconds"] = worker.import_seconds
        deadline = monotonic() + cell.budget.timeout_seconds
        worker.ask(self._request(pool))
        while True:
            answer = worker.receive(deadline)
            if answer.pop("did") == "prepared":
                self.phases.update(answer)
            elif "spp" in answer:
                began = monotonic()
                self._point(answer, film_of(pool.scratch), reference)
                deadline += monotonic() - began
                worker.ask({"do": "go"})
            else:
                self.counters, self.disturbance = answer["counters"], answer["machine"]
                return

    def _request(self, pool: Pool) -> dict[str, Any]:
        cell, schedule = self.cell, self.sweep.plan.experiment.checkpoints
        return {
            "do": "cell", "scene_path": cell.scene.path, "scene_hash": cell.scene_hash,
            "settings": dict(cell.settings), "seed": cell.seed, "warm_up_seed": cell.seed + WARM_UP_SEED,
            "allow_imports": self.sweep.options.allow_imports, "scratch": str(pool.scratch),
            "schedule": {
                "ratio": schedule.ratio, "start": schedule.start, "max_spp": cell.budget.max_spp,
                "max_time_seconds": cell.budget.max_time_seconds,
            },
        }  # fmt: skip

    def _point(self, answer: Mapping[str, Any], film: Any, reference: Any) -> None:
        from harness import metrics

        self.phases["render_seconds"] = answer["seconds"]
        scores = metrics.measure(film.mean(), reference, self.sweep.plan.experiment.quality.epsilon)
        self.points.append({**answer, "metrics": {key: float(value) for key, value in scores.items()}, "image": None})
        self._last_film = film
        images = self.sweep.plan.experiment.images
        wanted = self.cell.block == 0 or answer["spp"] in SHARED_SPP
        if images == "all" or (images == "some" and wanted and self.cell.label is None):
            self._keep(film)
        self.sweep.listener.point(answer["spp"], answer["seconds"])

    def keep_last_image(self) -> None:
        """Writes the image of the last checkpoint, if images are wanted and it is not there yet."""
        if self.points and self.sweep.plan.experiment.images != "none" and self.points[-1]["image"] is None:
            self._keep(self._last_film)

    def _keep(self, film: Any) -> None:
        point = self.points[-1]
        path = store.image_path(self.cell.cell_id, point["spp"])
        (self.sweep.folder / path).parent.mkdir(parents=True, exist_ok=True)
        told = {key: point[key] for key in ("spp", "seconds", "metrics")}
        identity = {"cell_id": self.cell.cell_id, "env_id": self.sweep.env_id, "asked": dict(self.cell.asked)}
        film.save(self.sweep.folder / path, provenance={**identity, **told, "scene": self.cell.scene.name})
        point["image"] = path
