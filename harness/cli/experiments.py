"""What the commands about experiments do; the exit code is the return value where one is needed."""

from __future__ import annotations

import re
import signal
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from engines.errors import ConfigError
from harness import config, store
from harness.analysis.certificates import certificate_text, refutes
from harness.cli.results import analysed, require_results, write_derived
from harness.config import ConfigFile, Experiment
from harness.console import consoles
from harness.measure.machine import usable_cores
from harness.measure.pool import Pool, WorkerFailed
from harness.plan import planner, verify_jobs
from harness.plan.cells import Cell, Plan
from harness.plan.state import expected_seconds, state_of
from harness.run import certificates, progress, reference_samples, references, sweep
from harness.run.sweep import Options, Outcome
from harness.settings import CellSettings
from harness.store import reference_files
from harness.store.records import BROKEN, Start

Summary = Callable[[Console, Outcome, Path], None]
Answer = Callable[[Console, Any], None]
"""Prints what an `Analysis` says."""
Allowed = tuple[bool, bool, bool]
"""Whether imports, commands and files outside of a scene's folder are allowed."""


def results_folder(experiment: Experiment, out: Path | None) -> Path:
    """Where an experiment's results go: `out`, else `results/` and its name as a folder's name."""
    return out or Path("results") / (re.sub(r"[^A-Za-z0-9._-]+", "-", experiment.name).strip("-.") or "experiment")


def run(
    given: str | ConfigFile,
    out: Path | None,
    overrides: Sequence[str],
    fresh: bool,
    options: Options,
    summary: Summary | None = None,
    terminal: Callable[[Console, Plan], progress.Terminal] = progress.Terminal,
    answer: Answer | None = None,
) -> int:
    """Measures and reports; 0, 1 where a cell failed or timed out, 130 where it was interrupted. `terminal` shows progress,
    `answer` says what was found before tables, plots and report are written, `summary` what came out, by default
    `print_summary`."""
    stdout, stderr = consoles()
    experiment = config.load(given, overrides)
    folder = results_folder(experiment, out)
    plan = planner.make(experiment, options.allow_imports, options.allow_commands, options.allow_outside)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        with store.locked(folder):
            if fresh:
                store.clear(folder)
            _refuse_merged(folder)
            _warn(plan, stderr)
            with terminal(stderr, plan) as listener:
                outcome = sweep.run(plan, folder, options, listener)
            found = analysed(folder) if answer else None
            if answer and found:
                answer(stdout, found)
            if not store.derived_is_fresh(folder):
                stderr.print(f"{outcome.measured} cells measured; writing tables, plots and report ...")
                write_derived(folder, analysis=found)
    except KeyboardInterrupt:
        stderr.print(f"\nInterrupted. What was measured is in {folder}; the same command goes on from there.")
        return 130
    if answer:
        print_failures(stdout, outcome, folder)
        stdout.print(f"Report: {folder / 'report.html'}", soft_wrap=True)
    else:
        (summary or print_summary)(stdout, outcome, folder)
    return 1 if outcome.failures or outcome.failed_verify_jobs else 0


def _refuse_merged(folder: Path) -> None:
    """A merged folder's cells have other ids: a run would put them all aside."""
    if (folder / store.MANIFEST).exists() and store.read_manifest(folder).merged:
        raise ConfigError(f"{folder}: was merged by `raybench archive`: run into another folder and merge again")


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt


def _warn(plan: Plan, console: Console) -> None:
    for warning in plan.warnings:
        console.print(f"warning: {escape(warning)}", style="yellow", soft_wrap=True)


def print_summary(console: Console, outcome: Outcome, folder: Path) -> None:
    """Prints what failed, the winners for each target, what each setting does, counts, and where the report is."""
    print_failures(console, outcome, folder)
    for name in (store.WINNERS, store.SENTENCES):
        if (file := folder / name).is_file() and (text := file.read_text("utf-8")):
            console.print(text, end="", markup=False, soft_wrap=not console.is_terminal)
    counted = ", ".join(f"{count} {state}" for state, count in sorted(outcome.states.items()))
    console.print(f"{counted}. Report: {folder / 'report.html'}", soft_wrap=True)


def print_failures(console: Console, outcome: Outcome, folder: Path) -> None:
    """Prints what failed, and where more is said of it."""
    for cell, event in outcome.failures:
        words = f"{event.state}: {progress.describe(cell)}: {event.message}"
        console.print(words, style=progress.COLOURS[event.state], markup=False, soft_wrap=True)
    for words in outcome.failed_verify_jobs:
        console.print(words, style=progress.COLOURS["failed"], markup=False, soft_wrap=True)
    if outcome.failures or outcome.failed_verify_jobs:
        console.print(f"What the engines printed is in {folder / 'worker.log'}; --retry measures these again.", soft_wrap=True)


