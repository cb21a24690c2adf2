"""After kill -9 at any moment, a second run ends with exactly the rows of an undisturbed one."""

import functools
import json
import random
import signal
import subprocess
import sys
import tempfile
import time

import psutil
import pytest

from harness import store
from harness.measure.pool import Pool
from tests.harness import sweeping
from tests.needs import needs

HANG_SECONDS = 300
LONGEST_SECONDS = 1.5
"""A whole run takes a second or two; a kill that comes later than its end is not counted."""
TEXT = sweeping.EXPERIMENT.replace("images: none", "images: last")


def finished(path, out, said):
    """What a run says that nobody kills."""
    run = sweeping.started(path, out, said)
    assert run.wait(HANG_SECONDS) == 0, said.read_text()
    return said.read_text()


def until(holds):
    """Waits until `holds()` is true."""
    deadline = time.monotonic() + HANG_SECONDS
    while not holds():
        assert time.monotonic() < deadline, "it never came to hold"
        time.sleep(0.05)


def ours(out):
    """Worker processes that log to this results folder."""
    found = []
    for process in psutil.process_iter(["cmdline"]):
        try:
            if "harness.measure.worker:main" in (process.info["cmdline"] or []) and str(out) in str(process.open_files()):
                found.append(process.pid)
        except psutil.Error:
            continue
    return found


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The rows of a run that nobody killed."""
    folder = tmp_path_factory.mktemp("undisturbed")
    path = sweeping.write(folder, TEXT)
    finished(path, folder / "out", folder / "said")
    return sweeping.rows(folder / "out")


@pytest.mark.parametrize(("seed", "kills"), [(2017, 5), pytest.param(2018, 20, marks=pytest.mark.slow)])
def test_killed_at_random_moments_a_run_ends_with_the_rows_of_an_undisturbed_one(tmp_path, undisturbed, seed, kills):
    """A folder is killed until it is complete in spite of it, then the next one: every kill hits a run at work."""
    moments = random.Random(seed)
    path, folders, killed = sweeping.write(tmp_path, TEXT), [tmp_path / "out0"], 0
    while killed < kills:
        run = sweeping.started(path, folders[-1], tmp_path / "said")
        time.sleep(moments.uniform(0.05, LONGEST_SECONDS))
        run.kill()
        run.wait(HANG_SECONDS)
        killed += run.returncode == -signal.SIGKILL
        if run.returncode == 0:
            folders.append(tmp_path / f"out{len(folders)}")
    for out in folders:
        finished(path, out, tmp_path / "said")
        assert sweeping.rows(out) == undisturbed
        assert_nothing_twice(out)


def assert_nothing_twice(out):
    events = store.read_events(out)
    done = [event.cell_id for event in events if event.event == "cell"]
    assert len(done) == len(set(done))
    assert sum(event.event == "reference" for event in events) == 1
    for event in store.latest_cells(events).values():
        kept = sorted((out / "images" / event.cell_id).iterdir())
        assert [str(p.relative_to(out)) for p in kept] == [p.image for p in event.points if p.image]


@needs("linux")
def test_no_worker_outlives_a_killed_run_and_the_next_one_removes_its_temporary_folder(tmp_path, monkeypatch):
    out, temporary = tmp_path / "out", tmp_path / "temporary"
    temporary.mkdir()
    path = sweeping.write(tmp_path, TEXT.replace("fake_engines:Other", "fake_engines:Hanging"))
    run = sweeping.started(path, out, tmp_path / "said", TMPDIR=str(temporary))
    until(lambda: ours(out))
    run.kill()
    run.wait(HANG_SECONDS)
    until(lambda: ours(out) == [])
    (left,) = temporary.iterdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    with Pool(True, tmp_path / "log") as pool:
        assert not left.exists() and pool.scratch.parent.is_dir()
    assert list(temporary.iterdir()) == []


def test_a_torn_last_line_is_reported_and_its_cell_measured_again(tmp_path, undisturbed):
    out, path = tmp_path / "out", sweeping.write(tmp_path, TEXT)
    finished(path, out, tmp_path / "said")
    data = (out / store.EVENTS).read_bytes()
    (out / store.EVENTS).write_bytes(data[:-40])
    said = finished(path, out, tmp_path / "said again")
    assert "1 measured" in said and "cut short" in said
    assert sweeping.rows(out) == undisturbed
    for line in (out / store.EVENTS).read_text().splitlines():
        json.loads(line)


def test_an_interrupt_keeps_what_was_measured_and_ends_at_once(tmp_path):
    out = tmp_path / "out"
    text = TEXT.replace("fake_engines:Other", "fake_engines:Hanging").replace("timeout: 20s", "timeout: 10m")
    path = sweeping.write(tmp_path, text)
    command = [sys.executable, "-m", "harness", "run", str(path), "--out", str(out), "--allow-imports"]
    # a background job of a shell ignores interrupts, and so would its children
    heed = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    run = subprocess.Popen(command, env=sweeping.environment(), stderr=subprocess.PIPE, text=True, preexec_fn=heed)  # noqa: PLW1509
    until(lambda: (out / store.EVENTS).exists() and '"start"' in (out / store.EVENTS).read_text())
    time.sleep(0.3)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=HANG_SECONDS)  # far less than the cell would take
    assert run.returncode == 130
    assert "the same command goes on from there" in " ".join(said.split()) and "Traceback" not in said
    assert ours(out) == [] and not store.is_locked(out)
