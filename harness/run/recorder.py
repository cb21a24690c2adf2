"""What a run knows and writes down: the state of its folder, and the events of its cells as they are measured.

Executors measure cells and hand the messages of workers to a `CellRecord`; the `Recorder` decides which cells are left and puts
every event on disk before the next cell begins.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from harness import metrics, store
from harness.hashing import digest
from harness.measure import films, machine
from harness.measure.messages import End, Imported, Prepared, Traced
from harness.measure.messages import Point as MeasuredPoint
from harness.measure.pool import WorkerFailed, WorkerMessage, WorkerTimeout
from harness.measure.requests import CellRequest, RayRequest
from harness.plan.cells import Cell, Plan
from harness.plan.state import up_to_date
from harness.run.contended import contended_by_cpu_time
from harness.run.progress import Listener
from harness.run.ray_sets import MadeRaySets
from harness.store import records, reference_files, validation
from harness.store.records import (
    BROKEN,
    AnyCell,
    AnyEvent,
    Attempt,
    Environment,
    Point,
    RayAttempt,
    RayCell,
    Start,
    VerifyJob,
    attempt_of,
)
from harness.store.results import point_error

UNUSABLE = "the engine's figures are unusable"
SHARED_SPP = (1, 4, 16)
"""Checkpoints of which `images: some` keeps every seed's picture: there engines of any speed can be compared."""


