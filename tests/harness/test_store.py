"""The results folder: nothing lost, nothing twice, whatever the moment of a crash."""

import json
import os
import subprocess
import sys
import warnings

import pytest

from engines.errors import ConfigError
from harness import store
from tests.harness import sweeping

FIRST = {
    "event": "cell",
    "cell_id": "a",
    "state": "done",
    "block": 0,
    "seed": 1,
    "scene": "ball",
    "scene_hash": "b",
    "engine": "numpy",
    "shader": {"name": "albedo"},
    "sampler": {"name": "random"},
    "accelerator": {"name": "auto"},
    "threads": 1,
    "width": 8,
    "height": 6,
    "reference_id": None,
    "phases": {},
    "points": [],
    "counters": {},
    "machine": {},
}
SECOND = {"event": "start", "cell_id": "a"}


def lines(folder):
    return (folder / store.EVENTS).read_bytes()


def test_what_was_appended_is_read_back_in_order(tmp_path):
    with store.Events(tmp_path) as events:
        events.append(FIRST)
        assert store.read_events(tmp_path) == [FIRST], "on disk before the next one"
        events.append(SECOND)
    assert store.read_events(tmp_path) == [FIRST, SECOND]


@pytest.mark.parametrize("kept", range(len(json.dumps(SECOND))))
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
    (tmp_path / store.EVENTS).write_text(json.dumps(FIRST))
    with store.Events(tmp_path) as events:
        assert not events.torn
        events.append(SECOND)
    assert store.read_events(tmp_path) == [FIRST, SECOND]


def test_damage_in_the_middle_is_refused_with_its_line(tmp_path):
    (tmp_path / store.EVENTS).write_text(json.dumps(FIRST) + "\n{oops\n" + json.dumps(SECOND) + "\n")
    with pytest.raises(ConfigError, match=r"events\.jsonl:2: not an event"):
        store.read_events(tmp_path)


def test_a_folder_without_events_is_told_as_such(tmp_path):
    for read in (store.read_events, store.read_manifest):
        with pytest.raises(ConfigError, match="is this a results folder"):
            read(tmp_path)


def test_the_last_event_of_a_cell_is_its_state_and_nothing_is_there_twice():
    events = [FIRST, SECOND, {**FIRST, "cell_id": "b"}, {**FIRST, "state": "outdated"}]
    latest = store.latest_cells(events)
    assert {key: event["state"] for key, event in latest.items()} == {"a": "outdated", "b": "done"}
    assert list(latest) == ["a", "b"]


def test_errors_that_are_not_finite_survive(tmp_path):
    with store.Events(tmp_path) as events:
        events.append({**FIRST, "x": float("inf"), "y": float("nan")})
    (event,) = store.read_events(tmp_path)
    assert event["x"] == float("inf") and event["y"] != event["y"]


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
