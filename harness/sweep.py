"""The run: references, then blocks of cells in random order, one at a time, each result on disk before the next begins.

What it may be told to do again is decided by `plan.up_to_date`; what it writes is decided by `store`. A cell that fails
or runs out of time is recorded and the sweep goes on. Nothing here renders: `worker` does, and while this process
computes errors or draws progress no ray is traced.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

from engines.errors import ConfigError
from harness import certify, confined, examinations, machine, records, reference_files, references, store
from harness.identity import digest
from harness.plan import Cell, Plan, expected_seconds, up_to_date
from harness.pool import Heard, Pool, WorkerFailed, WorkerTimeout
from harness.recording import Recording, request
from harness.sentinel import sentinel_seconds
from harness.targets import automatic_targets

if TYPE_CHECKING:
    from harness.cluster import Cluster

LOG = "worker.log"
BROKEN = ("failed", "timeout")


class Listener(Protocol):
    """Who is told how the run goes. Called only while nothing renders."""

    def note(self, text: str) -> None: ...
    def reference(self, name: str, done: int, wanted: int) -> None: ...
    def cell(self, cell: Cell, number: int, total: int, seconds_left: float) -> None: ...
    def point(self, spp: int, seconds: float) -> None: ...
    def finished(self, cell: Cell, event: Mapping[str, Any]) -> None: ...
    def examination(self, name: str, number: int, total: int) -> None: ...


@dataclass(frozen=True, slots=True)
class Options:
    """How to run: `retry` measures failed and timed-out cells again, `fail_fast` stops at the first such cell.

    `cluster` is the address of a Dask scheduler whose machines render; None: this one does.
    """

    retry: bool = False
    fail_fast: bool = False
    allow_imports: bool = False
    allow_commands: bool = False
    command: Sequence[str] = ()
    cluster: str | None = None


@dataclass(slots=True)
class Outcome:
    """What a run ended with. `states` counts the plan's cells."""

    measured: int = 0
    states: dict[str, int] = field(default_factory=dict)
    failures: list[tuple[Cell, Mapping[str, Any]]] = field(default_factory=list)
    unexamined: list[str] = field(default_factory=list)
    """Examinations that failed or timed out, each with its message."""
    stopped: bool = False


def run(plan: Plan, folder: Path, options: Options, listener: Listener) -> Outcome:
    """Measures what is missing. The folder must be locked by the caller. On `KeyboardInterrupt` all workers end."""
    if options.cluster is None:
        return _run(plan, folder, options, listener, None)
    from harness.cluster import Cluster

    with Cluster(options.cluster, options.allow_imports, plan.experiment.limits.memory_bytes) as cluster:
        return _run(plan, folder, options, listener, cluster)


def _run(plan: Plan, folder: Path, options: Options, listener: Listener, cluster: Cluster | None) -> Outcome:
    with store.Events(folder) as events:
        if events.torn:
            listener.note(f"{folder / store.EVENTS}: {store.TORN}")
        sweep = Sweep(plan, folder, options, listener, events)
        sweep.record_plan()
        log = confined.inside(folder, LOG, str(folder))
        with Pool(options.allow_imports, log, plan.experiment.limits.memory_bytes) as pool:
            sweep.make_references(cluster or pool)
            if cluster is None:
                sweep.blocks(pool)
            else:
                cluster.measure(sweep)
            sweep.examine(pool)
        sweep.record_targets()
        return sweep.outcome()


