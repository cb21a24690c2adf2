"""What tests of whole sweeps share: a small experiment with fake engines, run in this process or by the command."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

from harness import config, metrics, store
from harness.plan import planner
from harness.plan.cells import Plan
from harness.run import sweep
from tests import forked

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent

SCENE = """\
raybench_scene: 1
name: one sphere
camera: {type: perspective, eye: [0, 1, 5], target: [0, 1, 0], up: [0, 1, 0], fov: 40, resolution: [16, 12]}
materials: {lamp: {emission: [1, 1, 1]}}
shapes: [{sphere: {center: [0, 1, 0], radius: 1}, material: lamp}]
"""

EXPERIMENT = """\
raybench_experiment: 1
name: small
scene: ball.yaml
resolution: [12, 8]
matrix: {engine: ['fake_engines:Steady', 'fake_engines:Other']}
budget: {max_time: 5s, max_spp: 8, timeout: 20s}
checkpoints: {ratio: 2, start: 1}
repeats: 2
reference: {engine: 'fake_engines:Steady', spp: 64, seed: 9000, certify: null}
quality: {targets: [1.0, 0.1]}
images: none
remeasure: 0
"""


class Quiet:
    """A listener that only remembers."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.cells: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)

    def reference(self, name: str, done: int, count: int) -> None: ...

    def cell(self, cell: Any, number: int, total: int, seconds_left: float) -> None: ...

    def point(self, spp: int, seconds: float, error: float) -> None: ...

    def finished(self, cell: Any, event: Mapping[str, Any]) -> None:
        self.cells.append(cell.cell_id)

    def verify_job(self, name: str, number: int, total: int) -> None: ...


def write(folder: Path, text: str = EXPERIMENT, name: str = "small.yaml") -> Path:
    """An experiment file with its scene beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ball.yaml").write_text(SCENE)
    (folder / name).write_text(text)
    return folder / name


def run(path: Path, out: Path, overrides: Sequence[str] = (), **options: Any) -> tuple[sweep.Outcome, Quiet]:
    """A sweep in this process, without derived files."""
    made = planner.make(config.load(path, overrides), allow_imports=True, allow_outside=options.get("allow_outside", False))
    return run_plan(made, out, **options)


def run_plan(made: Plan, out: Path, **options: Any) -> tuple[sweep.Outcome, Quiet]:
    """The sweep of a plan, by workers that are forked."""
    with forked.workers():
        return _swept(made, out, **options)


def _swept(made: Plan, out: Path, **options: Any) -> tuple[sweep.Outcome, Quiet]:
    listener = Quiet()
    with store.locked(out):
        return sweep.run(made, out, sweep.Options(allow_imports=True, **options), listener), listener


def started(path: Path, out: Path, said: Path, **changes: str) -> forked.Forked:
    """A sweep in a process of its own, by workers as users have them; what was measured and noted is added to the file `said`.
    With one cheap metric: the moments of interest are those of the store, not of SSIM's imports."""
    return forked.Forked(_measure_and_tell, [path, out], None, environment(**changes), stderr=said)


def _measure_and_tell(path: Path, out: Path) -> None:
    with mock.patch.object(metrics, "measure", _one_metric):
        outcome, listener = _swept(planner.make(config.load(path), allow_imports=True), out)
    print(outcome.measured, "measured", *listener.notes, file=sys.stderr)


def _one_metric(image: Any, reference: Any, *_: Any) -> dict[str, float]:
    return {"relmse_e0.01": float(((image - reference.mean) ** 2).mean())}


def rows(folder: Path) -> dict[str, Any]:
    """What a run measured, without what differs between two equal runs: times and order of events."""
    found = {}
    for cell_id, event in store.latest_cells(store.read_events(folder)).items():
        points = [(point.spp, point.rays, point.metrics) for point in event.points]
        found[cell_id] = (event.state, event.engine, event.seed, event.block, event.order, points)
    return found


def environment(**changes: str) -> dict[str, str]:
    """For subprocesses: the fake engines can be imported, whatever the working directory."""
    return {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}", "COLUMNS": "200", **changes}


def raybench(*arguments: str | Path, cwd: Path | None = None, **changes: str) -> subprocess.CompletedProcess[str]:
    """The command, to its end."""
    return forked.raybench([*map(str, arguments)], cwd, environment(**changes), timeout=300)
