"""Comparing two folders: what was made slower or worse is found, equal ones are left in peace."""

import json
import shutil

import numpy as np
import pytest

from engines.errors import ConfigError
from engines.image import read_image, write_image
from harness.report.tables import changes
from harness.store.results import load_results
from tests.harness.sweeping import raybench
from tests.harness.synthetic import write_folder


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("before"), with_images=False)


def altered(folder, target, change):
    target.mkdir()
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    for event in events:
        if event["event"] == "cell" and event["state"] == "done":
            change(event)
    (target / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return load_results(target)


def verdicts(table, measure):
    return {(row["scene"], row["contestant"]): row["verdict"] for row in table.rows if row.get("measure") == measure}


def slowed(*engines, factor=1.6):
    def change(event):
        if event["engine"] in engines:
            for point in event["points"]:
                point["seconds"] *= factor

    return change


def sessions(folder, target, numbers, change=lambda event: None, drift=0.03):
    """Folders of sessions that drift on their own, with the changes of `change`."""
    rng = np.random.default_rng(list(numbers))
    found = []
    for number in numbers:
        factors = rng.lognormal(0, drift, 1000)

        def remade(event, number=number, factors=factors):
            factor = factors[sum(map(ord, event["cell_id"][:-1])) % 1000]
            event["time"] = f"2026-11-{number:02d}"
            for point in event["points"]:
                point["seconds"] *= factor
            event["phases"] = {phase: seconds * factor for phase, seconds in event["phases"].items()}
            change(event)

        found.append(altered(folder, target / f"s{number}", remade))
    return found


def test_equal_folders_of_one_session_each_show_no_change_and_none_is_claimed(before, tmp_path):
    table = changes([load_results(before)], [altered(before, tmp_path / "after", lambda event: None)])
    assert {row["verdict"] for row in table.rows if row["measure"] == "error"} == {"same"}
    assert {row["verdict"] for row in table.rows if row["measure"] != "error"} == {"unresolved"}
    assert "One session each: drift is not separated from change" in table.note
    assert not any(row["regression"] for row in table.rows)


def test_a_slower_engine_of_one_session_each_may_have_drifted(before, tmp_path):
    """It is named, and a regression beyond the threshold, but no verdict is given."""
    after = altered(before, tmp_path / "after", slowed("numba"))
    table = changes([load_results(before)], [after])
    found = verdicts(table, "seconds per sample")
    assert set(found.values()) == {"slower or drift", "unresolved"}
    assert all((verdict == "slower or drift") == key[1].startswith("numba") for key, verdict in found.items())
    assert {row["contestant"].split()[0] for row in table.rows if row["regression"]} == {"numba"}
    assert not any(row["regression"] for row in changes([load_results(before)], [after], threshold=0.9).rows)
    back = verdicts(changes([after], [load_results(before)]), "seconds per sample")
    assert set(back.values()) == {"faster or drift", "unresolved"}


def test_a_slower_engine_is_found_between_sessions_and_only_it(before, tmp_path):
    old, new = sessions(before, tmp_path, range(1, 6)), sessions(before, tmp_path, range(6, 11), slowed("numba"))
    table = changes(old, new)
    found = verdicts(table, "seconds per sample")
    assert {verdict for key, verdict in found.items() if key[1].startswith("numba")} == {"slower"}
    assert {verdict for key, verdict in found.items() if not key[1].startswith("numba")} <= {"same", "unresolved"}
    assert {row["contestant"].split()[0] for row in table.rows if row["regression"]} == {"numba"}
    assert "tested between 5 and 5 sessions" in table.note and {row["sessions"] for row in table.rows} == {"5 and 5"}
    assert set(verdicts(table, "error").values()) == {"same"}


def test_drift_that_a_pair_of_sessions_shows_is_no_change_between_several(before, tmp_path):
    """The same folders: one of each side differs by more than its blocks explain; three of each do not."""
    old, new = (sessions(before, tmp_path, numbers, drift=0.1) for numbers in (range(1, 5), range(5, 9)))
    assert any(row["regression"] for row in changes(old[:1], new[:1], threshold=0.05).rows)
    assert not any(row["regression"] for row in changes(old, new).rows)


def test_the_machines_of_a_merged_folder_are_compared_one_by_one(before, tmp_path):
    def merged(name, factor):
        events = [json.loads(line) for line in (before / "events.jsonl").read_text().splitlines()]
        for event in [event for event in events if event["event"] == "cell"]:
            other = json.loads(json.dumps(event)) | {"env_id": "other", "cell_id": event["cell_id"] + "-other"}
            for point in other["points"]:
                point["seconds"] *= factor
            events.append(other)
        (tmp_path / name).mkdir()
        (tmp_path / name / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
        return load_results(tmp_path / name)

    found = verdicts(changes([merged("old", 1.0)], [merged("new", 2.0)]), "seconds per sample")
    assert {(name.split()[-1], verdict) for (_, name), verdict in found.items()} == {
        ("env0", "unresolved"),
        ("other", "slower or drift"),
    }


def test_a_session_counts_once(before, tmp_path):
    copy = altered(before, tmp_path / "copy", lambda event: None)
    with pytest.raises(ConfigError, match=r"copy: has measurements of .*: a session counts once"):
        changes([load_results(before), copy], [load_results(before)])


def test_a_worse_estimator_is_found(before, tmp_path):
    def worse(event):
        if event["engine"] == "embree":
            for point in event["points"]:
                point["metrics"]["relmse_e0.01_corrected"] *= 1.5

    found = verdicts(changes([load_results(before)], [altered(before, tmp_path / "after", worse)]), "error")
    assert all((verdict == "worse") == key[1].startswith("embree") for key, verdict in found.items())


def test_contestants_of_one_folder_are_named(before, tmp_path):
    def rename(event):
        if event["engine"] == "embree":
            event["engine"] = "other"

    table = changes([load_results(before)], [altered(before, tmp_path / "after", rename)])
    assert {"only before", "only after"} <= {row["verdict"] for row in table.rows}


def test_other_machines_metrics_and_scenes_are_said(before, tmp_path):
    def move(event):
        event["env_id"] = "elsewhere"
        if event["scene"] == "two_spheres":
            event["scene_hash"] = "another"

    def remade(results):
        results.metric = "mse"
        return results

    first = load_results(before)
    assert "different machines" not in changes([first], [load_results(before)]).note
    table = changes([first], [remade(altered(before, tmp_path / "after", move))])
    assert "different machines" in table.note and "content has changed: two_spheres." in table.note
    assert "Errors are relMSE (ε = 0.01) and MSE: not compared." in table.note
    assert {row["verdict"] for row in table.rows if row.get("measure") == "error"} == {"unresolved"}
    assert {row["verdict"] for row in table.rows if row["scene"] == "two_spheres"} == {"scene changed"}


@pytest.fixture(scope="module")
def pictured(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("pictured") / "before", seeds=3)


def broken(folder, target, change):
    shutil.copytree(folder, target)
    events = [json.loads(line) for line in (target / "events.jsonl").read_text().splitlines()]
    for event in events:
        if event["event"] == "cell" and event["scene"] == "cornell_box" and event["state"] == "done":
            change(event, [target / point["image"] for point in event["points"] if point["image"]])
    (target / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return load_results(target)


def brighten(images):
    for path in images:
        image = read_image(path)
        image[:16, :16] *= 1.5
        write_image(path, image)


def test_what_failed_or_is_flagged_is_a_regression(pictured, tmp_path):
    def breaks(event, images):
        if event["engine"] == "numpy":
            event |= {"state": "failed", "points": []}
        elif event["engine"] == "numba":
            event["counters"] = {"bad_samples": 3}
        else:
            brighten(images)

    after = broken(pictured, tmp_path / "after", breaks)
    table = changes([load_results(pictured)], [after])
    found = {(row["contestant"].split()[0], row.get("measure"), row["verdict"]) for row in table.rows if row["regression"]}
    assert {("numpy", None, "failed"), ("numba", "image", "flagged: bad samples")} < found
    (embree,) = (verdict for engine, _, verdict in found if engine == "embree")
    assert embree.startswith("flagged: ") and "a tile biased" in embree
    again = changes([after], [after])
    assert not any(row["regression"] for row in again.rows)
    assert {row["verdict"] for row in again.rows if row["measure"] == "image"} == {"identical"}


def test_another_image_than_before_is_a_regression_also_where_no_flag_sees_it(pictured, tmp_path):
    def change(event, images):
        event["reference_id"] = None
        brighten(images)

    def forget(event, images):
        event["reference_id"] = None

    old, new = (broken(pictured, tmp_path / name, each) for name, each in (("old", forget), ("new", change)))
    rows = [row for row in changes([old], [new]).rows if row.get("measure") == "image" and row["scene"] == "cornell_box"]
    assert rows and all(row["verdict"] == "different" and row["regression"] for row in rows)


def test_the_command_prints_changes_and_ends_with_1_only_where_it_is_asked_to(before, tmp_path):
    altered(before, tmp_path / "after", slowed("numpy", factor=2))
    done = raybench("compare", before, tmp_path / "after", "-o", tmp_path / "changes.csv")
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if "seconds per sample" in line]
    assert rows and all(("numpy" in row) == ("slower or drift" in row) for row in rows)
    assert "same" in done.stdout, "ratios that did not change are shown, too"
    assert "drift is not separated from change" in done.stdout
    assert "slower or drift" in (tmp_path / "changes.csv").read_text()
    everything = raybench("compare", before, tmp_path / "after", "--all", "--fail-on-regression")
    assert everything.stdout == done.stdout and everything.returncode == 1, "there are no images"
    gate = ["--fail-on-regression", "--threshold", "150%"]
    assert raybench("compare", before, tmp_path / "after", *gate).returncode == 0


def test_the_command_takes_several_sessions_a_side(before, tmp_path):
    old = [results.folder for results in sessions(before, tmp_path, range(1, 5))]
    new = [results.folder for results in sessions(before, tmp_path, range(5, 9), slowed("numpy", factor=2))]
    done = raybench("compare", "--fail-on-regression", "--before", *old, "--after", *new)
    assert done.returncode == 1 and "between 4 and 4 sessions" in done.stdout, done.stderr
    rows = [line for line in done.stdout.splitlines() if "slower" in line and "seconds per sample" in line]
    assert rows and all("numpy" in row for row in rows)


@pytest.mark.parametrize(
    "words, complaint",
    [
        (["a"], "two results folders are expected"),
        (["--before", "a", "b"], "--before and --after with one or more each"),
        (["a", "b", "--after", "c"], "two results folders are expected"),
        (["a", "b", "--threshold", "tenth"], "10% or 0.1"),
    ],
)
def test_other_arguments_are_refused(words, complaint):
    done = raybench("compare", *words)
    assert done.returncode == 2 and complaint in done.stderr and "Traceback" not in done.stderr


def test_a_table_in_no_known_format_is_refused(before, tmp_path):
    done = raybench("compare", before, before, "--output", tmp_path / "changes.xls")
    assert done.returncode == 2 and "must end in .csv, .md or .tex" in done.stderr
