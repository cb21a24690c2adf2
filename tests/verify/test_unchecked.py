"""Engines with few features are checked with what they have; an engine of which nothing was checked is named."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from failing_engines import Flat, Narrow, Own, Unwilling

import engines
from harness.check_results import PASS, SKIP
from harness.config import VerifyConfig
from harness.plan import verify_jobs
from harness.verify import CASES, run_suite
from harness.verify.scenes import UNIT_TRIANGLE
from harness.verify.subject import Skipped, Subject, precisions
from tests import forked

HERE = Path(__file__).resolve().parent


def raybench(*arguments, cwd):
    """The command, to its end."""
    environment = {**os.environ, "PYTHONPATH": f"{HERE.parents[1]}{os.pathsep}{HERE}", "COLUMNS": "200"}
    return forked.raybench([*arguments, "--allow-imports"], cwd, environment, timeout=300)


def results_of(engine, *cases):
    chosen = [case for case in CASES if case.id in cases]
    assert len(chosen) == len(cases)
    return {(found.case, found.parameter): found for found in run_suite([engine], quick=True, cases=chosen)}


@pytest.mark.parametrize("engine", [Narrow(), Own(), Flat()], ids=lambda engine: engine.name)
def test_an_engine_without_sobol_is_checked_in_its_precisions(engine):
    assert precisions(engine) == ["float64"]
    assert {found.outcome for found in results_of(engine, "T1", "S1", "R3").values()} == {PASS}


@pytest.mark.parametrize(("engine", "sampler"), [(Narrow(), "random"), (Own(), "white")], ids=["narrow", "own"])
def test_images_are_rendered_with_a_sampler_that_the_engine_has(engine, sampler):
    seen = []

    class Watched(type(engine)):
        def prepare(self, scene, settings):
            seen.append(settings.sampler)
            return super().prepare(scene, settings)

    (found,) = [found for found in results_of(Watched(), "rr").values()][:1]
    assert found.outcome == PASS and set(seen) == {sampler}


def test_sampler_cases_check_the_samplers_that_the_engine_has():
    found = results_of(Narrow(), "q.mean", "q.slope")
    assert {(case, parameter) for case, parameter in found} == {("q.mean", "random"), ("q.slope", "random")}
    assert {each.outcome for each in found.values()} == {PASS}
    assert {each.outcome for each in results_of(Own(), "q.slope").values()} == {SKIP}


def test_an_engine_that_renders_nothing_says_why():
    with pytest.raises(Skipped, match="today is Sunday"):
        precisions(Unwilling())
    with pytest.raises(Skipped, match="today is Sunday"):
        Subject(Unwilling(), "float64").tracer(UNIT_TRIANGLE)


def test_a_config_plans_the_suite_for_an_engine_without_sobol():
    planned = verify_jobs.planned(
        VerifyConfig(cases=("T1",), quick=True, timeout_seconds=60.0), {"narrow": Narrow(), "no": Unwilling()}
    )
    assert {(each.spec["engine"], each.spec["precision"]) for each in planned} == {("narrow", "float64")}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["failing_engines:Unwilling", "--case", "T1"], "failing_engines:Unwilling: nothing was checked: today is Sunday"),
        (["failing_engines:Misser", "--case", "D3"], "Misser: nothing was checked: all cases are skipped: no glass"),
        (["numpy", "--case", "a.mis"], "numpy: nothing was checked: a quick run leaves out the chosen cases"),
        (["failing_engines:Dead", "--case", "T1"], "'failing_engines:Dead': the engine's process was killed by SIGSEGV"),
    ],
)
def test_nothing_checked_is_one_line_and_exit_code_2(tmp_path, arguments, said):
    if "a.mis" in arguments:
        arguments[2] = next(case.id for case in CASES if case.full_only)
    done = raybench("verify", "--quick", "--engine", *arguments, cwd=tmp_path)
    lines = [line for line in done.stderr.splitlines() if not line.startswith("verify [")]
    assert done.returncode == 2 and len(lines) == 1 and said in lines[0], done.stderr
    assert lines[0].startswith("raybench: ")


def test_one_engine_of_several_that_was_not_checked_is_named_and_the_results_of_the_others_are_written(tmp_path):
    both = ("--engine", "numpy", "--engine", "failing_engines:Unwilling")
    done = raybench("verify", "--quick", *both, "--case", "T6", cwd=tmp_path)
    assert done.returncode == 2 and "failing_engines:Unwilling: nothing was checked" in done.stderr
    found = json.loads((tmp_path / "results/verify/verify.json").read_text())["results"]
    assert {result["engine"] for result in found} == {"numpy"}


def test_a_library_that_crashes_at_the_end_of_its_process_changes_no_result(tmp_path):
    """The command's own process never loads it."""
    same = ("--engine", "numpy", "--against", "failing_engines:LateToCrash", "--replicates", "4", "--spp", "2")
    for command in (
        ("verify", "--quick", "--engine", "failing_engines:LateToCrash", "--case", "T6"),
        ("verify", *same, "--size", "16x16", "--margin", "0.5"),
    ):
        done = raybench(*command, cwd=tmp_path)
        lines = [line for line in done.stderr.splitlines() if not line.startswith("verify [")]
        assert (done.returncode, lines) == (0, []), done.stderr
        assert "pass" in done.stdout or "failing_engines:LateToCrash and numpy" in done.stdout


@pytest.mark.parametrize(
    ("engine", "said"),
    [
        ("failing_engines:CrashingRenders", "failing_engines:CrashingRenders: the engine's process was killed by SIGSEGV"),
        ("failing_engines:Dead", "failing_engines:Dead: the worker was killed by SIGSEGV"),
        ("failing_engines:Own", "failing_engines:Own: it has no sampler random"),
        ("nunba", "unknown engine 'nunba': did you mean 'numba'"),
    ],
)
def test_an_engine_that_makes_no_images_is_one_line_and_no_verdict(tmp_path, engine, said):
    words = ("--replicates", "2", "--spp", "1", "--size", "8x8")
    done = raybench("verify", "--engine", engine, "--against", "numpy", *words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "") and len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith(f"raybench: {said}"), done.stderr


def test_neither_command_loads_an_engine_into_its_own_process(tmp_path):
    script = (
        "import sys; from harness.cli import main\n"
        "try: main()\n"
        "except SystemExit as end:\n"
        "    print(end.code, [m for m in ('numba', 'embreex', 'engines.numpy_reference') if m in sys.modules])"
    )
    words = ["verify", "--engine", "numpy", "--against", "numpy", "--replicates", "2", "--spp", "1", "--size", "8x8"]
    for arguments in (words, ["verify", "--engine", "numpy", "--quick", "--case", "T6"]):
        command = [sys.executable, "-c", script, *arguments]
        environment = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
        assert done.stdout.splitlines()[-1] in ("0 []", "1 []"), done.stdout + done.stderr
    assert engines.engine_names()
