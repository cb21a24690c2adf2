"""Runs a comparison by rays: sets and exact answers here, blocks of contestants in random order in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from engines.errors import ConfigError, RaybenchError
from engines.registry import engine as engine_of
from engines.registry import is_file
from engines.scene import Mesh, Scene, SphereSet
from engines.temporary import TemporaryFolder
from harness.config.settings import SceneFile
from harness.measure import machine, tracing
from harness.measure.pool import Pool, WorkerFailed, WorkerTimeout
from harness.settings import require_imports
from harness.trace.experiment import TraceExperiment
from harness.trace.judge import Faults, Judge, leaks
from harness.trace.rays import Rays, hard_rays, make_rays
from harness.trace.records import Answers, Entry, Timing, TraceResults
from harness.trace.truth import Truth

TWINS_FROM = 3
"""Blocks from which on the baseline has an A/A twin."""
Note = Callable[[str], None]


@dataclass(slots=True)
class _Set:
    """Rays of a scene with the exact answers to some of them, and the file from which workers read them."""

    scene: SceneFile
    scene_hash: str
    kind: str
    judge: Judge
    hard: Rays
    file: Path


@dataclass(slots=True)
class _Task:
    """What a contestant does in each block; `first` holds its answers in the first one."""

    entry: Entry
    engine: str
    request: Mapping[str, Any]
    of: _Set
    first: Mapping[str, Any] = field(default_factory=dict)


def run(
    experiment: TraceExperiment, folder: Path, note: Note, allow_imports: bool = False, command: Sequence[str] = ()
) -> TraceResults:
    """Measures everything and judges the answers. `note` is called with a line of progress while nothing is on the clock.

    Raises `ConfigError` for engines that cannot be loaded and for scenes that lack such rays.
    """
    _require_engines(experiment, allow_imports)
    with TemporaryFolder() as name:
        tasks: list[_Task] = []
        entries: list[Entry] = []
        for scene in experiment.scene:
            found = _prepared(experiment, scene, Path(name), note, allow_imports)
            entries += [entry for entry, _ in found]
            tasks += [task for _, task in found if task is not None]
        with Pool(allow_imports, folder / "worker.log") as pool:
            _measure(experiment, tasks, pool, note)
    return TraceResults(
        name=experiment.name,
        time=datetime.now(UTC).isoformat(timespec="seconds"),
        command=list(command),
        config=experiment.normalised(),
        machine=machine.provenance(),
        entries=entries,
    )


def _require_engines(experiment: TraceExperiment, allow_imports: bool) -> None:
    """Refuses engines that trace nothing, and accelerators that none of the engines has."""
    for name in experiment.engine:
        require_imports(name, allow_imports)
        if is_file(name):
            raise ConfigError(f"{name}: an external renderer traces no single rays")
    for name in dict.fromkeys(each.name for each in experiment.accelerator):
        require_imports(name, allow_imports)
        engines = [engine_of(each) for each in experiment.engine]
        if ":" not in name and not any(name in engine.accelerators() for engine in engines):
            known = sorted({each for engine in engines for each in engine.accelerators()})
            raise ConfigError(f"accelerator {name!r}: none of the engines has it: known: {', '.join(known)}")


def _prepared(
    experiment: TraceExperiment, file: SceneFile, folder: Path, note: Note, allow_imports: bool
) -> list[tuple[Entry, _Task | None]]:
    """The entries of a scene, each with what is to be done for it unless its engine declines."""
    note(f"{file.name}: rays and exact answers")
    scene = file.load(allow_imports)
    truth, found = Truth(scene), []
    hard = hard_rays(truth, experiment.hard, experiment.seed)
    for kind in experiment.rays:
        rays = make_rays(kind, scene, truth, experiment.count, experiment.bounces, experiment.seed)
        rng = np.random.default_rng([experiment.seed, 100])
        checked = np.sort(rng.choice(experiment.count, min(experiment.checked, experiment.count), replace=False))
        path = folder / f"{len(list(folder.iterdir()))}.npz"
        tracing.write_rays(path, rays, checked, hard)
        one = _Set(file, scene.identity, kind, Judge(truth, rays.take(checked)), hard, path)
        found += _contestants(experiment, scene, one, len(checked), allow_imports)
    return found


def _contestants(
    experiment: TraceExperiment, scene: Scene, of: _Set, checked: int, allow_imports: bool
) -> list[tuple[Entry, _Task | None]]:
    """All contestants of a set, and after each baseline its A/A twin."""
    found: list[tuple[Entry, _Task | None]] = []
    compared: set[int] = set()
    for wanted in experiment.contestants:
        engine = engine_of(wanted.engine)
        if ":" not in wanted.accelerator.name and wanted.accelerator.name not in engine.accelerators():
            continue
        try:
            reason = tracing.why_not(engine, scene, wanted.describe(), allow_imports)
        except RaybenchError as error:
            reason = str(error)
        threads = wanted.threads
        is_base = threads not in compared and reason is None and experiment.baseline in (None, wanted.engine)
        for twin in (False, True) if is_base and experiment.repeats >= TWINS_FROM else (False,):
            entry = Entry(
                scene=of.scene.name,
                primitives=sum(map(_size, scene.shapes)),
                rays=of.kind,
                count=experiment.count,
                engine=engine.name,
                version=str(engine.version),
                accelerator=str(wanted.accelerator),
                precision=wanted.precision,
                threads=threads,
                twin=twin,
                baseline=is_base and not twin,
                state="skipped" if reason else "done",
                message=reason or "",
            )
            request = {
                "scene_path": of.scene.path,
                **of.scene.options,
                "scene_hash": of.scene_hash,
                "rays": str(of.file),
                "set": of.kind,
                **wanted.describe(),
                "batch": experiment.batch,
                "max_time_seconds": experiment.max_time_seconds,
                "checked": checked,
                "hard": len(of.hard.t_max),
            }
            found.append((entry, None if reason else _Task(entry, wanted.engine, request, of)))
        if is_base:
            compared.add(threads)
    return found


def _size(shape: Any) -> int:
    return len(shape.faces) if isinstance(shape, Mesh) else len(shape.radii) if isinstance(shape, SphereSet) else 1


def _measure(experiment: TraceExperiment, tasks: Sequence[_Task], pool: Pool, note: Note) -> None:
    """Every block begins with fresh workers, and has an order of its own. What has failed is not tried again."""
    rng = np.random.default_rng([experiment.seed, 101])
    for block in range(experiment.repeats):
        pool.renew()
        for order, index in enumerate(rng.permutation(len(tasks)).tolist()):
            task = tasks[index]
            if task.entry.state == "done":
                what = f"{task.entry.scene} {task.entry.rays} {contestant_text(task.entry)}"
                note(f"[{block * len(tasks) + order + 1}/{experiment.repeats * len(tasks)}] {what}")
                _measure_one(experiment, task, pool, block, order)


def _measure_one(experiment: TraceExperiment, task: _Task, pool: Pool, block: int, order: int) -> None:
    entry = task.entry
    try:
        found = pool.trace(task.engine, task.request, experiment.timeout_seconds)
    except WorkerFailed as error:
        entry.state, entry.message = "failed", str(error)
        return
    except WorkerTimeout:
        entry.state, entry.message = "timeout", f"killed after {experiment.timeout_seconds:g} s"
        return
    disturbed, phases, answers = found.machine, found.phases, found.answers
    entry.timings.append(
        Timing(
            block=block,
            order=order,
            passes=found.timed.passes,
            seconds=max(float(found.timed.seconds), 1e-9),
            cpu_seconds=disturbed.get("cpu_seconds"),
            contended=bool(disturbed["contended"]),
            load_seconds=float(phases.load_seconds),
            build_seconds=float(phases.build_seconds),
            first_call_seconds=float(phases.compile_seconds),
        )
    )
    if entry.answers is None:
        entry.answers, task.first = _judged(task, answers), answers
    elif any(not np.array_equal(answers[name], task.first[name]) for name in answers):
        entry.unstable = True


def _judged(task: _Task, answers: Mapping[str, Any]) -> Answers:
    hard = task.of.hard
    if task.of.kind == "shadow":
        faults, leaked = task.of.judge.occlusions(answers["blocked"]), int((~answers["hard_blocked"]).sum())
    else:
        faults = task.of.judge.hits(answers["t"], answers["shape"], answers["primitive"])
        leaked = leaks(hard, answers["hard_t"])
    return Answers(
        checked=faults.checked,
        wrong=faults.wrong,
        missed=faults.missed,
        false_hits=faults.false_hits,
        hard=len(hard.t_max),
        leaks=leaked,
        **_quantiles(faults),
    )


def _quantiles(faults: Faults) -> dict[str, float]:
    if not faults.errors.size:
        return {}
    shares = {"t_median": 0.5, "t_p999": 0.999, "t_worst": 1.0}
    return {name: float(np.quantile(faults.errors, share)) for name, share in shares.items()}


def contestant_text(entry: Entry) -> str:
    """A contestant in a few words."""
    parts = [entry.engine, "" if entry.accelerator == "auto" else entry.accelerator, entry.precision or ""]
    return " ".join(filter(None, [*parts, f"{entry.threads}t" if entry.threads > 1 else "", "(twin)" if entry.twin else ""]))
