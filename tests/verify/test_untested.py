"""Nothing is passed over in silence: every engine is asked by what it has, and one of which nothing was examined is named."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from frail_engines import Flat, Narrow, Own, Unwilling

import engines
from harness import examinations
from harness.config import VerifyAsked
from harness.verify import CASES, findings
from harness.verify.battery import DECLINED, KEPT
from harness.verify.stage import UNIT
from harness.verify.subject import Declined, Subject, precisions

HERE = Path(__file__).resolve().parent


def raybench(*arguments, cwd):
    """The command, to its end."""
    environment = {**os.environ, "PYTHONPATH": f"{HERE.parents[1]}{os.pathsep}{HERE}", "COLUMNS": "200"}
    words = [sys.executable, "-m", "harness", *arguments, "--allow-imports"]
    return subprocess.run(words, capture_output=True, text=True, cwd=cwd, env=environment, check=False, timeout=300)


def asked(engine, *cases):
    chosen = [case for case in CASES if case.id in cases]
    assert len(chosen) == len(cases)
    return {(found.case, found.parameter): found for found in findings([engine], quick=True, cases=chosen)}


@pytest.mark.parametrize("engine", [Narrow(), Own(), Flat()], ids=lambda engine: engine.name)
def test_an_engine_without_sobol_has_the_precisions_and_rays_that_it_has(engine):
    assert precisions(engine) == ["float64"]
    assert {found.verdict for found in asked(engine, "T1", "S1", "R3").values()} == {KEPT}


@pytest.mark.parametrize(("engine", "sampler"), [(Narrow(), "random"), (Own(), "white")], ids=["narrow", "own"])
def test_an_image_is_asked_for_with_a_sampler_that_the_engine_has(engine, sampler):
    seen = []

    class Watched(type(engine)):
        def prepare(self, scene, settings):
            seen.append(settings.sampler)
            return super().prepare(scene, settings)

    (found,) = [found for found in asked(Watched(), "rr").values()][:1]
    assert found.verdict == KEPT and set(seen) == {sampler}


def test_what_is_asked_of_samplers_is_asked_of_those_that_are_there():
    found = asked(Narrow(), "q.mean", "q.slope")
    assert {(case, parameter) for case, parameter in found} == {("q.mean", "random"), ("q.slope", "random")}
    assert {each.verdict for each in found.values()} == {KEPT}
    assert {each.verdict for each in asked(Own(), "q.slope").values()} == {DECLINED}


def test_an_engine_that_renders_nothing_says_why():
    with pytest.raises(Declined, match="today is Sunday"):
        precisions(Unwilling())
    with pytest.raises(Declined, match="today is Sunday"):
        Subject(Unwilling(), "float64").tracer(UNIT)


def test_a_config_asks_an_engine_without_sobol_too():
    planned = examinations.planned(VerifyAsked(("T1",), True, 60.0), {"narrow": Narrow(), "no": Unwilling()})
    assert {(each.asked["engine"], each.asked["precision"]) for each in planned} == {("narrow", "float64")}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["frail_engines:Unwilling", "--case", "T1"], "frail_engines:Unwilling: nothing was examined: today is Sunday"),
        (["frail_engines:Misser", "--case", "D3"], "frail_engines:Misser: nothing was examined: it declines: no glass"),
        (["numpy", "--case", "a.mis"], "numpy: nothing was examined: a quick run leaves the chosen cases out"),
        (["frail_engines:Dead", "--case", "T1"], "'frail_engines:Dead': the engine's process was killed by SIGSEGV"),
    ],
)
def test_nothing_examined_is_one_line_and_exit_code_2(tmp_path, arguments, said):
    if "a.mis" in arguments:
        arguments[2] = next(case.id for case in CASES if case.full_only)
    done = raybench("verify", "--quick", "--engine", *arguments, cwd=tmp_path)
    lines = [line for line in done.stderr.splitlines() if not line.startswith("verify [")]
    assert done.returncode == 2 and len(lines) == 1 and said in lines[0], done.stderr
    assert lines[0].startswith("raybench: ")


def test_one_engine_of_several_that_was_not_examined_is_named_and_what_the_others_found_is_written(tmp_path):
    both = ("--engine", "numpy", "--engine", "frail_engines:Unwilling")
    done = raybench("verify", "--quick", *both, "--case", "T6", cwd=tmp_path)
    assert done.returncode == 2 and "frail_engines:Unwilling: nothing was examined" in done.stderr
    found = json.loads((tmp_path / "results/verify/verify.json").read_text())["findings"]
    assert {finding["engine"] for finding in found} == {"numpy"}


def test_a_library_that_crashes_at_the_end_of_its_process_does_not_follow_the_verdict(tmp_path):
    """The command's own process never loads it."""
    same = ("--engines", "frail_engines:LateToCrash,numpy", "--replicates", "4", "--spp", "2", "--size", "16x16")
    for words in (("verify", "--quick", "--engine", "frail_engines:LateToCrash", "--case", "T6"),
                  ("equivalence", "cornell_box", *same, "--margin", "0.5")):  # fmt: skip
        done = raybench(*words, cwd=tmp_path)
        lines = [line for line in done.stderr.splitlines() if not line.startswith("verify [")]
        assert (done.returncode, lines) == (0, []), done.stderr
        assert "kept" in done.stdout or "frail_engines:LateToCrash and numpy" in done.stdout


@pytest.mark.parametrize(
    ("engine", "said"),
    [
        ("frail_engines:CrashingRenders", "frail_engines:CrashingRenders: the engine's process was killed by SIGSEGV"),
        ("frail_engines:Dead", "frail_engines:Dead: the worker was killed by SIGSEGV"),
        ("frail_engines:Own", "frail_engines:Own: it has no sampler random"),
        ("nunba", "unknown engine 'nunba': did you mean 'numba'"),
    ],
)
def test_an_engine_that_makes_no_images_is_one_line_and_no_verdict(tmp_path, engine, said):
    words = ("--replicates", "2", "--spp", "1", "--size", "8x8")
    done = raybench("equivalence", "cornell_box", "--engines", f"numpy,{engine}", *words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "") and len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith(f"raybench: {said}"), done.stderr


def test_neither_command_loads_an_engine_into_its_own_process(tmp_path):
    script = (
        "import sys; from harness.cli import main\n"
        "try: main()\n"
        "except SystemExit as end:\n"
        "    print(end.code, [m for m in ('numba', 'embreex', 'engines.numpy_reference') if m in sys.modules])"
    )
    words = ["equivalence", "cornell_box", "--engines", "numpy,numpy", "--replicates", "2", "--spp", "1", "--size", "8x8"]
    for arguments in (words, ["verify", "--engine", "numpy", "--quick", "--case", "T6"]):
        command = [sys.executable, "-c", script, *arguments]
        environment = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
        assert done.stdout.splitlines()[-1] in ("0 []", "1 []"), done.stdout + done.stderr
    assert engines.engine_names()