class Recorder:
    """The state of one run. `latest` has the last event of every cell; `stopped` says that no further cell may begin."""

    def __init__(
        self,
        plan: Plan,
        folder: Path,
        listener: Listener,
        events: store.Events,
        retry: bool,
        fail_fast: bool,
        ray_sets: MadeRaySets,
    ) -> None:
        self.plan, self.folder, self.listener, self.ray_sets = plan, folder, listener, ray_sets
        self._events, self._retry, self._fail_fast = events, retry, fail_fast
        self.root = reference_files.cache_folder()
        self.metric = plan.experiment.quality.name
        self.history = store.read_events(folder)
        self.latest = store.latest_cells(self.history)
        self.environment = machine.environment()
        self.env_id = digest(self.environment)
        self.stopped = False
        self.measured = 0
        self._loaded: dict[str, Any] = {}
        self._refused: set[str] = set()
        self._attempts = Attempts(self.history)

    def append(self, event: AnyEvent) -> None:
        self._events.append(event)
        self.history.append(event)
        self._attempts.add(event)
        if isinstance(event, (records.Cell, RayCell)):
            self.latest[event.cell_id] = event

    def record_environment(self, env_id: str, preimage: Mapping[str, Any]) -> None:
        """Says once what an environment id stands for."""
        if not any(known.env_id == env_id for known in store.of_kind(self.history, Environment)):
            self.append(Environment(env_id=env_id, preimage=dict(preimage)))

    # --- what is left to do -----------------------------------------------------------------------------------------

    def todo(self) -> list[Cell]:
        """Cells to be measured, in order."""

        def missing(cell: Cell) -> bool:
            event = self.latest.get(cell.cell_id)
            again = self._retry and event is not None and event.state in BROKEN
            return not cell.skip and (again or not up_to_date(cell, event, self.metric))

        return [cell for cell in self.plan.cells if missing(cell)]

    def ready(self) -> list[Cell]:
        """Cells to be measured whose reference or ray set is there, in order."""
        return [cell for cell in self.todo() if cell.needed_id not in self._refused]

    def without(self, needed_id: str, message: str) -> None:
        """A reference or ray set could not be made: the cells that need it have failed."""
        self.listener.note(message)
        self._refused.add(needed_id)
        for cell in self.todo():
            if cell.needed_id == needed_id:
                self.append(self.event(cell, "failed", message))
        self.stopped = self.stopped or self._fail_fast

    # --- what is measured again -------------------------------------------------------------------------------------

    def request(self, cell: Cell) -> CellRequest | RayRequest:
        """What a worker is asked for of a cell."""
        if cell.ray_set is None:
            return cell.request(self.plan.experiment.checkpoints)
        return self.ray_sets.of(cell.ray_set).request(cell.ray_set, cell.settings, cell.budget.max_time_seconds)

    def contended_again(self, possible: Callable[[AnyCell], bool]) -> Iterator[list[Cell]]:
        """Contended cells, round after round, until none is left or the config's rounds are used up, over all runs.

        `possible` says of a cell's measurement whether the cell can be measured again under the same conditions.
        """
        rounds = self.plan.experiment.remeasure
        for number in range(1, rounds + 1):
            self._judge_by_cpu_time()
            cells = [cell for cell in self.contended(number) if possible(self.latest[cell.cell_id])]
            if cells and not self.stopped:
                self.listener.note(f"{len(cells)} contended cells are measured again (round {number} of {rounds})")
                yield cells
        if left := len(self.contended()):
            self.listener.note(f"{left} cells stay contended: they are kept, and flagged")

    def contended(self, number: int | None = None) -> list[Cell]:
        """Cells whose measurement counts although it was contended; of a round those that had no attempt in it yet."""

        def is_contended(cell: Cell) -> bool:
            event = self.latest.get(cell.cell_id)
            if event is None or event.state != "done" or not up_to_date(cell, event, self.metric):
                return False
            return bool(event.machine.contended)

        left = [cell for cell in self.plan.cells if number is None or self._attempts.of(cell.cell_id) < number]
        return [cell for cell in left if is_contended(cell)]

    def _judge_by_cpu_time(self) -> None:
        """Marks the cells that only a comparison of blocks shows to be contended."""
        contestants: dict[tuple[Any, ...], dict[str, records.Machine]] = {}
        for event in self.latest.values():
            if event.state == "done":
                contestant = event.configuration, event.label, event.env_id
                contestants.setdefault(contestant, {})[event.cell_id] = event.machine
        for machines in contestants.values():
            for cell_id in contended_by_cpu_time(machines):
                event = self.latest[cell_id]
                if not event.machine.contended:
                    self.append(event.replaced(machine=event.machine.replaced(contended=True)))

    def next_attempt(self, cell: Cell) -> int:
        """The number of the next measurement of a cell in a round of `contended_again`."""
        return self._attempts.of(cell.cell_id) + 2

    # --- cells ------------------------------------------------------------------------------------------------------

    def begin(self, cell: Cell, attempt: int = 1) -> None:
        """Says that a cell is being measured, and removes what an interrupted attempt of that number left."""
        store.discard_images(self.folder, cell.cell_id, attempt)
        self._events.append(Start(cell_id=cell.cell_id, attempt=attempt, time=datetime.now(UTC).isoformat()))

    def finish(self, cell: Cell, event: AnyCell) -> None:
        """Puts a cell's measurement on disk. A repetition that is contended again, or fails, leaves the one that counts."""
        counts = event.attempt == 1 or (event.state == "done" and not event.machine.contended)
        self.append(event if counts else attempt_of(event))
        self.measured += 1
        self.listener.finished(cell, event)
        if counts:
            self.stop_if_broken(event)

    def stop_if_broken(self, event: AnyCell | VerifyJob) -> None:
        """With `fail_fast`, the first failure ends the run."""
        self.stopped = self.stopped or (self._fail_fast and event.state in BROKEN)

    def measured_as(self, record: CellRecord, messages: Iterable[WorkerMessage]) -> AnyCell:
        """The measurement of a cell that was measured to its end, has failed or was killed at its timeout."""
        cell, state, message = record.cell, "done", ""
        try:
            record.follow(messages)
        except WorkerFailed as error:
            state, message = "failed", str(error)
        except WorkerTimeout:
            state, message = "timeout", f"killed after {cell.budget.timeout_seconds:g} s"
        record.keep_last_image()
        spp = record.points[-1].spp if record.points else 0
        known = {"env_id": record.env_id, "attempt": record.attempt}
        measured = {"phases": record.phases, "counters": record.counters, **record.traced}
        if cell.ray_set is None:
            measured["points"] = tuple(record.points)
        try:
            return self.event(cell, state, message, spp, **known, **measured, machine=record.disturbance)
        except ConfigError as error:  # it must not make the whole folder unreadable
            return self.event(cell, "failed", str(error), **known)

    def event(self, cell: Cell, state: str, message: str, spp: int = 0, **more: Any) -> AnyCell:
        """What is said of a cell, with what was measured in `more`; `spp` are those of its last image.

        Raises `ConfigError` where the engine's figures are unusable.
        """
        fields = {
            "cell_id": cell.cell_id,
            "configuration": cell.configuration,
            "env_id": self.env_id,
            "label": cell.label,
            "state": state,
            "message": message,
            "block": cell.block,
            "order": cell.order,
            "seed": cell.seed,
            "scene": cell.scene.name,
            "scene_hash": cell.scene_hash,
            "primitives": cell.primitives,
            "division": cell.division,
            "engine": cell.engine_name,
            "engine_version": cell.spec["engine_version"],
            **cell.settings.fields(),
            "spec": dict(cell.spec),
            "command": cell.command(spp or cell.budget.max_spp),
            "time": datetime.now(UTC).isoformat(timespec="seconds"),
            **more,
        }
        if cell.ray_set is not None:
            own = {"rays": cell.ray_set.kind, "ray_set_id": cell.needed_id, "count": cell.ray_set.config.count}
            return validation.made(RayCell, {**fields, **own}, UNUSABLE, "cell.")
        own = {
            "smooth_sampler": cell.smooth_sampler,
            "reproducible": cell.reproducible,
            **({"raced": cell.raced} if cell.raced else {}),
            "reference_id": cell.reference_id,
            "separate_renders": bool(cell.patterns),
        }
        return validation.made(records.Cell, {**fields, **own}, UNUSABLE, "cell.")

    def reference(self, reference_id: str) -> Any:
        """The arrays of a reference, read and checked once."""
        if reference_id not in self._loaded:
            planned = self.plan.references[reference_id]
            self._loaded[reference_id] = reference_files.read(planned.folder(self.root), reference_id, planned.scene_hash)
        return self._loaded[reference_id]


