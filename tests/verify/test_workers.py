"""The battery in processes: the same findings in the same order, a crash is a finding, nothing is left behind."""

import json
import multiprocessing
from dataclasses import replace

import pytest
from typer.testing import CliRunner

import engines
from engines.errors import ConfigError, UnknownName
from harness.cli import app
from harness.verify import CASES, findings, workers
from harness.verify.battery import BROKEN

CHOSEN = [case for case in CASES if case.id in ("S4", "S6", "S10", "T6", "R4")]


def in_order(parts, jobs):
    done = sorted(workers.run(parts, jobs))
    return [replace(finding, seconds=0.0) for each in done for finding in each.findings]


def test_processes_side_by_side_find_what_one_finds_in_the_same_order():
    alone = [replace(f, seconds=0.0) for f in findings([engines.engine("numpy")], quick=True, cases=CHOSEN)]
    assert repr(in_order(workers.parts(workers.known(["numpy"]), True, CHOSEN), 2)) == repr(alone)


def test_a_process_that_dies_is_a_finding_and_the_rest_is_asked():
    """S10 has two shapes; S4 and S6 come before it in their part, T6 in the next."""
    found = in_order(workers.parts(workers.known(["frail_engines:Dying"]), True, CHOSEN), 1)
    (died,) = [finding for finding in found if finding.case == "S10"]
    assert died.verdict == BROKEN and died.note == "the engine's process was killed by SIGSEGV"
    assert [f.case for f in found] == ["S4", "S6", "S6", "S6", "S10", "T6", "R4"]
    assert all("killed" not in finding.note for finding in found if finding is not died)


def test_whoever_stops_listening_leaves_no_process_behind():
    parts = workers.run(workers.parts(workers.known(["numpy"]), True, CHOSEN), 2)
    next(parts)
    parts.close()
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [(["--case", "S2"], UnknownName, "unknown case or section 'S2'"), (["--engine", "nunba"], UnknownName, "'numba'"),
     (["--out", "/proc/verify"], ConfigError, "--out /proc/verify"), (["--engine", "box.yaml"], ConfigError, "no single rays"),
     (["--engine", "frail_engines:Misser"], ConfigError, "--allow-imports")],
)  # fmt: skip
def test_what_cannot_be_asked_is_refused_before_anything_runs(arguments, error, said):
    refused = CliRunner().invoke(app, ["verify", *arguments])
    assert isinstance(refused.exception, error) and said in str(refused.exception)


def test_what_was_found_before_an_interrupt_is_kept_beside_earlier_results(tmp_path, monkeypatch):
    run = workers.run

    def interrupted(parts, jobs):
        for done in run(parts, jobs):
            yield done
            raise KeyboardInterrupt

    (tmp_path / "verify.json").write_text("earlier")
    monkeypatch.setattr(workers, "run", interrupted)
    asked = ["verify", "--engine", "numpy", "--quick", "--case", "S1", "--case", "T1", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 130 and "Interrupted after 1 of 2 parts" in result.output
    assert (tmp_path / "verify.json").read_text() == "earlier"
    kept = json.loads((tmp_path / "interrupted" / "verify.json").read_text())
    assert {finding["case"] for finding in kept["findings"]} in ({"S1"}, {"T1"})
