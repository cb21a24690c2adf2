"""Renderers by process in a sweep: each mishap is the state of its cell, and the others are measured."""

import subprocess
import sys
import time

import pytest

from engines.errors import ConfigError
from harness import config, store
from harness.measure import clock, contention
from harness.measure.schedule import Schedule
from harness.plan import planner
from harness.run import sweep
from tests.external.describing import described
from tests.harness import sweeping

MODES = ("well", "crash", "garbage", "nan", "hang")


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep over renderers that do well, fail in their ways, and are not there; with its wall seconds."""
    folder = tmp_path_factory.mktemp("swept")
    files = [described(folder, mode).name for mode in MODES]
    words = ["no_such_program", "{scene}{image}{spp}{seed}{threads}"]
    files.append(described(folder, "missing", command=words).name)
    text = sweeping.EXPERIMENT.replace("['fake_engines:Steady', 'fake_engines:Other']", f"{files}")
    text = text.replace("timeout: 20s", "timeout: 8s").replace("repeats: 2", "repeats: 1") + "sampler: random\n"
    path = sweeping.write(folder, text)
    made = planner.make(config.load(path), allow_imports=True, allow_commands=True)
    start = time.monotonic()
    outcome = sweep.run(made, folder / "out", sweep.Options(allow_imports=True, allow_commands=True), sweeping.Quiet())
    return path, folder / "out", outcome, time.monotonic() - start


def test_every_mishap_is_a_state_and_the_sweep_goes_on(swept):
    _, out, outcome, _ = swept
    found = {e.engine: e for e in store.latest_cells(store.read_events(out)).values()}
    states = {name.removeprefix("a_renderer_"): event.state for name, event in found.items()}
    assert states == {
        "well": "done",
        "crash": "failed",
        "garbage": "failed",
        "nan": "failed",
        "hang": "timeout",
        "missing": "skipped",
    }
    assert "no program 'no_such_program'" in found["a_renderer_missing"].message
    assert found["a_renderer_crash"].message == "a_renderer_crash: the program ended with status 3: the tree fell over"
    assert outcome.states == {"done": 1, "failed": 3, "timeout": 1, "skipped": 1}


def test_the_seconds_are_those_of_the_processes_alone(swept):
    _, out, _, wall = swept
    (event,) = [e for e in store.latest_cells(store.read_events(out)).values() if e.state == "done"]
    assert [point.spp for point in event.points] == [1, 2, 4, 8]
    assert 0 < event.points[-1].seconds < wall
    assert event.points[-1].seconds == pytest.approx(event.counters["told_seconds"])
    assert "/" not in event.spec["engine"] and event.engine_version.startswith("1-")
    assert event.command.endswith("--allow-commands")


def test_no_program_outlives_its_timeout(swept):
    import psutil

    running = [p.info["cmdline"] or [] for p in psutil.process_iter(["cmdline"])]
    assert not [words for words in running if "a_renderer.py" in " ".join(words) and str(swept[1].parent) in " ".join(words)]


def test_a_program_is_run_only_where_that_is_allowed(swept):
    path, out, _, _ = swept
    with pytest.raises(ConfigError, match="--allow-commands"):
        planner.make(config.load(path), allow_imports=True)
    for refused in ("run", "plan"):
        done = sweeping.raybench(refused, path, "--out", out, "--allow-imports")
        assert done.returncode == 2 and "--allow-commands" in done.stderr and "Traceback" not in done.stderr
    rendered = sweeping.raybench("render", "cornell_box", "--engine", path.parent / "well.yaml", cwd=path.parent)
    assert rendered.returncode == 2 and "--allow-commands" in rendered.stderr


def test_a_renderer_by_process_makes_no_reference(tmp_path):
    file = described(tmp_path).name
    text = sweeping.EXPERIMENT.replace("reference: {engine: 'fake_engines:Steady'", f"reference: {{engine: {file}")
    with pytest.raises(ConfigError, match=r"reference.engine = 'well.yaml': .*makes no reference"):
        config.load(sweeping.write(tmp_path, text))


def test_what_a_renderer_tells_replaces_what_was_waited_for():
    class Told:
        """Claims a second a sample."""

        def __init__(self):
            self.seconds = 0.0

        def render(self, spp):
            self.seconds += spp

        def counters(self):
            return {"told_seconds": self.seconds}

    schedule = Schedule(2.0, 1, 8, 100.0)
    points = list(clock.timed_points(Told(), schedule, clock.one_sample(Told()), clock.Disturbance()))  # pyright: ignore
    assert [point.seconds for point in points] == [1.0, 2.0, 4.0, 8.0]


def test_a_programs_work_counts_as_the_cells_own():
    """Else every cell of a renderer by process would seem to be disturbed by others."""
    before = contention.sample().own
    subprocess.run([sys.executable, "-c", "while __import__('time').process_time() < 0.3: pass"], check=True)
    assert contention.sample().own - before > 0.25
