"""Contended cells are measured again at the end of a run: what counts, how often, and that an interrupt loses nothing."""

from collections import Counter
from types import SimpleNamespace

import pytest

from harness import store
from harness.analysis import analyse
from harness.measure import contention
from harness.run.recorder import Attempts, Recorder
from harness.store.records import attempt_of
from harness.store.results import load_results
from tests.harness import sweeping

TEXT = sweeping.EXPERIMENT.replace("remeasure: 0", "remeasure: 2").replace("images: none", "images: last")


class Contention:
    """Stands for the rule: the n-th measurement is contended where `script` says 1. Interrupts at call `stop_at`."""

    def __init__(self, monkeypatch, script="", stop_at=None):
        self.calls, self.script, self.stop_at = 0, script, stop_at
        monkeypatch.setattr(contention, "judged", self)

    def __call__(self, machine, threads, ended=0.0):
        self.calls += 1
        if self.calls - 1 == self.stop_at:
            self.stop_at = None
            raise KeyboardInterrupt
        mark = self.script[self.calls - 1 : self.calls]
        return {**machine, "contended": mark == "1", "contention_rule": contention.RUN_QUEUE}


def events(folder, kind):
    return [event for event in store.read_events(folder) if event.event == kind]


def of_cells(folder):
    return sorted(store.latest_cells(store.read_events(folder)).values(), key=lambda event: event.order)


def images_are_there(folder, found):
    images = [point.image for event in found for point in event.points if point.image]
    assert images and all((folder / image).is_file() for image in images)


def test_the_first_uncontended_measurement_counts(tmp_path, monkeypatch):
    """The second and third of four cells are contended; the second one also at its next attempt."""
    Contention(monkeypatch, "0110100")
    path, out = sweeping.write(tmp_path, TEXT), tmp_path / "out"
    outcome, listener = sweeping.run(path, out)
    assert outcome.states == {"done": 4} and outcome.measured == 7
    assert Counter(listener.cells) == Counter(dict(zip((e.cell_id for e in of_cells(out)), (1, 3, 2, 1), strict=True)))
    assert [(e.attempt, e.machine.contended) for e in of_cells(out)] == [(1, 0), (3, 0), (2, 0), (1, 0)]
    assert listener.notes[-2:] == [
        "2 contended cells are measured again (round 1 of 2)",
        "1 contended cells are measured again (round 2 of 2)",
    ]
    (left,) = events(out, "attempt")
    assert left.attempt == 2 and left.machine.contended
    images_are_there(out, [*events(out, "cell"), left])  # nothing measured is lost
    before = (out / store.EVENTS).read_bytes()
    again, _ = sweeping.run(path, out)
    assert again.measured == 0 and (out / store.EVENTS).read_bytes() == before


def test_a_cell_that_stays_contended_is_kept_and_flagged(tmp_path, monkeypatch):
    Contention(monkeypatch, "1000110000")
    path, out = sweeping.write(tmp_path, TEXT), tmp_path / "out"
    outcome, listener = sweeping.run(path, out)
    assert outcome.states == {"done": 4} and outcome.measured == 6
    assert listener.notes[-1] == "1 cells stay contended: they are kept, and flagged"
    kept = of_cells(out)[0]
    assert kept.attempt == 1 and kept.machine.contended, "the first measurement"
    assert [event.attempt for event in events(out, "attempt")] == [2, 3]
    images_are_there(out, of_cells(out))
    flags = {v.contestant.settings.engine: v.flags for v in analyse(load_results(out)).verdicts}
    assert "contended" in flags[kept.engine] and sum("contended" in each for each in flags.values()) == 1
    assert sweeping.run(path, out)[0].measured == 0, "the rounds are used up, over all runs"
    assert sweeping.run(path, out, ["remeasure=3"])[0].measured == 1
    assert not of_cells(out)[0].machine.contended


@pytest.mark.parametrize("stop_at", [1, 4, 6, *(pytest.param(at, marks=pytest.mark.slow) for at in (0, 2, 3, 5))])
def test_an_interrupted_run_ends_like_an_undisturbed_one(tmp_path, monkeypatch, stop_at):
    """Interrupted in each of the measurements, of which the fifth to seventh are repetitions."""
    path, out = sweeping.write(tmp_path, TEXT), tmp_path / "out"
    script = "0110100"
    found = Contention(monkeypatch, script[:stop_at] + "-" + script[stop_at:], stop_at)
    with pytest.raises(KeyboardInterrupt):
        sweeping.run(path, out)
    outcome, _ = sweeping.run(path, out)
    assert found.calls == 8 and outcome.measured == 7 - stop_at and outcome.states == {"done": 4}
    assert [(e.attempt, e.machine.contended) for e in of_cells(out)] == [(1, 0), (3, 0), (2, 0), (1, 0)]
    assert len(events(out, "attempt")) == 1
    images_are_there(out, [*events(out, "cell"), *events(out, "attempt")])


