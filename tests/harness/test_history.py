"""Seconds to targets over revisions: steps that were put in are found, by block or between sessions, and drift is not one."""

import json
import math
from itertools import product

import numpy as np
import pytest

from engines.errors import ConfigError
from harness.report.tables import history, markdown_text, regressions
from harness.report.tables.history import beginning
from harness.statistics import PersistentSpread, change_of_pairs
from harness.store.results import load_results
from tests.harness.sweeping import raybench
from tests.harness.synthetic import manifest, write_folder

SCENE, TARGET = "cornell_box", 0.01


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Events of one engine with one setting on one scene."""
    folder = write_folder(tmp_path_factory.mktemp("measured"), with_images=False)
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]

    def kept(event):
        own = event.get("engine"), event.get("scene"), event.get("sampler"), event.get("threads"), event.get("label")
        return event["event"] != "cell" or (own == ("embree", SCENE, {"name": "random"}, 1, None) and event["state"] == "done")

    return [event for event in events if kept(event)]


def session(folder, measured, day, revision, factor=1.0, drift=0.0, builds=None):
    """A results folder; `builds` are factors of seconds by engine, of several builds that are measured in the same blocks, each
    with two twins."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(day)
    by_day = rng.lognormal(0, drift)
    lines = []
    for event in measured:
        if event["event"] != "cell":
            lines.append(event)
            continue
        labels = [None] if builds is None else [None, "A/A", "A/A 2"]
        for (engine, slower), label in product((builds or {"embree": factor}).items(), labels):
            noise = by_day * slower * rng.lognormal(0, 0.01)
            points = [{**point, "seconds": point["seconds"] * noise} for point in event["points"]]
            changed = {"points": points, "engine": engine, "label": label, "time": f"2026-11-{day:02d}T03:00:00Z"}
            lines.append({**event, **changed, "cell_id": f"{event['cell_id']}-{len(engine)}{engine[-2]}{len(label or '')}"})
    (folder / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    made = manifest()
    (folder / "manifest.json").write_text(json.dumps({**made, "config": {**made["config"], "revision": revision}}))
    return folder


def table_of(*folders):
    return history([load_results(folder) for folder in folders])


def at(table, revision, key="verdict"):
    return next(row[key] for row in table.rows if (row["revision"], row["target"]) == (revision, TARGET))


def test_a_step_between_sessions_of_three_revisions_is_found_and_drift_is_none(measured, tmp_path):
    days = iter(range(1, 20))
    folders = [
        session(tmp_path / f"{revision}-{n}", measured, next(days), revision, factor, drift=0.01)
        for revision, factor in (("one", 1.0), ("two", 1.0), ("three", 1.3))
        for n in range(3)
    ]
    table = table_of(*reversed(folders))
    assert [row["revision"] for row in table.rows if row["target"] == TARGET] == ["one", "two", "three"]
    assert at(table, "two") in ("same", "unresolved") and at(table, "three") == "slower"
    assert at(table, "three", "step").value == pytest.approx(1.3, rel=0.05)
    assert at(table, "three", "sessions") == 3
    assert {row["revision"] for row in regressions(table)} == {"three"}


def test_a_regression_that_later_revisions_share_is_no_longer_one(measured, tmp_path):
    order = (("one", 1.0), ("two", 1.5), ("three", 1.5))
    folders = [session(tmp_path / revision, measured, day, revision, factor) for day, (revision, factor) in enumerate(order, 1)]
    assert at(table_of(*folders[:2]), "two") == "slower or drift" and regressions(table_of(*folders[:2]))
    table = table_of(*folders)
    assert at(table, "two", "regression") and not regressions(table)


def test_builds_that_one_session_measures_are_paired_by_block(measured, tmp_path):
    """Sessions drift by 30 %; what is paired does not see it, and one session is enough."""
    nights = [("a", "b", 1.0, 1.0), ("b", "c", 1.0, 1.1)]
    folders = []
    for day, (old, new, before, after) in enumerate(nights, 1):
        builds = {"mine (old)": before, "mine (new)": after}
        revision = {"mine (old)": old, "mine (new)": new}
        folders.append(session(tmp_path / new, measured, day, revision, drift=0.3, builds=builds))
    table = table_of(*folders)
    assert {row["contestant"] for row in table.rows} == {"mine"}
    assert at(table, "b") in ("same", "unresolved")
    assert at(table, "c") == "slower" and at(table, "c", "step").value == pytest.approx(1.1, rel=0.03)


def test_a_target_that_is_no_longer_reached_is_a_regression(measured, tmp_path):
    first = session(tmp_path / "one", measured, 1, "one")
    short = [{**event, "points": event["points"][:2]} if event["event"] == "cell" else event for event in measured]
    table = table_of(first, session(tmp_path / "two", short, 2, "two"))
    assert at(table, "two") == "no longer reached" and at(table, "two", "reached").startswith("0/")
    assert regressions(table)


def failing(event):
    return {**event, "state": "failed", "message": "it crashed\nat line 3", "points": []} if event["event"] == "cell" else event


def test_a_revision_that_fails_wholly_is_a_regression_and_the_next_is_compared_with_the_one_before_it(measured, tmp_path):
    one = session(tmp_path / "one", measured, 1, "one")
    broken = session(tmp_path / "broken", [failing(event) for event in measured], 2, "broken")
    table = table_of(one, broken)
    assert (at(table, "broken"), at(table, "broken", "reached")) == ("failed: it crashed", "0/5")
    assert {row["revision"] for row in regressions(table)} == {"broken"}
    assert "| failed: it crashed |" in markdown_text(table) and math.isnan(at(table, "broken", "seconds").value)
    mended = session(tmp_path / "mended", measured, 3, "mended", factor=1.5)
    table = table_of(one, broken, mended)
    assert at(table, "mended") == "slower or drift" and at(table, "mended", "step").value == pytest.approx(1.5, rel=0.05)
    assert len({row["contestant"] for row in table.rows}) == 1
    assert table_of(broken).rows[0]["verdict"] == "failed: it crashed" and not regressions(table_of(broken))


def test_sessions_without_twins_are_told(measured, tmp_path):
    table = table_of(*(session(tmp_path / name, measured, day, name) for day, name in enumerate(("one", "two"), 1)))
    assert "2 sessions without A/A twins: what differs between two equal builds in all blocks alike is not known" in table.note
    whole = write_folder(tmp_path / "twins", with_images=False)
    written = json.loads((whole / "manifest.json").read_text())
    (whole / "manifest.json").write_text(json.dumps({**written, "config": {**written["config"], "revision": "one"}}))
    assert "without A/A twins" not in table_of(whole).note


@pytest.mark.parametrize(
    ("builds", "name"),
    [
        (["mine (old)", "mine (new)"], "mine"),
        (["tracer-fast", "tracer-fixed"], "tracer"),
        (["tracer 1.10", "tracer 1.12"], "tracer 1"),
        (["build7", "build8"], "build"),
        (["builds:old", "builds:new"], "builds"),
        (["fast", "fixed"], ""),
    ],
)
def test_builds_are_followed_by_the_whole_words_that_their_names_share(builds, name):
    assert beginning(builds) == name


def test_pairs_are_tested_by_blocks_of_few_sessions_and_by_sessions_of_many():
    rng = np.random.default_rng(3)
    few, many = ([[(1.0, 1.2 * rng.lognormal(0, 0.01)) for _ in range(5)] for _ in range(count)] for count in (1, 4))
    none, unknown = PersistentSpread(0.0, 4, 1e-4), PersistentSpread(math.nan, 0, math.nan)
    assert change_of_pairs(few, [none]).tested and change_of_pairs(few, [none]).freedom == 4
    assert change_of_pairs(many, [unknown] * 4).tested and change_of_pairs(many, [unknown] * 4).freedom == 3
    assert not change_of_pairs([few[0][:2]], [none]).tested and not change_of_pairs(few, [unknown]).tested
    assert change_of_pairs(many, [none] * 4).mean == pytest.approx(np.log(1.2), abs=0.02)
    assert np.isnan(change_of_pairs([[(1.0, np.inf)]], [none]).mean)


def test_the_persistent_spread_of_a_machine_counts_in_pairs_of_few_sessions():
    rng = np.random.default_rng(4)
    sessions = [[(1.0, rng.lognormal(0, 0.01)) for _ in range(5)] for _ in range(2)]
    alone = change_of_pairs(sessions, [PersistentSpread(0.0, 4, 1e-4)] * 2)
    spread = change_of_pairs(sessions, [PersistentSpread(0.03**2, 4, 1e-4)] * 2)
    assert spread.error**2 == pytest.approx(alone.error**2 + 0.03**2)
    assert spread.mean == alone.mean and spread.freedom < 2 * 4


def test_the_command_writes_table_and_plot_and_ends_with_one_on_a_regression(measured, tmp_path):
    for day, (revision, factor) in enumerate((("0" * 40, 1.0), ("f" * 40, 1.6)), 1):
        session(tmp_path / "all" / f"night-{day}", measured, day, revision, factor)
    done = raybench("history", "all", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "slower or drift" in done.stdout and "ffffffffff" in done.stdout
    assert "sessions,seconds,seconds_low" in (tmp_path / "all/history.csv").read_text()
    assert (tmp_path / "all/history.png").stat().st_size > 5000
    assert raybench("history", "all", "--threshold", "90%", cwd=tmp_path).returncode == 0
    nothing = raybench("history", "elsewhere", cwd=tmp_path)
    assert nothing.returncode == 2 and "no results folder is there or below it" in nothing.stderr


def test_sessions_without_a_revision_and_copies_are_refused(measured, tmp_path):
    with pytest.raises(ConfigError, match="has no revision: run it with --set revision="):
        table_of(session(tmp_path / "none", measured, 1, None))
    one, again = (session(tmp_path / name, measured, 1, "one") for name in ("one", "again"))
    with pytest.raises(ConfigError, match="a session counts once"):
        table_of(one, again)
