"""The run: references, then blocks of cells in random order, one at a time, each result on disk before the next begins.

What is measured again is decided by `plan.state`; what it writes is decided by `recorder`. A cell that fails
or runs out of time is recorded and the sweep goes on. Nothing here renders: `measure.worker` does, and while this process
computes errors or draws progress no ray is traced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engines.errors import ConfigError, RaybenchError
from harness import store
from harness.analysis.certificates import certificate_text, certifies
from harness.analysis.targets import automatic_targets
from harness.hashing import digest
from harness.measure import machine
from harness.measure.pool import Pool, WorkerFailed, WorkerTimeout
from harness.plan import verify_jobs as planned_jobs
from harness.plan.cells import Cell, Plan
from harness.plan.references import PlannedReference
from harness.plan.state import up_to_date
from harness.run import certificates, reference_samples, references, verify_jobs
from harness.run.executors import local
from harness.run.progress import Listener
from harness.run.ray_sets import MadeRaySets
from harness.run.recorder import Recorder
from harness.store import confined, records
from harness.store.records import BROKEN, Manifest, Run, Targets
from harness.store.validation import FORMAT_VERSION

if TYPE_CHECKING:
    from harness.run.executors.dask import Cluster

LOG = "worker.log"


@dataclass(frozen=True, slots=True)
class Options:
    """How to run: `retry` measures failed and timed-out cells again, `fail_fast` stops at the first such cell.

    `cluster` is the address of a Dask scheduler whose machines render; None: this one does.
    """

    retry: bool = False
    fail_fast: bool = False
    allow_imports: bool = False
    allow_commands: bool = False
    allow_outside: bool = False
    command: Sequence[str] = ()
    cluster: str | None = None


@dataclass(slots=True)
class Outcome:
    """What a run ended with. `states` counts the plan's cells."""

    measured: int = 0
    states: dict[str, int] = field(default_factory=dict)
    failures: list[tuple[Cell, records.AnyCell]] = field(default_factory=list)
    failed_verify_jobs: list[str] = field(default_factory=list)
    """Verify jobs that failed or timed out, each with its message."""
    stopped: bool = False


def run(plan: Plan, folder: Path, options: Options, listener: Listener) -> Outcome:
    """Measures what is missing. The folder must be locked by the caller. On `KeyboardInterrupt` all workers end."""
    if options.cluster is None:
        return _run(plan, folder, options, listener, None)
    if any(cell.ray_set for cell in plan.cells):
        raise ConfigError(f"--cluster {options.cluster}: rays are traced on this machine: run such cells without it")
    from harness.run.executors.dask import Cluster

    experiment = plan.experiment
    limit = experiment.limits.memory_bytes
    with Cluster(options.cluster, options.allow_imports, experiment.folder.absolute(), limit) as cluster:
        return _run(plan, folder, options, listener, cluster)


def _run(plan: Plan, folder: Path, options: Options, listener: Listener, cluster: Cluster | None) -> Outcome:
    with store.Events(folder) as events:
        if events.torn:
            listener.note(f"{folder / store.EVENTS}: {store.TORN}")
        sweep = Sweep(plan, folder, options, listener, events)
        sweep.record_plan()
        log = confined.inside(folder, LOG, str(folder))
        limit, code = plan.experiment.limits.memory_bytes, plan.experiment.folder
        with Pool(options.allow_imports, log, limit, code) as pool, sweep.recorder.ray_sets:
            sweep.make_references(cluster or pool)
            sweep.make_ray_sets()
            if cluster is None:
                local.measure(sweep.recorder, pool)
            else:
                cluster.measure(sweep.recorder)
            sweep.run_verify_jobs(pool)
        sweep.record_targets()
        return sweep.outcome()


