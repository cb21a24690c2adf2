"""What the battery says of an engine, and what the command writes and answers."""

import csv
import json

import numpy as np
import pytest
from frail_engines import Misser
from typer.testing import CliRunner

import engines
from harness.cli import app
from harness.verify import CASES, findings
from harness.verify.battery import BROKEN, DECLINED, KEPT, NOT_PROMISED, examine
from harness.verify.case import Section, measured
from harness.verify.promises import PROMISES
from harness.verify.subject import Subject

FAST = [case for case in CASES if case.id in ("S1", "S4", "T1", "T6", "T14", "R1", "R3", "D3")]


def test_cases_have_names_of_their_own_and_promises():
    assert len({case.id for case in CASES}) == len(CASES) >= 50
    assert {case.id for case in CASES} == set(PROMISES)
    assert all(case.asked.endswith(".") and case.source for case in CASES)


def test_the_reference_keeps_what_it_promises():
    found = list(findings([engines.engine("numpy")], quick=True, cases=FAST))
    assert {finding.verdict for finding in found} == {KEPT}
    (t,) = [f for f in found if (f.case, f.parameter, f.accelerator) == ("T1", "t", "none")]
    assert 0 <= t.median <= t.tail <= t.worst < 16 and t.unit == "eps"


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_numba_keeps_the_fast_cases(precision):
    subject = Subject(engines.engine("numba"), precision, "bvh")
    traced = [case for case in FAST if case.id not in ("T6", "D3")]  # the others compile kernels that no test shares
    found = [finding for case in traced for finding in examine(case, subject)]
    assert {finding.verdict for finding in found} <= {KEPT, NOT_PROMISED}


def test_an_engine_that_misses_breaks_its_promises_and_may_decline():
    found = {f.case: f for f in findings([Misser()], quick=True, cases=[c for c in FAST if c.id in ("S1", "R1", "D3")])}
    assert found["S1"].verdict == BROKEN and found["S1"].error == np.inf
    assert found["D3"].verdict == DECLINED and found["D3"].note == "no glass"
    assert found["R1"].verdict == BROKEN and "AttributeError" in found["R1"].note  # it has no `occluded`


def test_what_is_not_promised_is_shown_and_not_broken():
    section = Section("made up")

    @section.case("T15", "A cube.", "here")
    def cube(subject):
        yield measured([1.0], "scale 1e-20")
        yield measured([1.0], "scale 1e+00")

    engine = engines.engine("numba")
    verdicts = [f.verdict for f in examine(section.cases[0], Subject(engine, "float32"))]
    assert verdicts == [NOT_PROMISED, BROKEN]
    assert [f.verdict for f in examine(section.cases[0], Subject(engine, "float64"))] == [BROKEN, BROKEN]


def test_the_command_writes_four_files_and_answers_by_its_exit_code(tmp_path):
    arguments = ["verify", "--engine", "numpy", "--quick", "--case", "T1", "--case", "D3", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "kept" in done.output and "T1" in done.output
    document = json.loads((tmp_path / "verify.json").read_text())
    assert document["verdicts"] == {"kept": len(document["findings"])}
    with open(tmp_path / "verify.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["case"] for row in rows} == {"T1", "D3"} and all(float(row["error"]) >= 0 for row in rows)
    assert "\\toprule" in (tmp_path / "verify.tex").read_text()
    page = (tmp_path / "verify.html").read_text()
    assert "Broken promises" in page and "http" not in page.replace("http-equiv", "")
