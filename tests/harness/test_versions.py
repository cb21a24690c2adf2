"""The same engine from two environments is two contestants, identified by what is installed there."""

import json
import shutil

import pytest

from engines.errors import ConfigError
from harness import config
from harness.analysis import analyse
from harness.plan import planner
from harness.store.results import load_results
from tests.harness import sweeping
from tests.isolated.environments import environment

ENGINE = "tests.isolated.renderers:Lantern"
HEAD = sweeping.EXPERIMENT.replace("matrix: {engine: ['fake_engines:Steady', 'fake_engines:Other']}\n", "")
HEAD = HEAD.replace("images: none", "images: last")


def experiment(folder, *pythons, text=""):
    listed = ", ".join(f"{{name: '{ENGINE}', python: {python}}}" for python in pythons)
    return sweeping.write(folder, f"{HEAD}matrix: {{engine: [{listed}]}}\n{text}")


def planned(path):
    return planner.make(config.load(path), allow_imports=True, allow_commands=True)


def identities(path):
    return {
        cell.engine_name: {each.cell_id for each in planned(path).cells if each.engine_name == cell.engine_name}
        for cell in planned(path).cells
    }


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """A folder with an environment of version 1.0, and one of 2.0, which is slower and darker."""
    folder = tmp_path_factory.mktemp("two")
    environment(folder / "old", "1.0")
    environment(folder / "new", "2.0", SECONDS=0.01, RADIANCE=0.8)
    return folder


def test_two_versions_race_under_their_names_and_the_slower_and_darker_one_is_seen(two, tmp_path, monkeypatch):
    monkeypatch.setenv("NEW_LANTERN", str(two / "new"))
    shutil.copytree(two / "old", two / "experiments" / "old", symlinks=True)
    path = experiment(two / "experiments", "old", "$NEW_LANTERN")
    outcome, _ = sweeping.run_plan(planned(path), tmp_path / "out")
    assert outcome.failures == []
    events = [json.loads(line) for line in (tmp_path / "out" / "events.jsonl").read_text().splitlines()]
    cells = [event for event in events if event["event"] == "cell" and event["label"] is None]
    assert {(cell["engine"], cell["engine_version"]) for cell in cells} == {("lantern 1.0", "4+1.0"), ("lantern 2.0", "4+2.0")}
    assert {cell["spec"]["environment"]["lantern"] for cell in cells} == {"1.0", "2.0"}
    found = analyse(load_results(tmp_path / "out")).verdicts
    verdicts = {v.contestant.settings.engine: v for v in found if not v.contestant.settings.label}
    assert verdicts["lantern 2.0"].samples_per_second.value < verdicts["lantern 1.0"].samples_per_second.value
    assert {name: "biased_image" in verdict.flags for name, verdict in verdicts.items()} == {
        "lantern 1.0": False,
        "lantern 2.0": True,
    }


def test_what_is_installed_is_part_of_a_cell_and_where_it_lies_is_not(two, tmp_path):
    before = identities(experiment(tmp_path, two / "old"))
    environment(tmp_path / "elsewhere", "1.0")
    assert identities(experiment(tmp_path, tmp_path / "elsewhere")) == before
    environment(tmp_path / "patched", "1.0", NOISE=0.2)
    patched = identities(experiment(tmp_path, tmp_path / "patched"))
    assert patched.keys() == before.keys() and patched != before


def test_two_builds_of_one_version_are_called_by_their_folders(two, tmp_path):
    environment(tmp_path / "patched", "1.0", NOISE=0.2)
    found = {cell.engine_name for cell in planned(experiment(tmp_path, two / "old", "patched/bin/python")).cells}
    assert found == {"lantern 1.0 (old)", "lantern 1.0 (patched)"}


def test_a_filter_finds_an_engine_by_its_name_alone(two, tmp_path):
    path = experiment(tmp_path, two / "old", text=f"extend: [{{where: {{engine: '{ENGINE}'}}, set: {{threads: 3}}}}]\n")
    assert {cell.settings.threads for cell in planned(path).cells} == {3}


def test_the_command_of_a_cell_names_the_environment(two, tmp_path, monkeypatch):
    monkeypatch.chdir(two)
    (command, *_) = {cell.command(1) for cell in planned(experiment(tmp_path, two / "old")).cells}
    assert f"--engine {ENGINE}@old " in command and command.endswith("--allow-commands --allow-imports")


@pytest.mark.parametrize(
    ("python", "message"),
    [
        ("$NO_SUCH_LANTERN", r":\d+ matrix.engine\[0\].python = '\$NO_SUCH_LANTERN': the variable is not set: the folder"),
        ("nowhere", r"small.yaml:\d+ matrix.engine\[0\].python = 'nowhere': .*nowhere: does not exist: the folder of a"),
        (".", r"\.python = '\.': .*: there is no bin/python in it"),
        ("3", r"\.python"),
    ],
)
def test_a_python_that_is_none_is_refused_with_its_line(tmp_path, python, message):
    with pytest.raises(ConfigError, match=message):
        config.load(experiment(tmp_path, python))


def test_a_python_is_run_only_where_that_is_allowed(two, tmp_path):
    made = config.load(experiment(tmp_path, two / "old"))
    with pytest.raises(ConfigError, match="names a program to be run; run with --allow-commands if you trust it"):
        planner.make(made, allow_imports=True)


def test_a_command_with_a_bad_python_ends_with_one_line(tmp_path):
    done = sweeping.raybench("render", "cornell_box", "--engine", f"numpy@{tmp_path}/none", "--allow-commands", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1) and "none: does not exist" in done.stderr
