"""Merging: nothing is lost or mixed, and two machines never share a time axis in silence."""

import json
import shutil

import pytest

from engines.errors import ConfigError
from harness import store
from harness.analysis import analyse
from harness.report.plots.panels import panels
from harness.store.merge import merge
from harness.store.results import load_results
from tests.harness.sweeping import raybench
from tests.harness.synthetic import Size, write_folder


def changed(source, target, change):
    """A copy of a folder whose cells went through `change`; it may return None to drop one."""
    shutil.copytree(source, target)
    events = [json.loads(line) for line in (target / "events.jsonl").read_text().splitlines()]
    events = [change(event) if event["event"] == "cell" else event for event in events]
    (target / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events if event))
    return target


def small(event):
    return event if event["scene"] == "cornell_box" and event["engine"] in ("numpy", "numba") else None


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    folder = tmp_path_factory.mktemp("machines")
    return changed(write_folder(folder / "whole", Size(16, 12), seeds=2, threads=(1,)), folder / "here", small)


@pytest.fixture(scope="module")
def there(here):
    """The same experiment on another machine, twice as fast."""

    def faster(event):
        for point in event["points"]:
            point["seconds"] /= 2
        return event | {"env_id": "env1"}

    folder = changed(here, here.parent / "there", faster)
    environment = {"event": "environment", "env_id": "env1", "preimage": {"cpu": "Other 9000", "usable_cores": 4}}
    with (folder / "events.jsonl").open("a") as file:
        file.write(json.dumps(environment) + "\n")
    return folder


@pytest.fixture(scope="module")
def merged(here, there):
    out = here.parent / "merged"
    assert merge([here, there], out) == {"env0": 10, "env1": 10}
    return out


@pytest.fixture(scope="module")
def commanded(here, there):
    """What the command printed, and the folder that it wrote."""
    out = here.parent / "out"
    return raybench("archive", here, there, "--out", out, RAYBENCH_PLOTS="svg"), out


def done(folder):
    return [cell for cell in load_results(folder).cells if cell.state == "done"]


def test_every_cell_of_every_machine_is_there_as_measured(here, there, merged):
    found = {(cell.measured_as, cell.env_id): cell for cell in done(merged)}
    for folder in (here, there):
        for cell in done(folder):
            twin = found.pop((cell.cell_id, cell.env_id))
            strip = [point.replaced(image=bool(point.image)) for point in cell.points]
            assert [point.replaced(image=bool(point.image)) for point in twin.points] == strip
    assert found == {}


def test_the_folder_stands_on_its_own(here, merged, tmp_path):
    copy = shutil.copytree(merged, tmp_path / "elsewhere" / "merged")
    results = load_results(copy)
    for cell in done(copy):
        assert results.reference(cell.reference_id) is not None
        assert all(results.image(point) is not None for point in cell.points if point.image)
    assert [source["folder"] for source in results.manifest.merged] == ["here", "there"]


def test_machines_share_no_panel_no_baseline_and_no_verdict(merged):
    analysis = analyse(load_results(merged))
    machines = [{v.contestant.settings.machine for v in panel.verdicts} for panel in panels(analysis)]
    assert machines == [{"env0"}, {"env1"}]
    for verdict in analysis.verdicts:
        if verdict.image_baseline is not None:
            assert verdict.image_baseline.settings.machine == verdict.contestant.settings.machine
    assert all(v.contestant.settings.machine in v.contestant.name for v in analysis.verdicts)


def test_report_and_shared_plots_carry_a_banner(commanded):
    out = commanded[1]
    text = (out / "report.html").read_text()
    assert "from 2 machines or library versions (env0; env1: Other 9000, 4 cores)" in text
    assert "must not be compared" in (out / "plots" / "targets-over-time.svg").read_text()
    alone = sorted(path.name for path in (out / "plots").glob("error-over-time-*.svg"))
    assert [name.rpartition("_")[2] for name in alone] == ["env0.svg", "env1.svg"]


def test_halves_of_one_run_become_one(here, tmp_path):
    halves = [
        changed(here, tmp_path / str(block), lambda event, block=block: event if event["block"] == block else None)
        for block in (0, 1)
    ]
    merge(halves, tmp_path / "out")
    ours, whole = ({c.settings: len(c.done) for c in load_results(f).contestants} for f in (tmp_path / "out", here))
    assert ours == whole


def test_the_same_folder_twice_counts_once(here, tmp_path):
    assert merge([here, here], tmp_path / "out") == {"env0": 10}


def test_different_conditions_on_one_machine_are_refused(here, tmp_path):
    other = changed(here, tmp_path / "other", lambda e: e | {"cell_id": e["cell_id"] + "x", "spec": {"max_spp": 9}})
    with pytest.raises(ConfigError, match=r"on one machine under different conditions \(max_spp\)"):
        merge([here, other], tmp_path / "out")


def test_different_metrics_are_refused(here, tmp_path):
    copy = shutil.copytree(here, tmp_path / "copy")
    text = (copy / "events.jsonl").read_text().replace('"metric": "relmse_e0.01"', '"metric": "mse"')
    (copy / "events.jsonl").write_text(text)
    with pytest.raises(ConfigError, match="cannot stand in one report"):
        merge([here, copy], tmp_path / "out")


def test_a_folder_that_holds_something_is_left_alone(here, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ConfigError, match="is not empty"):
        merge([here], tmp_path)


def test_the_command_merges_and_reports(commanded):
    done, out = commanded
    assert done.returncode == 0, done.stderr
    assert "10 measured cells of machine env0" in done.stdout and "must not be compared" in done.stdout
    assert "20 done" in raybench("status", out).stdout
    assert store.read_manifest(out).name
    refused = raybench("run", "quick", "--out", out)
    assert refused.returncode == 2 and "was merged by `raybench archive`" in refused.stderr