# --- plan -----------------------------------------------------------------------------------------------------------


def plan(given: str, out: Path | None, overrides: Sequence[str], allowed: Allowed) -> None:
    """Prints the configurations of an experiment with their states, and how long what is left may take."""
    stdout, stderr = consoles()
    made, folder = _planned(given, out, overrides, allowed, stderr)
    experiment = made.experiment
    events = store.read_events(folder) if store.events_file(folder) else []
    latest = store.latest_cells(events)
    metric = experiment.quality.name
    states = {cell.cell_id: state_of(cell, latest.get(cell.cell_id), metric) for cell in made.cells}
    _plan_table(stdout, made, states)
    _plan_accelerators(stdout, made)
    left = [cell for cell in made.cells if states[cell.cell_id] in ("queued", "outdated")]
    expected = expected_seconds(left, latest).values()
    seconds, measured = sum(s for s, _ in expected), sum(known for _, known in expected)
    basis = "as measured before" if measured == len(left) else f"estimated; {measured} cells by earlier measurements"
    counted = ", ".join(f"{count} {state}" for state, count in sorted(Counter(states.values()).items()))
    stdout.print(f"{len(made.cells)} cells in {experiment.repeats} blocks: {counted or 'none'}.")
    if left:
        stdout.print(f"{len(left)} to measure: {progress.duration(seconds)} without references ({basis}).")
    if experiment.timing:
        _plan_threads(stdout, made)
    _plan_references(stdout, made)
    if made.verify_jobs:
        left = len(verify_jobs.todo(made.verify_jobs, events, retry=False))
        stdout.print(f"{len(made.verify_jobs)} verify jobs, {left} of them not yet run.")


def _planned(given: str, out: Path | None, overrides: Sequence[str], allowed: Allowed, console: Console) -> tuple[Plan, Path]:
    """The plan of an experiment, its warnings said, and its results folder."""
    experiment = config.load(given, overrides)
    made = planner.make(experiment, *allowed)
    _warn(made, console)
    return made, results_folder(experiment, out)


def _plan_references(console: Console, made: Plan) -> None:
    root = reference_files.cache_folder()
    for needed in made.references.values():
        state = "ready" if references.ready(needed, root) else "to be rendered"
        what = f"{needed.describe()}, {needed.settings.shader}, by {needed.spec['engine']}"
        samples = reference_samples.sufficiency(needed, root, made.experiment.quality).message
        console.print(f"reference of {what}: {state}; {samples}", soft_wrap=True, markup=False)


def _plan_accelerators(console: Console, made: Plan) -> None:
    """One line for each scene and engine: which accelerator `auto` takes there, and why."""
    lines = {
        (cell.scene.name, cell.engine_name, cell.settings.precision): cell.auto_accelerator
        for cell in made.cells
        if cell.auto_accelerator
    }
    for (scene, engine, precision), said in sorted(lines.items()):
        console.print(f"auto in {scene}, {engine} {precision}: {said}", soft_wrap=True, markup=False, highlight=False)


def _plan_threads(console: Console, made: Plan) -> None:
    """Says that cells will be contended where some have as many threads as there are cores here."""
    cores = len(usable_cores())
    most = max((cell.settings.threads for cell in made.cells if not cell.skip), default=0)
    if most >= cores:
        counts = f"{most} thread{'s' if most > 1 else ''} on {cores} core{'s' if cores > 1 else ''}"
        console.print(f"{counts}: no core is left for other work, which will contend with some cells.", soft_wrap=True)


def _plan_table(console: Console, made: Plan, states: Mapping[str, str]) -> None:
    """One row a configuration; what is the same in all rows is said once above."""
    rows: dict[tuple[str, ...], list[Cell]] = {}
    for cell in sorted(made.cells, key=lambda cell: cell.order):
        rows.setdefault(_columns(cell), []).append(cell)
    names = ("scene", "rays", "engine", "accelerator", "shader", "sampler", "precision", "threads", "size", "label", "division")
    varying = [i for i, name in enumerate(names) if len({row[i] for row in rows}) > 1 or name in ("scene", "engine")]
    fixed = [(names[i], next(iter(rows), ("",) * len(names))[i]) for i in range(len(names)) if i not in varying]
    same = ", ".join(f"{name} {value}" for name, value in fixed if value)
    if rows and same:
        console.print(f"The same for all: {escape(same)}", soft_wrap=True)
    columns = [Column(names[i], overflow="fold") for i in varying]
    table = Table(*columns, "seeds", "state", "why", box=None, header_style="bold")
    for row, cells in sorted(rows.items()):
        counted = Counter(states[cell.cell_id] for cell in cells)
        shown = ", ".join(
            f"[{progress.COLOURS[state]}]{state}[/]" + (f" {n}" if len(counted) > 1 else "")
            for state, n in sorted(counted.items())
        )
        table.add_row(*[escape(row[i]) for i in varying], str(len(cells)), shown, escape(cells[0].skip or ""))
    console.print(table)


