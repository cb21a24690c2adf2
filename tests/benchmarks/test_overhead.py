"""What a whole measured cell adds to the time of its passes: worker process, pipes, metrics and events included."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness import config, store
from harness.plan import planner
from harness.run import sweep

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
    made = planner.make(config.load(str(tmp_path / "busy.yaml")), allow_imports=True)
    folders = (tmp_path / str(number) for number in range(100))

    def cell():
        folder = next(folders)
        with store.locked(folder):
            sweep.run(made, folder, sweep.Options(allow_imports=True), Silent())  # type: ignore[arg-type]
        (found,) = store.latest_cells(store.read_events(folder)).values()
        return found

    def bare():
        command = [sys.executable, str(HERE / "busy_engine.py"), str(PASSES)]
        return float(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)

    return cell, bare


def test_cell_against_bare_loop(benchmark, measured):
    """On the clock is the call alone: against the engine's own clock. And a pass does not work longer because metrics,
    pipes and events come between it and the next: against the same passes in a loop, rounds in turn, in processor time,
    which other programs hardly touch."""
    cell, bare = measured
    cells, bares = [], []

    def one_round():
        cells.append(cell())
        bares.append(bare())

    benchmark.pedantic(one_round, rounds=ROUNDS)
    assert [len(found.points) for found in cells] == [PASSES] * ROUNDS
    on_the_clock = sum(found.points[-1].seconds for found in cells)
    over_own = on_the_clock / sum(found.counters["inside_seconds"] for found in cells) - 1
    over_bare = min(found.counters["least_cpu_seconds"] for found in cells) / min(bares) - 1
    benchmark.extra_info.update(over_own_clock=over_own, over_bare_loop=over_bare)
    print(f"\non the clock beyond the engine's own {100 * over_own:.3f} %, a pass beyond a bare loop {100 * over_bare:+.2f} %")
    assert 0 <= over_own < 0.01
    assert over_bare < 0.01
