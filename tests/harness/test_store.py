"""The results folder: nothing lost, nothing twice, whatever the moment of a crash."""

import json
import os
import subprocess
import sys
import warnings

import pytest
from pydantic import ValidationError

from engines.choices import Choice
from engines.errors import ConfigError
from harness import store
from harness.statistics import BiasEstimate, Equivalence
from harness.statistics.calibration import RaceFigures
from harness.store.events import line_of
from harness.store.records import (
    ArchivedBias,
    ArchivedEquivalence,
    ArchivedPair,
    ArchivedVerdicts,
    Calibration,
    Cell,
    Machine,
    Phases,
    Point,
    Start,
)
from tests.harness import sweeping

FIRST = Cell(
    cell_id="a",
    env_id="env0",
    state="done",
    block=0,
    seed=1,
    scene="ball",
    scene_hash="b",
    engine="numpy",
    shader=Choice("albedo"),
    sampler=Choice("random"),
    accelerator=Choice("auto"),
    precision="float64",
    threads=1,
    width=8,
    height=6,
    reference_id=None,
)
SECOND = Start(cell_id="a")
KNOWN = ("weight", "difference", "image_z", "image_bound", "tile_difference", "tile_z", "tile_bound")


def lines(folder):
    return (folder / store.EVENTS).read_bytes()


def test_what_was_appended_is_read_back_in_order(tmp_path):
    with store.Events(tmp_path) as events:
        events.append(FIRST)
        assert store.read_events(tmp_path) == [FIRST], "on disk before the next one"
        events.append(SECOND)
    assert store.read_events(tmp_path) == [FIRST, SECOND]


@pytest.mark.parametrize("kept", range(len(line_of(SECOND)) - 1))
def test_a_line_cut_anywhere_is_ignored_reported_and_removed(tmp_path, kept):
    with store.Events(tmp_path) as events:
        events.append(FIRST)
        events.append(SECOND)
    whole = lines(tmp_path)
    cut = whole[: whole.index(b"\n") + 1 + kept]
    (tmp_path / store.EVENTS).write_bytes(cut)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert store.read_events(tmp_path) == [FIRST]
    assert [str(w.message).count("cut short") for w in caught] == ([1] if kept else [])
    with store.Events(tmp_path) as events:
        assert events.torn == (kept > 0)
        events.append(SECOND)
    assert lines(tmp_path) == whole


def test_a_whole_line_that_lacks_only_its_end_is_kept(tmp_path):
    (tmp_path / store.EVENTS).write_bytes(line_of(FIRST)[:-1])
    with store.Events(tmp_path) as events:
        assert not events.torn
        events.append(SECOND)
    assert store.read_events(tmp_path) == [FIRST, SECOND]


def test_damage_in_the_middle_is_refused_with_its_line(tmp_path):
    (tmp_path / store.EVENTS).write_bytes(line_of(FIRST) + b"{oops\n" + line_of(SECOND))
    with pytest.raises(ConfigError, match=r"events\.jsonl:2: not an event"):
        store.read_events(tmp_path)


def test_a_folder_without_events_is_told_as_such(tmp_path):
    for read in (store.read_events, store.read_manifest):
        with pytest.raises(ConfigError, match="is this a results folder"):
            read(tmp_path)


def test_the_last_event_of_a_cell_is_its_state_and_nothing_is_there_twice():
    events = [FIRST, SECOND, FIRST.replaced(cell_id="b"), FIRST.replaced(state="outdated")]
    latest = store.latest_cells(events)
    assert {key: event.state for key, event in latest.items()} == {"a": "outdated", "b": "done"}
    assert list(latest) == ["a", "b"]


def test_errors_that_are_not_finite_survive(tmp_path):
    with store.Events(tmp_path) as events:
        events.append(FIRST.replaced(counters={"x": float("inf"), "y": float("nan")}))
    (event,) = store.latest_cells(store.read_events(tmp_path)).values()
    assert event.counters["x"] == float("inf") and event.counters["y"] != event.counters["y"]


SETTINGS = FIRST.settings
EQUAL = Equivalence("equivalent", 1e-4, -1e-3, 1e-3, 1e-3, 0.02, (16, 0), 0.005, 0.05, 0.5)
RECORDS = [
    FIRST.replaced(
        raced=Choice("whitted", {"max_depth": 3}),
        points=(
            Point(spp=4, seconds=0.1, metrics={"mse": 1e-3}, sampler=Choice("stratified", {"strata": 4}), image="images/a.exr"),
        ),
        phases=Phases(build_seconds=0.1),
        machine=Machine(contended=True, involuntary_switches=3),
    ),
    ArchivedVerdicts(
        bias=(
            ArchivedBias(
                of=SETTINGS, found=BiasEstimate(1e-6, 1e-6, 1, worst_tile=(0, 16))._replace(**dict.fromkeys(KNOWN, 0.1))
            ),
        ),
        baseline=(ArchivedEquivalence(of=SETTINGS, found=EQUAL),),
        pairs=(ArchivedPair(first=SETTINGS, second=SETTINGS, found=EQUAL, replicates=(2, 2), spp=(8, 8), paired=True),),
    ),
    Calibration(
        races=RaceFigures(0.0, 0.96, (0.1, 0.9), 0.02),
        bias=None,
        race_count=3,
        image_count=0,
        repetitions=1000,
        image_repetitions=1000,
        without_twins=0,
    ),
]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.event)
def test_a_record_is_read_as_it_was_made(tmp_path, record):
    with store.Events(tmp_path) as events:
        events.append(record)
    (found,) = store.read_events(tmp_path)
    assert found == record and line_of(found) == line_of(record)


def test_a_record_does_not_change():
    with pytest.raises(ValidationError, match="frozen"):
        FIRST.state = "failed"
    assert FIRST.replaced(state="failed").state == "failed" and FIRST.state == "done"


def test_a_second_run_is_kept_out_and_told_who_is_in(tmp_path):
    with store.locked(tmp_path):
        assert store.is_locked(tmp_path)
        told = rf"another run \(process {os.getpid()}\) is writing here"
        with pytest.raises(ConfigError, match=told), store.locked(tmp_path):
            pass
    assert not store.is_locked(tmp_path)


def test_the_lock_of_a_killed_process_is_gone(tmp_path):
    script = f"""
import os, signal
from pathlib import Path
from harness import store
from harness.store.events import line_of
from harness.statistics import BiasEstimate, Equivalence
from harness.statistics.calibration import RaceFigures
from harness.store.records import (
    ArchivedBias,
    ArchivedEquivalence,
    ArchivedPair,
    ArchivedVerdicts,
    Calibration,
    Cell,
    Machine,
    Phases,
    Point,
    Start,
)
with store.locked(Path({str(tmp_path)!r})):
    os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", script], env=sweeping.environment(), check=False)
    with store.locked(tmp_path):
        pass


def test_a_file_is_replaced_whole(tmp_path):
    store.write_json(tmp_path / "a.json", {"x": 1})
    store.write_json(tmp_path / "a.json", {"x": 2})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": 2}
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_fresh_removes_results_and_nothing_else(tmp_path):
    with store.Events(tmp_path) as events:
        events.append(FIRST)
    (tmp_path / "images" / "a").mkdir(parents=True)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "report.html").write_text("<html>")
    store.clear(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_fresh_does_not_touch_a_folder_that_holds_no_results(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "holiday.jpg").write_text("mine")
    with pytest.raises(ConfigError, match="it is no results folder"):
        store.clear(tmp_path)
    assert (tmp_path / "images" / "holiday.jpg").exists()
