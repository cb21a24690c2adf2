"""The limit of memory: how it is written, what it is without one, and that a cell that passes it ends alone."""

import os
import re
import subprocess
import sys
import time

import psutil
import pytest

from engines import memory as allocation
from engines.errors import ConfigError
from harness import config, store
from harness.measure import memory
from tests.harness import sweeping

LIMIT = "512 MiB"
MIB = 1 << 20


def with_engines(*names):
    return sweeping.EXPERIMENT.replace("['fake_engines:Steady', 'fake_engines:Other']", f"{list(names)}")


def limited(folder, *engines, overrides=()):
    """A run of one block under the limit; its outcome, listener and the events of its cells by engine."""
    path = sweeping.write(folder, with_engines(*engines) + f"limits: {{memory: {LIMIT}}}\n")
    outcome, listener = sweeping.run(path, folder / "out", ["repeats=1", "budget.timeout=2m", *overrides])
    events = store.latest_cells(store.read_events(folder / "out")).values()
    return outcome, listener, {event.engine: event for event in events}


def test_a_cell_that_takes_too_much_memory_fails_and_the_others_are_measured(tmp_path):
    outcome, _, events = limited(tmp_path, "wrong_engines:Hungry", "fake_engines:Steady")
    assert outcome.states == {"done": 1, "failed": 1}
    assert re.fullmatch(r"memory: [0-9.]+ [MG]iB of 512 MiB", events["hungry"].message)


def test_a_process_that_an_engine_starts_counts_and_ends_with_the_cell(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_TEST_CHILD", str(tmp_path / "child"))
    outcome, _, events = limited(tmp_path, "wrong_engines:HungryChild", "fake_engines:Steady")
    assert outcome.states == {"done": 1, "failed": 1} and events["hungry_child"].message.startswith("memory: ")
    child, patience = int((tmp_path / "child").read_text()), time.monotonic() + 60
    while _runs(child):
        assert time.monotonic() < patience, "the engine's process outlived its cell"
        time.sleep(0.05)


def _runs(pid):
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_a_reference_is_rendered_under_the_same_limit(tmp_path):
    outcome, listener, _ = limited(tmp_path, "fake_engines:Steady", overrides=["reference.engine=wrong_engines:Hungry"])
    assert outcome.states == {"failed": 1}
    assert re.search(r"no reference: memory: [0-9.]+ [MG]iB of 512 MiB", listener.notes[0])


@pytest.mark.parametrize(
    ("written", "wanted"),
    [("8 GiB", 8 << 30), ("512MiB", 512 << 20), ("1.5 GB", 1_500_000_000), (".5 TiB", 1 << 39), ("4096 B", 4096)],
)
def test_sizes_carry_their_unit(tmp_path, written, wanted):
    experiment = config.load(sweeping.write(tmp_path), [f"limits.memory={written}"])
    assert experiment.limits.memory_bytes == wanted
    assert config.recorded(experiment.normalised(), "").limits == experiment.limits


@pytest.mark.parametrize(
    "written", ["8", "8 gib", "GiB", "-1 GiB", "0 GiB", "inf", "9e9 GiB", "true", "[8 GiB]", "null", "2000000 TiB"]
)
def test_what_is_no_size_is_refused_with_what_is_wanted(tmp_path, written):
    with pytest.raises(ConfigError, match=r"limits\.memory.*must be a size"):
        config.load(sweeping.write(tmp_path), [f"limits.memory={written}"])


def test_other_keys_of_limits_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"limits.*memry.*memory"):
        config.load(sweeping.write(tmp_path), ["limits.memry=8 GiB"])


def test_without_a_limit_a_cell_has_three_quarters_of_the_machine(tmp_path):
    assert config.load(sweeping.write(tmp_path)).limits.memory_bytes is None
    assert 0 < memory.default_limit() <= 0.75 * psutil.virtual_memory().total
    assert memory.default_limit(0.5) == pytest.approx(memory.default_limit() / 2, abs=1)


@pytest.mark.parametrize(
    ("lines", "files", "found"),
    [
        ("0::/a/b\n", {"a/b/memory.max": "max", "a/memory.max": "4096", "memory.max": "9000"}, [4096, 9000]),
        ("4:memory:/job\n3:cpuset:/\n", {"memory/job/memory.limit_in_bytes": "5000"}, [5000]),
        ("4:memory:/elsewhere\n", {"memory/memory.limit_in_bytes": "7000"}, [7000]),
        ("0::/\n", {}, []),
    ],
)
def test_a_control_groups_limit_is_read_with_those_above_it(tmp_path, lines, files, found):
    (tmp_path / "own").write_text(lines)
    for name, text in files.items():
        (tmp_path / "root" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "root" / name).write_text(text)
    assert allocation._control_group_limits(tmp_path / "root", tmp_path / "own") == found


def test_all_processes_below_one_are_found():
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'print(1, flush=True); input()'])"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"1\n"
        below = memory.descendants(process.pid)
        assert len(below) == 1 and set(below) < set(memory.descendants(os.getpid()))
        watch = memory.Watch(process.pid)
        assert watch.resident(False) > watch.resident(True) > MIB
        watch.kill()
    assert memory.descendants(process.pid) == []


def test_sizes_are_said_in_the_unit_that_suits():
    assert [memory.words(size) for size in (9.1 * 2**30, 512 << 20, 1000 << 20, 12)] == [
        "9.1 GiB",
        "512 MiB",
        "1000 MiB",
        "12 B",
    ]