def _columns(cell: Cell) -> tuple[str, ...]:
    settings = cell.settings
    shader, sampler, size = "", "", ""
    if isinstance(settings, CellSettings):
        shader, sampler, size = str(settings.shader), str(settings.sampler), f"{settings.width}x{settings.height}"
    return (
        cell.scene.name,
        "" if cell.ray_set is None else cell.ray_set.kind,
        cell.engine_name,
        str(settings.accelerator),
        shader,
        sampler,
        settings.precision or "",
        str(settings.threads),
        size,
        cell.label or "",
        cell.division,
    )


# --- references, status ---------------------------------------------------------------------------------------------


def reference(given: str, out: Path | None, overrides: Sequence[str], allowed: Allowed) -> int:
    """Renders the references that an experiment needs, and certifies them; 1 where one failed or is refuted."""
    stdout, stderr = consoles()
    made, folder = _planned(given, out, overrides, allowed, stderr)
    root, most_bytes = reference_files.cache_folder(), made.experiment.limits.memory_bytes
    failed = 0
    try:
        with store.locked(folder), Pool(allowed[0], folder / "worker.log", most_bytes) as pool:
            for needed in made.references.values():
                where = needed.folder(root)
                name = needed.describe()
                try:
                    ready = references.ready(needed, root)
                    if not ready:
                        with progress.Terminal(stderr) as terminal:
                            _make_reference(needed, root, pool, terminal, name)
                    samples = reference_samples.sufficiency(needed, root, made.experiment.quality).message
                    stdout.print(f"{name}: {'ready' if ready else 'made'} in {where}; {samples}", soft_wrap=True)
                    failed += _certified(needed, root, pool, stdout, stderr)
                except WorkerFailed as error:
                    failed += 1
                    stdout.print(f"{name}: failed: {error}", markup=False, soft_wrap=True)
    except KeyboardInterrupt:
        stderr.print("\nInterrupted. What was rendered is kept; the same command goes on from there.")
        return 130
    return 1 if failed else 0


def _make_reference(needed: Any, root: Path, pool: Any, terminal: Any, name: str) -> None:
    references.make(
        needed,
        root,
        pool,
        lambda done, count: terminal.reference(name, done, count),
        lambda: terminal.note(f"reference of {name}: another run makes it: waiting for that one"),
    )


def _certified(needed: Any, root: Path, pool: Any, stdout: Console, stderr: Console) -> bool:
    """Certifies a reference; whether the engine of another lineage makes another image."""
    if needed.certifier is None:
        stdout.print(f"{needed.describe()}: uncertified", markup=False, soft_wrap=True)
        return False
    certificate = certificates.existing(needed, root)
    if certificate is None:
        name = f"{needed.describe()}, certificate"
        with progress.Terminal(stderr) as terminal:
            certificate = certificates.make(needed, root, pool, lambda i, n: terminal.reference(name, i, n))
    stdout.print(f"{needed.describe()}: {certificate_text(certificate)}", markup=False, soft_wrap=True)
    return refutes(certificate)


def status(folder: Path) -> None:
    """Prints states of the planned cells, what runs now, and what failed."""
    console = consoles()[0]
    require_results(folder)
    manifest, events = store.read_manifest(folder), store.read_events(folder)
    latest = store.latest_cells(events)
    planned = {cell_id: latest.get(cell_id) for cell_id in (manifest.cell_ids or latest)}
    counted = Counter("queued" if event is None else event.state for event in planned.values())
    started = store.last_event(events, Start)
    running = store.is_locked(folder)
    if running and started is not None and counted["queued"] and latest.get(started.cell_id) is None:
        counted.update(queued=-1, running=1)
    counts = ", ".join(f"{count} {state}" for state, count in sorted(counted.items()) if count)
    now = "running" if running else "not running"
    console.print(f"{manifest.name or folder.name}: {counts or 'no cells'}; {now}.", soft_wrap=True)
    for event in planned.values():
        if event is not None and event.state in BROKEN:
            words = f"{event.state}: {event.scene} {event.engine} seed {event.seed}: {event.message}"
            console.print(words, style=progress.COLOURS[event.state], markup=False, soft_wrap=True)
