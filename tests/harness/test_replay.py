"""A replay says what was reproduced: images by their pixels and means, ratios by their intervals."""

import json
import shutil
from dataclasses import replace

import pytest

from engines.errors import ConfigError
from harness.analysis import analyse
from harness.cli.replay import experiment_of
from harness.report.archive import archive
from harness.report.supplement import UNSIGNED, Published, write_supplement
from harness.report.tables.reproduction import reproduction
from harness.store.results import load_results
from tests.harness import sweeping
from tests.harness.synthetic import write_folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    whole = write_folder(tmp_path_factory.mktemp("whole") / "results", seeds=3, threads=(1,))
    archived = tmp_path_factory.mktemp("archived") / "small"
    archive(whole, archived)
    return whole, archived


@pytest.fixture(scope="module")
def there(folders):
    return analyse(load_results(folders[1]))


BIASED = "flagged, so not ranked"


def changed(folder, target, change):
    """A copy in which `change` has changed each cell's event, or dropped it where it returns None."""
    shutil.copytree(folder, target)
    lines = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    kept = [change(event) if event["event"] == "cell" and event["state"] == "done" else event for event in lines]
    (target / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in kept if event))
    return analyse(load_results(target))


def rows(table, what, engine):
    return [row for row in table.rows if (row["what"] == "image") == (what == "image") and row["contestant"].startswith(engine)]


def test_the_same_measurements_are_reproduced_to_the_last_pixel(folders, there):
    found = reproduction(there, analyse(load_results(folders[0])))
    images = [row for row in found.rows if row["what"] == "image"]
    assert {row["verdict"] for row in images} == {"identical"}
    assert any("100 % of the pixels" in row["detail"] for row in images)
    assert {row["verdict"] for row in found.rows} == {"identical", "overlap", "not compared"}
    assert not any(row.get("reproduced") is False for row in found.rows)


def test_a_ratio_that_moved_beyond_its_interval_is_not_reproduced(folders, there, tmp_path):
    def slower(event):
        if event["engine"] == "embree":
            for point in event["points"]:
                point["seconds"] *= 3
        return event

    found = reproduction(there, changed(folders[0], tmp_path / "slower", slower))
    per_sample = [
        row
        for row in rows(found, "ratio", "embree")
        if row["what"] == "seconds per sample" and not row["detail"].startswith(BIASED)
    ]
    assert per_sample and all(row["verdict"] == "apart" and row["reproduced"] is False for row in per_sample)
    assert all(row["verdict"] == "identical" for row in rows(found, "image", "embree"))
    others = [row for row in rows(found, "ratio", "numba") if row["what"] == "seconds per sample"]
    assert others and all(row.get("reproduced") is not False for row in others)


def test_another_image_is_not_reproduced_and_one_up_to_noise_is(folders, there, tmp_path):
    """Without images on both sides, image means decide."""

    def moved(event):
        share = {"embree": 1.05, "numba": 1.0 + 1e-4 * event["block"]}.get(event["engine"], 1.0)
        for point in event["points"]:
            point["image"] = None
            for channel in "rgb":
                point["metrics"][f"mean_{channel}"] *= share
        return event

    found = reproduction(there, changed(folders[0], tmp_path / "moved", moved))
    assert {row["verdict"] for row in rows(found, "image", "embree")} == {"different"}
    assert {row["verdict"] for row in rows(found, "image", "numba")} == {"equivalent"}
    assert {row["verdict"] for row in rows(found, "image", "numpy")} == {"identical"}


def test_what_was_not_measured_again_is_not_reproduced(folders, there, tmp_path):
    found = reproduction(there, changed(folders[0], tmp_path / "less", lambda e: None if e["engine"] == "embree" else e))
    missing = rows(found, "image", "embree")
    assert missing and all(row["reproduced"] is False and row["verdict"] == "not compared" for row in missing)


def test_a_ratio_is_compared_by_the_settings_of_its_baseline_whatever_its_name(folders, there, tmp_path):
    """Without a second sampler names are shorter; another engine under the name of the baseline is another one."""
    random_alone = changed(folders[0], tmp_path / "one", lambda e: e if e["sampler"]["name"] == "random" else None)
    assert not {c.name for c in random_alone.results.contestants} & {c.name for c in there.results.contestants}
    again = [row for row in rows(reproduction(there, random_alone), "ratio", "numba") if "random" in row["contestant"]]
    assert any(row["verdict"] == "overlap" for row in again)

    def precise(event):
        event["precision"] = "float32" if event["engine"] == "numpy" else event["precision"]
        return event

    other = changed(folders[0], tmp_path / "other", precise)
    others = [row for row in rows(reproduction(there, other), "ratio", "numba") if not row["detail"].startswith(BIASED)]
    assert others and {row["verdict"] for row in others} == {"not compared"}


def test_an_archive_with_a_scene_of_its_own_is_replayed_elsewhere(tmp_path):
    path = sweeping.write(tmp_path / "mine", sweeping.EXPERIMENT.replace("images: none", "images: all"))
    sweeping.run(path, tmp_path / "out")
    published = Published(["Kajiya, James", "A Group"], "CC-BY-4.0")
    _, missing = archive(tmp_path / "out", tmp_path / "archived", published=published)
    assert missing == ["The code of fake_engines:Other, fake_engines:Steady is not here: put it beside experiment.yaml."]
    citation = (tmp_path / "archived" / "CITATION.cff").read_text()
    assert "family-names: Kajiya" in citation and "name: A Group" in citation and "license: CC-BY-4.0" in citation
    shutil.rmtree(tmp_path / "mine")
    done = sweeping.raybench("replay", "archived", "--allow-imports", "--all", cwd=tmp_path)
    assert done.returncode in (0, 1) and "2 of 2 images reproduced: 2 identical" in done.stdout, done.stdout + done.stderr
    assert (tmp_path / "results" / "archived-replay" / "report.html").exists()
    for name in ("README.md", "CITATION.cff", "experiment.yaml"):
        assert str(tmp_path) not in (tmp_path / "archived" / name).read_text()


def test_an_archive_says_that_it_lacks_a_program_and_its_description(there, tmp_path):
    config = there.results.manifest.config | {"include": [{"scene": "cornell_box", "engine": "mine.yaml"}]}
    manifest = there.results.manifest.replaced(config=config)
    missing = write_supplement(replace(there.results, manifest=manifest), manifest, tmp_path, UNSIGNED)
    assert "mine.yaml and the program that it calls are not here: put them beside experiment.yaml." in missing
    assert missing[-1] in (tmp_path / "README.md").read_text()


def test_a_citation_that_was_filled_in_stays_and_the_rest_is_made_anew(there, tmp_path):
    (tmp_path / "CITATION.cff").write_text("mine")
    (tmp_path / "README.md").write_text("old")
    write_supplement(there.results, there.results.manifest, tmp_path, UNSIGNED)
    assert (tmp_path / "CITATION.cff").read_text() == "mine"
    assert (tmp_path / "README.md").read_text().startswith("# Measurements of synthetic")


@pytest.mark.parametrize("published", [Published(licence="my own"), Published(authors=[" "])])
def test_what_cannot_be_published_is_refused(folders, tmp_path, published):
    with pytest.raises(ConfigError, match="expected"):
        archive(folders[0], tmp_path / "refused", published=published)


def test_a_merged_folder_is_no_experiment_to_replay(tmp_path):
    (tmp_path / "manifest.json").write_text(json.dumps({"raybench_results": 3, "merged": [{}]}))
    with pytest.raises(ConfigError, match="was merged"):
        experiment_of(tmp_path)
