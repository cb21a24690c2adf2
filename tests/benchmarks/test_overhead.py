"""What a whole measured cell adds to the time of its passes: worker process, pipes, metrics and events included."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness import config, plan, store, sweep

HERE = Path(__file__).resolve().parent
PASSES, ROUNDS = 40, 4
SCENE = """\
raybench_scene: 1
name: ball
camera: {type: perspective, eye: [0, 1, 5], target: [0, 1, 0], up: [0, 1, 0], fov: 40, resolution: [16, 12]}
materials: {lamp: {emission: [1, 1, 1]}}
shapes: [{sphere: {center: [0, 1, 0], radius: 1}, material: lamp}]
"""
EXPERIMENT = f"""\
raybench_experiment: 1
scene: ball.yaml
engine: 'busy_engine:Busy'
budget: {{max_time: 1m, max_spp: {PASSES}, timeout: 2m}}
checkpoints: {{ratio: 1.01, start: 1}}
repeats: 1
reference: {{engine: 'busy_engine:Busy', spp: 2, seed: 9000}}
images: none
"""


class Silent:
    """A listener that says nothing."""

    def __getattr__(self, name):
        return lambda *_: None


@pytest.fixture
def measured(tmp_path, monkeypatch):
    """A function that measures one cell of `PASSES` passes of one sample, and one that does them without a harness."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parent.parent)])}
    monkeypatch.setenv("PYTHONPATH", environment["PYTHONPATH"])
    monkeypatch.syspath_prepend(str(HERE))
    (tmp_path / "ball.yaml").write_text(SCENE)
    (tmp_path / "busy.yaml").write_text(EXPERIMENT)
    made = plan.make(config.load(str(tmp_path / "busy.yaml")), allow_imports=True)
    folders = (tmp_path / str(number) for number in range(100))

    def cell():
        folder = next(folders)
        with store.locked(folder):
            sweep.run(made, folder, sweep.Options(allow_imports=True), Silent())  # type: ignore[arg-type]
        (found,) = store.latest_cells(store.read_events(folder)).values()
        return found

    def bare():
        command = [sys.executable, str(HERE / "busy_engine.py"), str(PASSES)]
        return json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)

    return cell, bare


def test_cell_against_bare_loop(benchmark, measured):
    """Rounds in turn. On the clock is the call alone: against the engine's own clock, and against the bare loop's."""
    cell, bare = measured
    cells, bares = [], []

    def one_round():
        cells.append(cell())
        bares.append(bare())

    benchmark.pedantic(one_round, rounds=ROUNDS)
    passes = [np.diff([0.0, *(point["seconds"] for point in found["points"])]) for found in cells]
    assert [len(found) for found in passes] == [PASSES] * ROUNDS
    inside = sum(found["points"][-1]["seconds"] for found in cells) / sum(
        f["counters"]["inside_seconds"] for f in cells
    )
    least = min(map(min, passes)) / min(map(min, bares))
    typical = float(np.median(np.concatenate(passes)) / np.median(np.concatenate(bares)))
    benchmark.extra_info.update(over_own_clock=inside - 1, over_bare_least=least - 1, over_bare_median=typical - 1)
    print(f"\non the clock beyond the engine's own {100 * (inside - 1):.3f} %, beyond a bare loop {100 * (least - 1):+.2f} % "
          f"(least), {100 * (typical - 1):+.2f} % (median)")  # fmt: skip
    assert inside < 1.01
    assert least < 1.01