class Sweep:
    """The state of one run."""

    def __init__(
        self, plan: Plan, folder: Path, options: Options, listener: Listener, events: store.Events
    ) -> None:  # fmt: skip
        self.plan, self.folder, self.options, self.listener, self.events = plan, folder, options, listener, events
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

    def append(self, event: Mapping[str, Any]) -> None:
        self.events.append(event)
        self.history.append(dict(event))
        if event["event"] == "cell":
            self.latest[event["cell_id"]] = dict(event)

    # --- what is planned --------------------------------------------------------------------------------------------

    def record_plan(self) -> None:
        """Writes the manifest; says which old results no longer count, which do again, and what cannot be done."""
        experiment = self.plan.experiment
        self._revive()
        todo, unexamined = self.todo(), self.unexamined()
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self._write_manifest(now, bool(todo or unexamined))
        if todo or unexamined:
            run_id = digest([now, *(cell.cell_id for cell in todo), *(each.examination_id for each in unexamined)])
            self.append({
                "event": "run", "time": now, "run_id": run_id, "command": list(self.options.command),
                "config_name": experiment.name,
            })  # fmt: skip
        self.record_environment(self.env_id, self.environment)
        self._note_other_machines()
        if experiment.quality.targets is not None:
            self._append_targets(list(experiment.quality.targets))
        planned = {cell.cell_id for cell in self.plan.cells}
        for cell_id, event in list(self.latest.items()):
            if cell_id not in planned and event["state"] != "outdated":
                self.append({**event, "state": "outdated", "message": "no longer asked for"})
        for cell in self.plan.cells:
            if cell.skip and not up_to_date(cell, self.latest.get(cell.cell_id), self.metric):
                self.append(self.event(cell, "skipped", cell.skip))

    def _write_manifest(self, now: str, running: bool) -> None:
        """Replaces the manifest where it would say something else, or something is going to be measured."""
        experiment = self.plan.experiment
        same = {
            "raybench_results": 1, "name": experiment.name, "config_name": experiment.name,
            "config": json.loads(json.dumps(experiment.resolved)), "env_id": self.env_id,
            "cell_ids": [cell.cell_id for cell in self.plan.cells],
            "examination_ids": [each.examination_id for each in self.plan.examinations],
        }  # fmt: skip
        path = self.folder / store.MANIFEST
        before = store.read_manifest(self.folder) if path.exists() else {}
        if running or any(before.get(key) != value for key, value in same.items()):
            told = {"time": now, "command": list(self.options.command), "machine": machine.provenance()}
            store.write_json(path, {**same, **told})

    def _revive(self) -> None:
        """Results that a changed plan had put aside count again when they are asked for again."""
        wanted = {cell.cell_id: cell for cell in self.plan.cells}
        last: dict[str, Mapping[str, Any]] = {}
        for event in self.history:
            if event["event"] == "cell" and event["state"] != "outdated":
                last[event["cell_id"]] = event
        for cell_id, event in last.items():
            outdated = self.latest[cell_id]["state"] == "outdated"
            if outdated and cell_id in wanted and up_to_date(wanted[cell_id], event, self.metric):
                self.append(event)

    def record_environment(self, env_id: str, preimage: Mapping[str, Any]) -> None:
        """Says once what an environment id stands for."""
        if not any(e["event"] == "environment" and e["env_id"] == env_id for e in self.history):
            self.append({"event": "environment", "env_id": env_id, "preimage": dict(preimage)})

    def _note_other_machines(self) -> None:
        planned = {cell.cell_id for cell in self.plan.cells}
        elsewhere = [e for i, e in self.latest.items() if i in planned and e.get("env_id") != self.env_id]
        if elsewhere and self.options.cluster is None:
            self.listener.note(
                f"{len(elsewhere)} cells were measured on another machine or with other library versions: "
                "times are not comparable; --fresh measures all again"
            )

    def _append_targets(self, targets: list[float]) -> None:
        event = {"event": "targets", "metric": self.metric, "targets": targets}
        if store.last_event(self.history, "targets") != event:
            self.append(event)

    def todo(self) -> list[Cell]:
        """Cells to be measured, in order."""

        def wanted(cell: Cell) -> bool:
            event = self.latest.get(cell.cell_id)
            again = self.options.retry and event is not None and event["state"] in BROKEN
            return not cell.skip and (again or not up_to_date(cell, event, self.metric))

        return [cell for cell in self.plan.cells if wanted(cell)]

    # --- references -------------------------------------------------------------------------------------------------

    def make_references(self, pool: references.Images) -> None:
        """Makes what cells to be measured need; a cell whose reference fails has failed."""
        needed = dict.fromkeys(cell.reference_id for cell in self.todo())
        named = {e["reference_id"] for e in self.history if e["event"] == "reference"}
        for reference_id, wanted in self.plan.references.items():
            try:
                if reference_id in needed and not references.ready(wanted, self.root):
                    self._make_reference(wanted, pool)
            except (WorkerFailed, WorkerTimeout) as error:
                self._without_reference(reference_id, f"no reference: {error}")
                continue
            if reference_id not in named and references.ready(wanted, self.root):
                self.append(references.event(wanted, self.root))
            self._certify(wanted, pool)

    def _make_reference(self, wanted: references.ReferenceWanted, pool: references.Images) -> None:
        references.make(
            wanted, self.root, pool,
            lambda done, count: self.listener.reference(wanted.describe(), done, count),
            lambda: self.listener.note(f"reference of {wanted.describe()}: another run makes it: waiting for that one"),
        )  # fmt: skip

    def _certify(self, wanted: references.ReferenceWanted, pool: references.Images) -> None:
        """Has the reference compared with a second engine's image, once, and says what came out."""
        if wanted.certifier is None or not references.ready(wanted, self.root):
            return
        found = certify.existing(wanted, self.root)
        try:
            found = found or certify.make(
                wanted, self.root, pool,
                lambda done, count: self.listener.reference(f"certificate of {wanted.describe()}", done, count),
            )  # fmt: skip
        except (WorkerFailed, WorkerTimeout) as error:
            self.listener.note(f"{wanted.describe()}: no certificate: {error}")
            return
        said = [e["certificate_id"] for e in self.history if e["event"] == "certificate"]
        if found["certificate_id"] not in said:
            self.append({key: value for key, value in found.items() if key != "machine"})
            if found["verdict"] != "equivalent":
                self.listener.note(f"reference of {wanted.describe()}: {certify.words(found)}")

    def _without_reference(self, reference_id: str, message: str) -> None:
        self.listener.note(message)
        self._refused.add(reference_id)
        for cell in self.todo():
            if cell.reference_id == reference_id:
                self.append(self.event(cell, "failed", message))
        self.stopped = self.options.fail_fast

    # --- cells ------------------------------------------------------------------------------------------------------

    def ready(self) -> list[Cell]:
        """Cells to be measured whose reference is there, in order."""
        return [cell for cell in self.todo() if cell.reference_id not in self._refused]

    def blocks(self, pool: Pool) -> None:
        """Measures cell after cell; every block begins with fresh workers and a sentinel."""
        todo = self.ready()
        block = None
        for number, cell in enumerate(todo):
            if self.stopped:
                return
            if cell.block != block:
                block = cell.block
                pool.renew()
                seconds = median(sentinel_seconds() for _ in range(3))
                self.append({"event": "sentinel", "block": block, "seconds": seconds})
            left = expected_seconds(todo[number:], self.latest)
            self.listener.cell(cell, number, len(todo), sum(seconds for seconds, _ in left.values()))
            self.begin(cell)
            began, sentinel = monotonic(), sentinel_seconds()
            record = Recording(self, cell, self.env_id)
            asked = request(cell, self.plan.experiment.checkpoints)
            with closing(pool.cell(cell.engine, asked, cell.budget.timeout_seconds)) as heard:
                event = self.measured_as(record, heard, sentinel)
            self.finish(cell, {**event, "wall_seconds": monotonic() - began})

    def begin(self, cell: Cell) -> None:
        """Says that a cell is being measured, and removes what an earlier attempt left."""
        store.discard_images(self.folder, cell.cell_id)
        self.events.append({"event": "start", "cell_id": cell.cell_id, "time": datetime.now(UTC).isoformat()})

    def finish(self, cell: Cell, event: Mapping[str, Any]) -> None:
        """Puts a cell's event on disk."""
        self.append(event)
        self.measured += 1
        self.listener.finished(cell, event)
        self.stopped = self.options.fail_fast and event["state"] in BROKEN

    def measured_as(self, record: Recording, heard: Iterable[Heard], sentinel: float) -> dict[str, Any]:
        """The event of a cell that has been measured, has failed or was killed at its timeout."""
        cell, state, message = record.cell, "done", ""
        try:
            record.follow(heard)
        except WorkerFailed as error:
            state, message = "failed", str(error)
        except WorkerTimeout:
            state, message = "timeout", f"killed after {cell.budget.timeout_seconds:g} s"
        record.keep_last_image()
        spp = record.points[-1]["spp"] if record.points else 0
        event = {
            **self.event(cell, state, message, spp), "env_id": record.env_id, "phases": record.phases,
            "points": record.points, "counters": record.counters, "machine": record.disturbance,
            "sentinel_seconds": sentinel,
        }  # fmt: skip
        try:
            records.event(event, "what the engine tells is unusable")
        except ConfigError as error:  # it must not make the whole folder unreadable
            return {**self.event(cell, "failed", str(error)), "env_id": record.env_id}
        return event

    def event(self, cell: Cell, state: str, message: str, spp: int = 0) -> dict[str, Any]:
        """An event that says everything about a cell but what was measured; `spp` are those of its last image."""
        return {
            "event": "cell", "cell_id": cell.cell_id, "configuration": cell.configuration, "env_id": self.env_id,
            "label": cell.label, "state": state, "message": message, "block": cell.block, "order": cell.order,
            "seed": cell.seed, "scene": cell.scene.name, "scene_hash": cell.scene_hash,
            "primitives": cell.primitives, "engine": cell.engine_name,
            "engine_version": cell.asked["engine_version"], **cell.settings,
            "reference_id": cell.reference_id, "asked": dict(cell.asked),
            "command": cell.command(spp or cell.budget.max_spp),
            "time": datetime.now(UTC).isoformat(timespec="seconds"), "phases": {}, "points": [], "counters": {},
            "machine": {},
        }  # fmt: skip

    def reference(self, reference_id: str) -> Any:
        """The arrays of a reference, read and checked once."""
        if reference_id not in self._loaded:
            wanted = self.plan.references[reference_id]
            self._loaded[reference_id] = reference_files.read(wanted.folder(self.root), reference_id, wanted.scene_hash)
        return self._loaded[reference_id]

    # --- examinations ------------------------------------------------------------------------------------------------

    def unexamined(self) -> list[examinations.Examination]:
        return examinations.todo(self.plan.examinations, self.history, self.options.retry)

    def examine(self, pool: Pool) -> None:
        """What the config asks of the battery, after everything that is timed."""
        todo = self.unexamined()
        for number, each in enumerate(todo):
            if self.stopped:
                return
            self.listener.examination(each.words, number, len(todo))
            event = examinations.make(each, pool, self.env_id)
            self.append(event)
            self.stopped = self.options.fail_fast and event["state"] in BROKEN

    # --- the end ----------------------------------------------------------------------------------------------------

    def record_targets(self) -> None:
        """Resolves `auto` targets once: later results move none of them."""
        last = store.last_event(self.history, "targets")
        if self.plan.experiment.quality.targets is None and (last is None or last["metric"] != self.metric):
            targets = automatic_targets(self.latest.values(), self.metric)
            if targets:
                self._append_targets(targets)

    def outcome(self) -> Outcome:
        found = Outcome(self.measured, stopped=self.stopped)
        for cell in self.plan.cells:
            event = self.latest.get(cell.cell_id)
            state = "queued" if event is None or event["state"] == "outdated" else str(event["state"])
            found.states[state] = found.states.get(state, 0) + 1
            if event is not None and state in BROKEN:
                found.failures.append((cell, event))
        known = examinations.latest(self.history)
        events = [(each, known.get(each.examination_id)) for each in self.plan.examinations]
        found.unexamined = [f"{event['state']}: {each.words}: {event['message']}"
                            for each, event in events if event is not None and event["state"] in BROKEN]  # fmt: skip
        return found
