"""Temporary folders: removed when they are left, and after their owner was killed by whoever comes next; never before."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from engines.temporary import OWNER, TemporaryFolder, remove_abandoned

ROOT = Path(__file__).resolve().parent.parent
OWN = """
import os, sys
from engines.temporary import TemporaryFolder
folder = TemporaryFolder()
open(os.path.join(folder.name, "film"), "w").write("of a run")
if "fork" in sys.argv and os.fork():
    os._exit(0)
print(folder.name, os.getpid(), flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def owner(folder, *words):
    """A process that has a temporary folder until its input ends, that folder, and the id of its last owner."""
    process = subprocess.Popen(
        [sys.executable, "-c", OWN, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(folder), "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    name, pid = process.stdout.readline().split()
    return process, Path(name), int(pid)


def test_a_folder_is_removed_when_it_is_left():
    with TemporaryFolder() as name:
        (Path(name) / "film").write_text("of a run")
    assert not Path(name).exists()


def test_the_folder_of_a_killed_owner_is_removed_and_that_of_a_living_one_kept(here):
    (killed, left, _), (living, kept, _) = owner(here), owner(here)
    with killed, living:
        remove_abandoned()
        assert (left / "film").is_file() and (kept / "film").is_file()
        killed.kill()
        killed.wait()
        assert (left / "film").is_file()
        remove_abandoned()
        assert not left.exists() and (kept / "film").is_file()
        living.communicate("")
    assert not kept.exists()


def test_a_forked_child_keeps_the_folder_of_its_parent(here):
    process, folder, child = owner(here, "fork")
    with process:
        process.wait()
        remove_abandoned()
        assert (folder / "film").is_file()
        os.kill(child, signal.SIGKILL)


def test_folders_of_others_and_of_unknown_make_are_never_touched(here):
    (here / "raybench-notes").mkdir()
    (here / "raybench-file").write_text("mine")
    (here / "another").mkdir()
    (here / "another" / OWNER).write_text("")
    (here / "raybench-link").symlink_to(here / "another")
    (here / "raybench-fifo").mkdir()
    (here / "raybench-fifo" / OWNER).symlink_to(here / "raybench-file")
    with TemporaryFolder() as own:
        before = sorted(here.rglob("*"))
        remove_abandoned()
        assert sorted(here.rglob("*")) == before and Path(own).is_dir()
