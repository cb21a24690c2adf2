"""References that many processes want at once: none dies, each reference is made once and whole."""

import subprocess
import sys
import threading

import pytest

from harness.run import references
from harness.store import locks, reference_files
from tests.harness import shared_references, sweeping
from tests.harness.shared_references import Images, wanted

PROCESSES, ROUNDS = 8, 5


def started(folder, number):
    command = [sys.executable, shared_references.__file__, str(folder), str(number), str(ROUNDS)]
    return subprocess.Popen(command, env=sweeping.environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_of_many_processes_none_dies_and_every_reference_is_usable(tmp_path):
    processes = [started(tmp_path, number) for number in range(PROCESSES)]
    try:
        for number, process in enumerate(processes):
            while not (tmp_path / f"ready-{number}").exists():
                assert process.poll() is None, process.communicate()[1]
        (tmp_path / "go").touch()
        ended = [process.communicate(timeout=120) for process in processes]
    finally:
        for process in processes:
            process.kill()
    assert [process.returncode for process in processes] == [0] * PROCESSES, [said[1][-500:] for said in ended]
    for number in range(ROUNDS):
        for count in (shared_references.REPLICATES, shared_references.REPLICATES - 2):
            asked = wanted(number, count)
            folder = asked.folder(tmp_path / "kept")
            assert reference_files.read(folder, asked.reference_id, asked.scene_hash).spp == asked.spp
            names = sorted(path.name for path in folder.iterdir())
            assert names == [f"film-{count:04d}.npz", "reference.exr", "reference.json"], "nothing else is left"


def test_who_comes_second_waits_is_told_so_and_renders_nothing(tmp_path):
    asked, told = wanted(0), []
    first, second = Counting(), Counting()

    def waits():
        told.append("waits")
        release.set()

    release, began = threading.Event(), threading.Event()

    def slow(done, count):
        began.set()
        assert release.wait(60)

    making = threading.Thread(target=references.make, args=(asked, tmp_path, first, slow))
    making.start()
    assert began.wait(60)
    meta = references.make(asked, tmp_path, second, lambda done, count: None, waits)
    making.join()
    assert (told, first.rendered, second.rendered) == (["waits"], shared_references.REPLICATES, 0)
    assert meta.complete


class Counting(Images):
    """Counts what it renders."""

    rendered = 0

    def replicates(self, engine, request, seeds):
        for found in super().replicates(engine, request, seeds):
            self.rendered += 1
            yield found


def test_the_lock_of_a_killed_process_is_free(tmp_path):
    script = f"""
import os, signal
from pathlib import Path
from harness.store import locks
with locks.exclusive(Path({str(tmp_path / "a.lock")!r})):
    os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", script], env=sweeping.environment(), check=False)
    waited = []
    with locks.exclusive(tmp_path / "a.lock", lambda: waited.append(1)):
        pass
    assert waited == []


def test_a_relative_that_vanishes_while_it_is_read_is_no_error(tmp_path):
    small, large = wanted(0, 4), wanted(0, 6)
    references.make(small, tmp_path, Images(), lambda done, count: None)
    (small.folder(tmp_path) / "film-0004.npz").unlink()
    counting = Counting()
    assert references.make(large, tmp_path, counting, lambda done, count: None).complete
    assert counting.rendered == 6


def test_a_file_that_cannot_be_written_leaves_the_old_one_and_no_rest(tmp_path):
    from engines.errors import ConfigError
    from harness.store import atomic

    atomic.write_text(tmp_path / "a", "old")
    with pytest.raises(ConfigError, match="a: cannot be written: No space left"), atomic.replacing(tmp_path / "a") as file:
        file.write(b"new")
        raise OSError(28, "No space left on device")
    assert (tmp_path / "a").read_text() == "old" and [path.name for path in tmp_path.iterdir()] == ["a"]