def test_a_repetition_that_fails_leaves_the_measurement(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_TEST_MEND", str(tmp_path / "mended"))
    (tmp_path / "mended").touch()
    found = Contention(monkeypatch, "11")
    text = TEXT.replace("'fake_engines:Steady', 'fake_engines:Other'", "'fake_engines:Mended'")
    path, out = sweeping.write(tmp_path, text), tmp_path / "out"
    sweeping.run(path, out, ["remeasure=0"])
    (tmp_path / "mended").unlink()
    found.script = "1100"
    outcome, _ = sweeping.run(path, out, ["remeasure=1"], fail_fast=True)
    assert outcome.states == {"done": 2} and not outcome.failures
    assert sorted(e.machine.contended for e in of_cells(out)) == [False, True]
    (failed,) = events(out, "attempt")
    assert failed.state == "failed" and "the tree fell over" in failed.message and failed.seed == 2


@pytest.mark.parametrize("contended", [1, 2])
def test_cells_that_only_their_blocks_show_to_be_contended_are_measured_again(tmp_path, monkeypatch, contended):
    """Four blocks; in the last one others had the processor, at its first measurements."""

    def by_cpu_time(machine, threads, ended=0.0):
        calls.append(0)
        used = 0.5 if 4 <= len(calls) < 4 + contended else 1.0
        figures = {"cpu_seconds": used, "timed_seconds": 1.0, "other_cpu_seconds": 1.0 - used}
        return {**machine, **figures, "contended": False, "contention_rule": contention.CPU_TIME}

    calls = []
    monkeypatch.setattr(contention, "judged", by_cpu_time)
    text = TEXT.replace("'fake_engines:Steady', 'fake_engines:Other'", "'fake_engines:Steady'")
    path, out = sweeping.write(tmp_path, text), tmp_path / "out"
    outcome, _ = sweeping.run(path, out, ["repeats=4", "aa_twin=false"])
    assert outcome.measured == len(calls) == 4 + contended
    last = of_cells(out)[-1]
    assert last.attempt == 1 + contended and not last.machine.contended
    history = [e for e in events(out, "cell") if e.cell_id == last.cell_id]
    assert [e.machine.contended for e in history] == [False, True] * contended + [False]
    images_are_there(out, history)
    assert sweeping.run(path, out, ["repeats=4", "aa_twin=false"])[0].measured == 0


def test_nothing_is_measured_again_where_times_do_not_count_or_the_machine_is_another(tmp_path, monkeypatch):
    Contention(monkeypatch, "1111")
    path, out = sweeping.write(tmp_path, TEXT), tmp_path / "out"
    assert sweeping.run(path, out, ["timing=false"])[0].measured == 4
    from harness.measure import machine

    elsewhere = {**machine.environment(), "cpu": "another"}
    monkeypatch.setattr(machine, "environment", lambda: elsewhere)
    before = (out / store.EVENTS).read_bytes().count(b'"run"')
    assert sweeping.run(path, out)[0].measured == 0
    assert (out / store.EVENTS).read_bytes().count(b'"run"') == before


def test_attempts_go_on_behind_the_one_that_counts(tmp_path):
    path, out = sweeping.write(tmp_path, TEXT), tmp_path / "out"
    sweeping.run(path, out, ["remeasure=0", "repeats=1"])
    first = of_cells(out)[0]
    second = first.replaced(attempt=2)  # in the same second, as rays are
    found = [Attempts([first, *more]).of(first.cell_id) for more in ([], [first], [second], [second, attempt_of(second)])]
    assert found == [0, 0, 1, 2]
    assert Attempts([first, second, first.replaced(time="later")]).of(first.cell_id) == 0, "a first measurement again"


def test_with_fail_fast_a_cell_that_is_done_after_the_failure_does_not_take_it_back():
    run = SimpleNamespace(stopped=False, _fail_fast=True)
    for state in ("done", "failed", "done"):
        Recorder.stop_if_broken(run, SimpleNamespace(state=state))
    assert run.stopped
