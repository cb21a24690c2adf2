"""The suite in worker processes: same results, same order; a crash is a failure; no process is left behind."""

import json

import psutil
import pytest
from typer.testing import CliRunner

import engines
from engines.errors import ConfigError, UnknownName
from harness.check_results import FAIL
from harness.cli import app
from harness.verify import CASES, run_suite
from harness.verify.commands import verify as command
from harness.verify.parallel import describe_engines, make_jobs, run_jobs

CHOSEN = [case for case in CASES if case.id in ("S4", "S6", "S10", "T6", "R4")]


def run_in_order(spec, processes):
    """All results of an engine in the order of the jobs, without their seconds."""
    jobs = make_jobs(describe_engines([spec]), True, CHOSEN)
    return [result.model_copy(update={"seconds": 0.0}) for done in sorted(run_jobs(jobs, processes)) for result in done.results]


def test_two_processes_give_the_results_of_one_in_the_same_order():
    alone = [f.model_copy(update={"seconds": 0.0}) for f in run_suite([engines.engine("numpy")], quick=True, cases=CHOSEN)]
    assert repr(run_in_order("numpy", 2)) == repr(alone)


def test_a_process_that_dies_is_a_failure_and_the_other_checks_are_run():
    """S10 has two shapes; S4 and S6 come before it in their job, T6 in the next job."""
    found = run_in_order("failing_engines:Dying", 1)
    (died,) = [result for result in found if result.case == "S10"]
    assert died.outcome == FAIL and died.note == "the engine's process was killed by SIGSEGV"
    assert [f.case for f in found] == ["S4", "S6", "S6", "S6", "S10", "T6", "R4"]
    assert all("killed" not in result.note for result in found if result is not died)


def test_closing_the_iterator_ends_the_processes():
    before = set(psutil.Process().children())
    finished = run_jobs(make_jobs(describe_engines(["numpy"]), True, CHOSEN), 2)
    next(finished)
    assert len(set(psutil.Process().children()) - before) == 2
    finished.close()
    assert set(psutil.Process().children()) == before


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        (["--case", "S2"], UnknownName, "unknown case or section 'S2'"),
        (["--engine", "nunba"], UnknownName, "'numba'"),
        (["--out", "/proc/verify"], ConfigError, "--out /proc/verify"),
        (["--engine", "box.yaml"], ConfigError, "no single rays"),
        (["--engine", "failing_engines:Misser"], ConfigError, "--allow-imports"),
    ],
)
def test_wrong_options_are_refused_before_anything_runs(arguments, error, said):
    refused = CliRunner().invoke(app, ["verify", *arguments])
    assert isinstance(refused.exception, error) and said in str(refused.exception)


def test_results_before_an_interrupt_are_written_beside_earlier_results(tmp_path, monkeypatch):
    def interrupted(jobs, processes):
        for done in run_jobs(jobs, processes):
            yield done
            raise KeyboardInterrupt

    (tmp_path / "verify.json").write_text("earlier")
    monkeypatch.setattr(command, "run_jobs", interrupted)
    arguments = ["verify", "--engine", "numpy", "--quick", "--case", "S1", "--case", "T1", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 130 and "Interrupted after 1 of 2 jobs" in result.output
    assert (tmp_path / "verify.json").read_text() == "earlier"
    kept = json.loads((tmp_path / "interrupted" / "verify.json").read_text())
    assert {result["case"] for result in kept["results"]} in ({"S1"}, {"T1"})
