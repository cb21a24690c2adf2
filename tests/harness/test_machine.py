"""Provenance: what the machine is, and what disturbed a timing."""

import json
import os
import subprocess
import time

from harness.hashing import digest
from harness.measure import contention, machine


def test_the_environment_is_plain_stable_and_names_the_libraries():
    found = machine.environment()
    assert digest(found) == digest(json.loads(json.dumps(machine.environment())))
    assert {"numpy", "numba", "embreex"} <= set(found["libraries"])
    assert found["cpu"] and 1 <= found["usable_cores"] <= found["logical_cores"]


def test_provenance_adds_the_commit_of_the_sources():
    found = machine.provenance()
    assert set(machine.environment()) < set(found)
    assert found["git"] is None or len(found["git"]["commit"]) == 40


def git(folder, *arguments):
    own = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
    subprocess.run(["git", "-C", str(folder), *arguments], check=True, env=own)


def installed(folder):
    """Raybench's sources, as far as the git state looks at them."""
    for name in machine.SOURCES:
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text("")
    return folder


def committed(folder):
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "-c", "user.name=x", "-c", "user.email=x@y", "commit", "-q", "--allow-empty", "-m", "x")
    return folder


def test_git_state_sees_changes_and_places_that_are_no_checkout(tmp_path):
    assert machine.git_state(installed(tmp_path)) is None
    clean = machine.git_state(committed(tmp_path))
    assert clean is not None and len(clean["commit"]) == 40 and not clean["dirty"]
    (tmp_path / machine.SOURCES[0]).write_text("a")
    changed = machine.git_state(tmp_path)
    assert changed is not None and changed["dirty"]


def test_the_repository_around_an_installed_package_is_not_its_own(tmp_path):
    """Neither where its files are ignored by the other repository nor where they are merely there."""
    (tmp_path / ".gitignore").write_text(".venv\n")
    for place in (".venv/lib/site-packages", "lib/site-packages"):
        (tmp_path / place).mkdir(parents=True)
    committed(tmp_path)
    for place in (".venv/lib/site-packages", "lib/site-packages"):
        assert machine.git_state(installed(tmp_path / place)) is None


def test_the_repository_of_a_hook_that_calls_is_not_looked_at(tmp_path, monkeypatch):
    for name in ("ours", "theirs"):
        committed(installed(tmp_path / name))
    git(tmp_path / "theirs", "-c", "user.name=x", "-c", "user.email=x@y", "commit", "-q", "--allow-empty", "-m", "y")
    ours = machine.git_state(tmp_path / "ours")
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "theirs" / ".git"))
    assert machine.git_state(tmp_path / "ours") == ours


def test_our_own_work_is_not_somebody_else_s():
    before = contention.sample()
    end = time.process_time() + 0.2  # of this process's own time: on a busy machine a wall clock says little
    while time.process_time() < end:
        pass
    after = contention.sample()
    assert 0.1 < after.own - before.own < 0.4
    assert after.busy - before.busy > 0.1
