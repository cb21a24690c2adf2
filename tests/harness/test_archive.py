"""An archive says what the results say, in a fraction of the bytes, and tells nothing about whose machine it was."""

import json
import platform
import shutil
from hashlib import sha256

import numpy as np
import pytest

from engines.errors import ConfigError
from engines.film import Film
from harness import store
from harness.analysis import analyse
from harness.measure import machine
from harness.report.archive import archive
from harness.report.html.assembly import report_html
from harness.report.tables import all_tables
from harness.report.tables.model import markdown_text
from harness.store import reference_files
from harness.store.events import line_of
from harness.store.records import ReferenceMeta, ReferenceSpec
from harness.store.results import load_results
from tests.harness import sweeping
from tests.harness.synthetic import Size, write_folder


def size_of(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    whole = write_folder(tmp_path_factory.mktemp("whole") / "results", Size(64, 64), threads=(1,))
    before, out = size_of(whole), tmp_path_factory.mktemp("archived") / "small"
    return whole, out, before, archive(whole, out)[0]


def page_of(folder):
    """The report without its plots, which take long to draw."""
    analysis = analyse(load_results(folder))
    return report_html(analysis, all_tables(analysis), [])


def test_it_is_much_smaller(folders):
    _, _, before, size = folders
    assert size < before / 4


def test_its_tables_say_the_same(folders):
    """To the digits that are kept: the tables for people show three. Deviations over seeds that hardly differ have fewer."""
    whole, out, *_ = folders
    tables = [all_tables(analyse(load_results(folder))) for folder in (whole, out)]
    for one, other in zip(*tables, strict=True):
        ours, theirs = (markdown_text(table).split() for table in (one, other))
        assert len(ours) == len(theirs)
        differing = [(a, b) for a, b in zip(ours, theirs, strict=True) if a != b]
        assert len(differing) <= (0.05 if ours[1:4] == ["Metrics", "over", "seeds"] else 0.02) * len(ours), differing[:5]


def test_its_report_has_pictures_references_and_verdicts_without_the_original(folders, tmp_path):
    whole, out, *_ = folders
    moved = whole.rename(whole.with_name("gone"))
    try:
        page = page_of(out)
    finally:
        moved.rename(whole)
    assert '"has_reference": true' in page and "image was not kept" in page and 'bad">different' in page


def test_made_again_it_is_the_same_and_an_archive_is_replaced(folders):
    whole, out, *_ = folders
    before = store.events_file(out).read_bytes()
    archive(whole, out)
    assert store.events_file(out).read_bytes() == before


def test_nothing_is_added_to_it(folders):
    with pytest.raises(ConfigError, match="is an archive, to which nothing is added"):
        store.Events(folders[1])


def test_compressed_events_that_are_damaged_or_too_large_are_refused_in_one_line(folders, tmp_path, monkeypatch):
    shutil.copytree(folders[1], tmp_path / "copy")
    packed = store.events_file(tmp_path / "copy")
    monkeypatch.setattr("harness.store.events.LARGEST", 1000)
    with pytest.raises(ConfigError, match=r"events.jsonl.gz: holds more than"):
        store.read_events(tmp_path / "copy")
    monkeypatch.undo()
    data = packed.read_bytes()
    for damaged in (data[:-40], data[:40] + b"?" * 40 + data[80:], b"no gzip"):
        packed.write_bytes(damaged)
        with pytest.raises(ConfigError, match=r"events.jsonl.gz: is damaged"):
            store.read_events(tmp_path / "copy")


def test_its_images_can_be_limited(folders, tmp_path):
    def images(folder):
        points = [point for cell in store.latest_cells(store.read_events(folder)).values() for point in cell.points]
        return [point.image for point in points if point.image]

    whole, out, *_ = folders
    archive(whole, tmp_path / "few", most_images=0)
    assert images(out) and not images(tmp_path / "few")
    assert page_of(tmp_path / "few")


def test_it_does_not_replace_a_readme_of_the_users(folders, tmp_path):
    (tmp_path / "README.md").write_text("my notes")
    done = sweeping.raybench("archive", folders[0], "--out", tmp_path)
    assert done.returncode == 2 and "has README.md already: --out must be a new folder, or an archive" in done.stderr
    assert (tmp_path / "README.md").read_text() == "my notes"
    assert {path.name for path in tmp_path.iterdir()} <= {"README.md", ".lock"}


def test_it_does_not_replace_results_that_are_no_archive(folders, tmp_path):
    whole = folders[0]
    other = write_folder(tmp_path / "other", threads=(1,), seeds=2, with_images=False)
    for target in (whole, other):
        (target / "references").rename(target / "kept")
        try:
            with pytest.raises(ConfigError, match="--out must be"):
                archive(whole, target)
        finally:
            (target / "kept").rename(target / "references")


def test_nothing_that_is_stored_names_the_machine_or_where_it_ran(tmp_path):
    path = sweeping.write(tmp_path, sweeping.EXPERIMENT.replace("repeats: 2", "repeats: 1"))
    sweeping.run(path, tmp_path / "out", command=["raybench", "run", str(path), f"--out={tmp_path}/out"])
    stored = (tmp_path / "out" / store.EVENTS).read_text() + (tmp_path / "out" / store.MANIFEST).read_text()
    assert not {"host", "executable"} & set(machine.provenance())
    assert str(sweeping.ROOT) not in stored
    archive(tmp_path / "out", tmp_path / "archived")
    for file in (tmp_path / "archived" / store.MANIFEST, *tmp_path.glob("archived/references/*/*/reference.json")):
        assert str(tmp_path) not in file.read_text()
    assert not any(str(tmp_path).encode() in line_of(event) for event in store.read_events(tmp_path / "archived"))
    command = store.read_manifest(tmp_path / "archived").command
    assert command == ("raybench", "run", path.name, "--out=out")
    assert platform.node() not in json.loads((tmp_path / "out" / store.MANIFEST).read_text())["machine"].values()


def test_a_reference_keeps_its_variance_in_an_archive(tmp_path):
    """Rounded squares less rounded squared means would be rounding alone: the variance is a hundred-thousandth of them."""
    rng, film = np.random.default_rng(1), Film(16, 12)
    for _ in range(8):
        film.add(1.0 + 0.003 * rng.normal(size=(12, 16, 3)))
    data = reference_files._small(film)
    (tmp_path / "film-0008.npz").write_bytes(data)
    spec = ReferenceSpec(replicates=8, replicate_spp=1, width=16, height=12)
    named = {"file": "film-0008.npz", "sha256": sha256(data).hexdigest(), "spec": spec}
    held = reference_files.film_in(tmp_path, ReferenceMeta.model_construct(**named))
    assert held.variance_of_mean() == pytest.approx(film.variance_of_mean(), rel=2.0**-6), "six bits"
    assert held.mean() == pytest.approx(film.mean(), rel=2.0**-11) and held.half(1) == pytest.approx(film.half(1), rel=2.0**-9)