class CellRecord:
    """The messages of a cell's worker, collected as the parts of its event."""

    def __init__(self, recorder: Recorder, cell: Cell, env_id: str, attempt: int = 1) -> None:
        self.recorder, self.cell, self.env_id, self.attempt = recorder, cell, env_id, attempt
        self.phases: dict[str, float] = {}
        self.points: list[Point] = []
        self.counters: dict[str, float] = {}
        self.disturbance: dict[str, Any] = {}
        self.traced: dict[str, Any] = {}
        self.enough = False
        self._last_film: Any = None

    def follow(self, messages: Iterable[WorkerMessage]) -> None:
        """Collects the messages of a worker until its end; failures and timeouts are raised by `messages`."""
        reference = None if self.cell.ray_set else self.recorder.reference(str(self.cell.reference_id))
        for message, film, answers in messages:
            if isinstance(message, Imported):
                self._imported(message)
            elif isinstance(message, Prepared):
                self.phases.update(message._asdict())
            elif isinstance(message, MeasuredPoint):
                self._point(message, film, reference)
            elif isinstance(message, Traced):
                self._traced(message, answers)
            else:
                self._ended(message)

    def _traced(self, found: Traced, answers: Any) -> None:
        assert self.cell.ray_set is not None
        judged = self.recorder.ray_sets.of(self.cell.ray_set).judged(answers)
        self.traced = {"passes": found.passes, "seconds": found.seconds, "answers": judged}
        self.phases["render_seconds"] = found.seconds

    def _ended(self, end: End) -> None:
        if self.cell.ray_set is None:
            bad = max(end.counters.get("bad_samples", 0.0), self.counters.get("bad_samples", 0.0))
            self.counters = {**end.counters, **self.counters, "bad_samples": bad}
        self.disturbance = dict(end.machine)
        if end.warm_build_seconds is not None:
            self.phases["warm_build_seconds"] = end.warm_build_seconds

    def _imported(self, found: Imported) -> None:
        planned = str(self.cell.spec["engine_version"])
        if found.version != planned:
            raise WorkerFailed(f"the engine is version {found.version} where it was to render, {planned} where it was planned")
        # Elsewhere native libraries of the same version may be other files.
        if self.env_id == self.recorder.env_id and found.code != self.cell.spec["code"]["engine"]:
            raise WorkerFailed("the engine's code has changed since the run began: run again")
        self.phases["import_seconds"] = found.seconds

    def _point(self, found: MeasuredPoint, film: Any, reference: Any) -> None:
        self.phases["render_seconds"] = found.seconds
        image, quality = films.image_of(film), self.recorder.plan.experiment.quality
        scores = metrics.measure(image, reference, quality.epsilon, quality.name)
        said = {"metrics": {key: float(value) for key, value in scores.items()}, "film_variance": films.claimed_variance(film)}
        if found.overshoots:
            said["mean_spp"] = float(film.counts.mean())
        if self.cell.patterns:
            said["sampler"] = self.cell.sampler(found.spp)
        measured = {"spp": found.spp, "seconds": found.seconds, "rays": found.rays}
        try:
            place = f"cell.points[{len(self.points)}]."
            self.points.append(validation.made(Point, {**measured, **said, "image": None}, UNUSABLE, place))
        except ConfigError as error:
            raise WorkerFailed(str(error)) from error
        self._last_film = film
        self.counters["bad_samples"] = float(film.bad_samples)
        if bad := films.bad_pixels(image):
            self._last_film = None
            raise WorkerFailed(
                f"{bad} of {film.width * film.height} pixels of the engine's image at {found.spp} spp are not finite: "
                "finite radiance is expected"
            )
        images = self.recorder.plan.experiment.images
        shown = self.cell.block == 0 or found.spp in SHARED_SPP
        if images == "all" or (images == "some" and shown and self.cell.label is None):
            self._keep(film)
        error, stop = point_error(self.points[-1], quality.name)[0], self.cell.budget.stop_at_error
        self.enough = stop is not None and error <= stop
        self.recorder.listener.point(found.spp, found.seconds, error)

    def keep_last_image(self) -> None:
        """Writes the image of the last checkpoint, if images are expected and it is not there yet."""
        if self._last_film is not None and self.recorder.plan.experiment.images != "none" and self.points[-1].image is None:
            self._keep(self._last_film)

    def _keep(self, film: Any) -> None:
        point = self.points[-1]
        path = store.image_path(self.cell.cell_id, point.spp, self.attempt)
        target = store.image_file(self.recorder.folder, path)
        target.parent.mkdir(parents=True, exist_ok=True)
        measured = {"spp": point.spp, "seconds": point.seconds, "metrics": point.metrics}
        identity = {"cell_id": self.cell.cell_id, "env_id": self.env_id, "spec": dict(self.cell.spec)}
        film.save(target, provenance={**identity, **measured, "scene": self.cell.scene.name})
        self.points[-1] = point.replaced(image=path)


class Attempts:
    """How often each cell was measured again, since the last measurement of it that was a first one."""

    def __init__(self, events: Iterable[AnyEvent]) -> None:
        self._number: Counter[str] = Counter()
        self._measured: dict[str, tuple[str, int]] = {}
        for event in events:
            self.add(event)

    def add(self, event: AnyEvent) -> None:
        if isinstance(event, (Attempt, RayAttempt)):
            self._number[event.cell_id] += 1
        # An event may be there twice, of one measurement: scored anew, or counting again.
        elif isinstance(event, (records.Cell, RayCell)):
            measured = event.time, event.attempt
            if self._measured.get(event.cell_id) != measured:
                self._number[event.cell_id], self._measured[event.cell_id] = event.attempt - 1, measured

    def of(self, cell_id: str) -> int:
        return self._number[cell_id]
