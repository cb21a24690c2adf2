"""`make fuzz` in small: damaged files end in a reading or in one line, and the fuzzer sees what does not."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from random import Random

import pytest

from tests.fuzz import mutate
from tests.fuzz.runner import KINDS, run
from tests.fuzz.worker import ROOT, run_case

CASES = 40


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path, kind):
    tally = run(kind, 0, 0, CASES, tmp_path, limit=60.0)
    assert tally.failures == []
    assert tally.accepted > 0 and tally.refused > 0 and tally.accepted + tally.refused == tally.cases == CASES
    assert list(tmp_path.iterdir()) == [], "inputs of cases that ended well are kept"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_damaged_was_whole(tmp_path, kind, monkeypatch):
    """Without the damage every kind of file is read: refusals are due to the damage."""
    module = import_module(f"tests.fuzz.{kind}")
    for name in ("mutated_bytes", "mutated_text", "mutated_tree", "scaled_tree"):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, lambda random, content: content)
    count = 4 if kind == "events" else 20
    outcomes = [run_case(module, 0, case, tmp_path / str(case)) for case in range(count)]
    assert {outcome.outcome for outcome in outcomes} <= {"accepted", "refused"}
    whole = sum(outcome.outcome == "accepted" for outcome in outcomes)
    assert whole >= (count if kind in ("scenes", "events") else count / 2), outcomes


@pytest.mark.parametrize("kind", KINDS)
def test_a_case_is_the_same_when_it_is_repeated(tmp_path, kind):
    module = import_module(f"tests.fuzz.{kind}")
    found = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        module.write(Random("7"), tmp_path / folder)
        found.append({path.name: path.read_bytes() for path in (tmp_path / folder).iterdir()})
    assert found[0] == found[1] != {}


def test_cases_that_raise_hang_die_take_memory_or_say_too_little_are_failures(tmp_path):
    tally = run("tests.fuzz.planted", 0, 0, 9, tmp_path, limit=10.0)
    assert (tally.cases, tally.accepted, tally.refused) == (9, 3, 1)
    found = {failure.case: failure.what for failure in tally.failures}
    assert found.keys() == {2, 3, 4, 5, 6}
    assert found[2].startswith("tests/fuzz/planted.py:") and found[2].endswith("KeyError: 'spp'")
    assert "names none of a.txt" in found[3]
    assert re.fullmatch(r"took \d{3} MiB", found[4])
    assert found[5] == "no answer within 10 s" and "SIGSEGV" in found[6]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["2", "3", "4", "5", "6"]
    assert (tmp_path / "5" / "a.txt").read_text() == "hang"


def test_the_command_prints_a_table_and_repeats_a_case(tmp_path):
    def fuzz(*words):
        command = [sys.executable, "-m", "tests.fuzz", "meshes", "--out", str(tmp_path), *words]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)

    done = fuzz("--cases", "5", "--jobs", "1")
    heading, row = done.stdout.splitlines()[-3:-1]
    assert heading.split()[:5] == ["kind", "cases", "accepted", "refused", "failures"]
    assert row.split()[:2] == ["meshes", "5"] and row.split()[4] == "0" and done.returncode == 0
    again = fuzz("--case", "3")
    assert again.returncode == 0 and f"input: {tmp_path}/meshes-1/3" in again.stdout
    assert (tmp_path / "meshes-1" / "3" / "s.yaml").exists()


def test_damage_to_a_tree_leaves_the_tree_it_was_made_from(tmp_path):
    tree = {"a": [1.0, {"b": 2.5}], "c": "text"}
    made = [way(Random(seed), tree) for way in (mutate.mutated_tree, mutate.scaled_tree) for seed in range(50)]
    assert tree == {"a": [1.0, {"b": 2.5}], "c": "text"} and sum(each != tree for each in made) > 80