class Sweep:
    """One run around its cells: what is planned, references before them, verify jobs and targets after them."""

    def __init__(self, plan: Plan, folder: Path, options: Options, listener: Listener, events: store.Events) -> None:
        self.plan, self.options, self.listener = plan, options, listener
        self.recorder = Recorder(
            plan, folder, listener, events, options.retry, options.fail_fast, MadeRaySets(options.allow_imports)
        )

    # --- what is planned --------------------------------------------------------------------------------------------

    def record_plan(self) -> None:
        """Writes the manifest; says which old results no longer count, which do again, and what cannot be done."""
        experiment = self.plan.experiment
        self._revive()
        todo, jobs = self._cells(), self.pending_verify_jobs()
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self._write_manifest(now, bool(todo or jobs))
        if todo or jobs:
            run_id = digest([now, *(cell.cell_id for cell in todo), *(each.verify_job_id for each in jobs)])
            command = tuple(self.options.command)
            self.recorder.append(Run(time=now, run_id=run_id, command=command, config_name=experiment.name))
        self.recorder.record_environment(self.recorder.env_id, self.recorder.environment)
        self._note_other_machines()
        self._note_skipped()
        if experiment.quality.targets is not None:
            self._append_targets(experiment.quality.targets)
        planned = {cell.cell_id for cell in self.plan.cells}
        for cell_id, event in list(self.recorder.latest.items()):
            if cell_id not in planned and event.state != "outdated":
                self.recorder.append(event.replaced(state="outdated", message="no longer in the experiment"))
        for cell in self.plan.cells:
            if cell.skip and not up_to_date(cell, self.recorder.latest.get(cell.cell_id), self.recorder.metric):
                self.recorder.append(self.recorder.event(cell, "skipped", cell.skip))
            known = self.recorder.latest.get(cell.cell_id)
            if known is not None and known.division != cell.division:
                self.recorder.append(known.replaced(division=cell.division))

    def _note_skipped(self) -> None:
        """A line for each engine and reason: the engine, or how many of its cells where others are measured."""
        scenes = {cell.scene.name for cell in self.plan.cells}
        measured = {(cell.engine_name, cell.scene.name) for cell in self.plan.cells if not cell.skip}
        skipped: dict[tuple[str, str], list[str]] = {}
        for cell in self.plan.cells:
            if cell.skip:
                skipped.setdefault((cell.engine_name, cell.skip), []).append(cell.scene.name)
        for (engine, reason), of_cells in skipped.items():
            where = set(of_cells)
            on = "" if where == scenes else f" on {', '.join(sorted(where))}"
            some = any((engine, name) in measured for name in where)
            what = f"{len(of_cells)} cells of {engine} are" if some else f"{engine} is"
            self.listener.note(f"{what} skipped{on}: {reason}")

    def _cells(self) -> list[Cell]:
        """What is to be measured, and what may be measured again: on another machine it may be another contestant."""
        here = self.options.cluster is None
        again = self.recorder.contended(self.plan.experiment.remeasure)
        elsewhere = {id for id, e in self.recorder.latest.items() if here and e.env_id != self.recorder.env_id}
        return [*self.recorder.todo(), *(cell for cell in again if cell.cell_id not in elsewhere)]

    def _write_manifest(self, now: str, running: bool) -> None:
        """Replaces the manifest where it would say something else, or something is going to be measured."""
        experiment = self.plan.experiment
        same = Manifest(
            raybench_results=FORMAT_VERSION,
            name=experiment.name,
            config_name=experiment.name,
            config=experiment.normalised(),
            env_id=self.recorder.env_id,
            cell_ids=tuple(cell.cell_id for cell in self.plan.cells),
            verify_job_ids=tuple(each.verify_job_id for each in self.plan.verify_jobs),
            warnings=tuple(self.plan.warnings),
        )
        folder = self.recorder.folder
        before = store.read_manifest(folder) if (folder / store.MANIFEST).exists() else None
        if running or before is None or any(getattr(before, key) != getattr(same, key) for key in same.model_fields_set):
            moment = {"time": now, "command": tuple(self.options.command), "machine": self._provenance()}
            store.write_manifest(folder, same.replaced(**moment))

    def _provenance(self) -> dict[str, Any]:
        return {**machine.provenance(), "project": machine.project_state(self.plan.experiment.folder)}

    def _revive(self) -> None:
        """Results that a changed plan had put aside count again when the plan has them again."""
        cells = {cell.cell_id: cell for cell in self.plan.cells}
        last = store.latest_cells(event for event in self.recorder.history if getattr(event, "state", "") != "outdated")
        for cell_id, event in last.items():
            outdated = self.recorder.latest[cell_id].state == "outdated"
            if outdated and cell_id in cells and up_to_date(cells[cell_id], event, self.recorder.metric):
                self.recorder.append(event)

    def _note_other_machines(self) -> None:
        planned = {cell.cell_id for cell in self.plan.cells}
        elsewhere = [e for i, e in self.recorder.latest.items() if i in planned and e.env_id != self.recorder.env_id]
        if elsewhere and self.options.cluster is None:
            self.listener.note(
                f"{len(elsewhere)} cells were measured on another machine or with other library versions: "
                "times are not comparable; --fresh measures all again"
            )

    def _append_targets(self, targets: Sequence[float]) -> None:
        event = Targets(metric=self.recorder.metric, targets=tuple(targets))
        if store.last_event(self.recorder.history, Targets) != event:
            self.recorder.append(event)

    # --- references -------------------------------------------------------------------------------------------------

    def make_references(self, pool: references.Images) -> None:
        """Makes what cells to be measured need; a cell whose reference fails has failed."""
        needed = dict.fromkeys(cell.reference_id for cell in self._cells())
        named = {event.reference_id: event.spp for event in store.of_kind(self.recorder.history, records.Reference)}
        for reference_id, planned in self.plan.references.items():
            if self.recorder.stopped:
                return
            try:
                if reference_id in needed:
                    made = not references.ready(planned, self.recorder.root)
                    if made:
                        self._make_reference(planned, pool)
                    self._note_samples(planned, made)
            except (WorkerFailed, WorkerTimeout) as error:
                self.recorder.without(reference_id, f"no reference: {error}")
                continue
            if references.ready(planned, self.recorder.root):
                event = references.event(planned, self.recorder.root)
                if named.get(reference_id) != event.spp:  # it is new, or has been extended
                    self.recorder.append(event)
            self._certify(planned, pool)
        self._write_references()

    def _write_references(self) -> None:
        """Says in the manifest with how many samples the references came out."""
        folder, made = self.recorder.folder, store.of_kind(self.recorder.history, records.Reference)
        spp = {event.reference_id: event.spp for event in made if event.reference_id in self.plan.references}
        if (manifest := store.read_manifest(folder)).reference_spp != spp:
            store.write_manifest(folder, manifest.replaced(reference_spp=spp))

    def make_ray_sets(self) -> None:
        """Makes the sets of rays that cells to be measured trace; a cell whose set cannot be made has failed."""
        for planned in dict.fromkeys(cell.ray_set for cell in self._cells() if cell.ray_set):
            if self.recorder.stopped:
                return
            self.listener.note(f"{planned.describe()}: exact answers are computed")
            try:
                self.recorder.ray_sets.of(planned)
            except ConfigError:  # they cannot be written: no failure of the cells
                raise
            except RaybenchError as error:
                self.recorder.without(planned.ray_set_id, f"no rays: {error}")

    def _make_reference(self, planned: PlannedReference, pool: references.Images) -> None:
        references.make(
            planned,
            self.recorder.root,
            pool,
            lambda done, count: self.listener.reference(planned.describe(), done, count),
            lambda: self.listener.note(f"reference of {planned.describe()}: another run makes it: waiting for that one"),
        )

    def _note_samples(self, planned: PlannedReference, made: bool) -> None:
        """Says of a new reference whether it has samples enough for the targets, of another one if it has too few."""
        found = reference_samples.sufficiency(planned, self.recorder.root, self.plan.experiment.quality)
        if made or found.enough is False:
            self.listener.note(f"reference of {planned.describe()}: {found.message}")

    def _certify(self, planned: PlannedReference, pool: references.Images) -> None:
        """Has the reference compared with the image of another lineage, once, and says what came out."""
        if planned.certifier is None or not references.ready(planned, self.recorder.root):
            return
        found = certificates.existing(planned, self.recorder.root)
        try:
            found = found or certificates.make(
                planned,
                self.recorder.root,
                pool,
                lambda done, count: self.listener.reference(f"{planned.describe()}, certificate", done, count),
            )
        except (WorkerFailed, WorkerTimeout) as error:
            self.listener.note(f"{planned.describe()}: no certificate: {error}")
            return
        said = [event.certificate_id for event in store.of_kind(self.recorder.history, records.Certificate)]
        if found.certificate_id not in said:
            self.recorder.append(found)
            if not certifies(found):
                self.listener.note(f"reference of {planned.describe()}: {certificate_text(found)}")

    # --- verify jobs ------------------------------------------------------------------------------------------------

    def pending_verify_jobs(self) -> list[planned_jobs.VerifyJob]:
        return planned_jobs.todo(self.plan.verify_jobs, self.recorder.history, self.options.retry)

    def run_verify_jobs(self, pool: Pool) -> None:
        """Runs the cases that the config's `verify` names, after everything that is timed."""
        todo = self.pending_verify_jobs()
        for number, each in enumerate(todo):
            if self.recorder.stopped:
                return
            self.listener.verify_job(each.words, number, len(todo))
            event = verify_jobs.make(each, pool, self.recorder.env_id)
            self.recorder.append(event)
            self.recorder.stop_if_broken(event)

    # --- the end ----------------------------------------------------------------------------------------------------

    def record_targets(self) -> None:
        """Resolves `auto` targets once: later results move none of them."""
        last = store.last_event(self.recorder.history, Targets)
        if self.plan.experiment.quality.targets is None and (last is None or last.metric != self.recorder.metric):
            targets = automatic_targets(store.of_kind(self.recorder.latest.values(), records.Cell), self.recorder.metric)
            if targets:
                self._append_targets(targets)

    def outcome(self) -> Outcome:
        found = Outcome(self.recorder.measured, stopped=self.recorder.stopped)
        for cell in self.plan.cells:
            event = self.recorder.latest.get(cell.cell_id)
            state = "queued" if event is None or event.state == "outdated" else event.state
            found.states[state] = found.states.get(state, 0) + 1
            if event is not None and state in BROKEN:
                found.failures.append((cell, event))
        known = store.latest_verify_jobs(self.recorder.history)
        events = [(each, known.get(each.verify_job_id)) for each in self.plan.verify_jobs]
        found.failed_verify_jobs = [
            f"{event.state}: {each.words}: {event.message}"
            for each, event in events
            if event is not None and event.state in BROKEN
        ]
        return found
