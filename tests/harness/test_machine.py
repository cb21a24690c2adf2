"""Provenance: what the machine is, and what disturbed a timing."""

import json
import subprocess
import time

from harness import machine
from harness.identity import digest


def test_the_environment_is_plain_stable_and_names_the_libraries():
    found = machine.environment()
    assert digest(found) == digest(json.loads(json.dumps(machine.environment())))
    assert {"numpy", "numba", "embreex"} <= set(found["libraries"])
    assert found["cpu"] and 1 <= found["usable_cores"] <= found["logical_cores"]


def test_provenance_adds_the_commit_of_the_sources():
    found = machine.provenance()
    assert set(machine.environment()) < set(found)
    assert found["git"] is None or len(found["git"]["commit"]) == 40


def test_git_state_sees_changes_and_places_that_are_no_checkout(tmp_path):
    assert machine.git_state(tmp_path) is None
    commit = ["-c", "user.name=x", "-c", "user.email=x@y", "commit", "-q", "--allow-empty", "-m", "x"]
    for arguments in (["init", "-q"], commit):
        subprocess.run(["git", "-C", str(tmp_path), *arguments], check=True)
    clean = machine.git_state(tmp_path)
    assert clean is not None and not clean["dirty"]
    (tmp_path / "a").write_text("a")
    subprocess.run(["git", "-C", str(tmp_path), "add", "a"], check=True)
    changed = machine.git_state(tmp_path)
    assert changed is not None and changed["dirty"]


def test_work_of_others_is_told_from_our_own(monkeypatch):
    def report(others, steal, wall):
        before = machine.Sample(10.0, 1.0, 3.0, 4)
        samples = iter([before, before, machine.Sample(10.0 + wall + others, 1.0 + steal, 3.0 + wall, 6)])
        monkeypatch.setattr(machine, "sample", lambda: next(samples))
        disturbance = machine.Disturbance()
        disturbance.start()
        disturbance.stop(wall)
        return disturbance.report()

    quiet, beside, stolen = report(0.1, 0.0, 10.0), report(5.0, 0.0, 10.0), report(0.0, 1.0, 10.0)
    assert not quiet["contended"] and quiet["involuntary_switches"] == 2
    assert beside["contended"] and beside["other_cpu_seconds"] == 5.0
    assert stolen["contended"] and stolen["steal_seconds"] == 1.0


def test_our_own_work_is_not_somebody_else_s():
    before = machine.sample()
    end = time.process_time() + 0.2  # of this process's own time: on a busy machine a wall clock says little
    while time.process_time() < end:
        pass
    after = machine.sample()
    assert 0.1 < after.own - before.own < 0.4
    assert after.busy - before.busy > 0.1
