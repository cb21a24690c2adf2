"""The results of the suite, and what the command writes and returns."""

import csv
import json

import numpy as np
import pytest
from failing_engines import Matt, Misser
from typer.testing import CliRunner

import engines
from engines.errors import ConfigError
from harness.check_results import FAIL, PASS, SKIP, XFAIL
from harness.cli import app
from harness.verify import CASES, read_results, run_suite
from harness.verify.case import Section, measurement
from harness.verify.results_file import document
from harness.verify.subject import Subject
from harness.verify.suite import run_case
from harness.verify.tolerances import Tolerance

FAST = [case for case in CASES if case.id in ("S1", "S4", "T1", "T6", "T14", "R1", "R3", "D3", "sky")]


def test_every_case_has_an_id_and_a_tolerance():
    assert len({case.id for case in CASES}) == len(CASES) >= 50
    assert {case.tolerance.unit for case in CASES} <= {"relative", "eps", "eps/cos", "wrong", "absolute", "z"}
    assert all(case.description.endswith(".") and case.source for case in CASES)


def test_the_reference_passes():
    found = list(run_suite([engines.engine("numpy")], quick=True, cases=FAST))
    assert {result.outcome for result in found} == {PASS}
    (t,) = [f for f in found if (f.case, f.parameter, f.accelerator) == ("T1", "t", "none")]
    assert 0 <= t.median_ulp <= t.p999_ulp <= t.worst_ulp < 16 and t.unit == "eps"


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_numba_passes_the_fast_cases(precision):
    subject = Subject(engines.engine("numba"), precision, "bvh")
    traced = [case for case in FAST if case.id not in ("T6", "D3")]  # the others compile kernels that no test shares
    found = [result for case in traced for result in run_case(case, subject)]
    assert {result.outcome for result in found} <= {PASS, XFAIL}


def test_an_engine_that_misses_fails_and_one_that_refuses_is_skipped():
    found = {f.case: f for f in run_suite([Misser()], quick=True, cases=[c for c in FAST if c.id in ("S1", "R1", "D3")])}
    assert found["S1"].outcome == FAIL and found["S1"].error == np.inf
    assert found["D3"].outcome == SKIP and found["D3"].note == "no glass"
    assert found["R1"].outcome == FAIL and "AttributeError" in found["R1"].note  # it has no `occluded`


def test_an_engine_that_lacks_models_is_checked_in_those_that_it_has():
    found = {f.case: f for f in run_suite([Matt()], quick=True, cases=[c for c in CASES if c.id in ("mod", "mod.tilt")])}
    assert (found["mod"].parameter, found["mod"].outcome) == ("diffuse", PASS)
    assert found["mod.tilt"].outcome == SKIP and found["mod.tilt"].note == "it is matt"


def test_a_failure_without_a_tolerance_is_an_expected_failure():
    section = Section("made up")

    @section.case("made up", "A cube.", Tolerance("wrong", 0, {"scale 1e+00": 0}))
    def cube(subject):
        yield measurement([1.0], "scale 1e-20")
        yield measurement([1.0], "scale 1e+00")

    engine = engines.engine("numba")
    verdicts = [f.outcome for f in run_case(section.cases[0], Subject(engine, "float32"))]
    assert verdicts == [XFAIL, FAIL]
    assert [f.outcome for f in run_case(section.cases[0], Subject(engine, "float64"))] == [FAIL, FAIL]


def test_the_command_writes_four_files_and_returns_0(tmp_path):
    arguments = ["verify", "--engine", "numpy", "--quick", "--case", "T1", "--case", "D3", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "pass" in done.output and "T1" in done.output
    document = json.loads((tmp_path / "verify.json").read_text())
    assert (document["raybench_verify"], document["outcomes"]) == (2, {"pass": len(document["results"])})
    with open(tmp_path / "verify.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["case"] for row in rows} == {"T1", "D3"} and all(float(row["error"]) >= 0 for row in rows)
    assert "\\toprule" in (tmp_path / "verify.tex").read_text()
    page = (tmp_path / "verify.html").read_text()
    assert "<h2>Failures</h2>" in page and "http" not in page.replace("http-equiv", "")


def test_the_results_file_is_read_back(tmp_path):
    cases = [case for case in CASES if case.id in ("S1", "R4", "D3")]
    results = [*run_suite([Misser()], quick=True, cases=cases), *run_suite([engines.engine("numpy")], quick=True, cases=cases)]
    assert {result.outcome for result in results} == {PASS, FAIL, SKIP}  # with errors of inf and tolerances of NaN
    path = tmp_path / "verify.json"
    path.write_text(json.dumps(document(results, quick=True), allow_nan=False))
    assert repr(read_results(path)) == repr(results)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(raybench_verify=1), "format 1, this raybench reads 2: run raybench verify again"),
        (lambda d: d.pop("raybench_verify"), "the key 'raybench_verify' is missing"),
        (lambda d: d["results"][0].update(error="kept"), "results.0.error = 'kept'"),
        (lambda d: d["results"][0].pop("case"), "results.0.case"),
        (lambda d: d.update(results=3), "results = 3"),
    ],
)
def test_a_results_file_of_another_format_is_refused_in_one_line(tmp_path, change, message):
    case = next(case for case in CASES if case.id == "R4")
    data = document(list(run_suite([engines.engine("numpy")], quick=True, cases=[case])), quick=True)
    change(data)
    path = tmp_path / "verify.json"
    path.write_text(json.dumps(data))
    with pytest.raises(ConfigError) as refused:
        read_results(path)
    assert str(refused.value).startswith(f"{path}: ") and message in str(refused.value) and "\n" not in str(refused.value)
