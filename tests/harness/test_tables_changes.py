"""Comparing two folders: what was made slower or worse is found, equal ones are left in peace."""

import json

import pytest

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
    return {(row["scene"], row["contender"]): row["verdict"] for row in table.rows if row.get("measure") == measure}


def test_equal_folders_show_no_change(before, tmp_path):
    table = changes(load_results(before), altered(before, tmp_path / "after", lambda event: None))
    assert {row["verdict"] for row in table.rows} == {"no change"}


def test_a_slower_engine_is_found_and_only_it(before, tmp_path):
    def slow(event):
        if event["engine"] == "numba":
            for point in event["points"]:
                point["seconds"] *= 1.6

    found = verdicts(changes(load_results(before), altered(before, tmp_path / "after", slow)), "seconds per sample")
    assert all((verdict == "slower") == key[1].startswith("numba") for key, verdict in found.items())


def test_a_worse_estimator_is_found(before, tmp_path):
    def worse(event):
        if event["engine"] == "embree":
            for point in event["points"]:
                point["metrics"]["relmse_e0.01_corrected"] *= 1.5

    found = verdicts(changes(load_results(before), altered(before, tmp_path / "after", worse)), "error")
    assert all((verdict == "worse") == key[1].startswith("embree") for key, verdict in found.items())


def test_contenders_of_one_folder_are_named(before, tmp_path):
    def rename(event):
        if event["engine"] == "embree":
            event["engine"] = "other"

    table = changes(load_results(before), altered(before, tmp_path / "after", rename))
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
    assert "different machines" not in changes(first, load_results(before)).note
    table = changes(first, remade(altered(before, tmp_path / "after", move)))
    assert "different machines" in table.note and "content has changed: two_spheres." in table.note
    assert "relMSE (ε = 0.01) before and MSE after" in table.note
    assert {row["verdict"] for row in table.rows if row["measure"] == "error"} == {"unresolved"}


def test_the_command_prints_changes_and_ends_with_0(before, tmp_path):
    def slow(event):
        if event["engine"] == "numpy":
            for point in event["points"]:
                point["seconds"] *= 2

    altered(before, tmp_path / "after", slow)
    done = raybench("compare", before, tmp_path / "after", "-o", tmp_path / "changes.csv")
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if "seconds per sample" in line]
    assert rows and all("numpy" in row and "slower" in row for row in rows)
    assert f"{len(rows)} slower" in done.stdout and "no change" in done.stdout
    assert "no change" in (tmp_path / "changes.csv").read_text()
    everything = raybench("compare", before, tmp_path / "after", "--all").stdout
    assert len(everything.splitlines()) > len(done.stdout.splitlines()) + 10


def test_a_table_in_no_known_format_is_refused(before, tmp_path):
    done = raybench("compare", before, before, "--output", tmp_path / "changes.xls")
    assert done.returncode == 2 and "must end in one of .csv, .md, .tex" in done.stderr
