"""Results folders from other people: what they name stays inside them, and what makes no sense is one line."""

import itertools
import json
import os
import re
import shutil

import numpy as np
import pytest

from engines.errors import ConfigError
from harness import store
from harness.analysis import calibration
from harness.store import confined
from harness.store.records import Run
from tests.harness import mutation, once, sweeping

SECRET = "not for others"


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    return once.built(tmp_path_factory, "tampered", mutation.write_whole)


@pytest.fixture
def theirs(whole, tmp_path):
    """A copy of it, beside which lies something that must not be read or written."""
    (tmp_path / "secret.exr").write_text(SECRET)
    (tmp_path / "private" / "deep").mkdir(parents=True)
    (tmp_path / "private" / "reference.json").write_text(SECRET)
    return shutil.copytree(whole, tmp_path / "theirs")


def tampered(folder, kind, change):
    """Changes the first event of a kind; its line."""
    events = [json.loads(line) for line in (folder / store.EVENTS).read_text().splitlines()]
    index = next(i for i, event in enumerate(events) if event["event"] == kind and event.get("points") != [])
    change(events[index])
    mutation.write_events(folder, events)
    return index + 1


def at(*way):
    """A change of what stands at the end of a way into an event."""

    def change(event, value):
        for key in way[:-1]:
            event = event[key]
        event[way[-1]] = value

    return change


def files_below(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}


OUT_OF_IT = ("../../..", "/etc/passwd", "../secret.exr", "a/../../secret.exr", "~/x", "", "a\x00b", "..", "a\\..\\b")


@pytest.mark.parametrize(
    ("kind", "way"),
    [
        ("reference", ("reference_id",)),
        ("reference", ("scene_hash",)),
        ("cell", ("cell_id",)),
        ("cell", ("reference_id",)),
        ("cell", ("points", 0, "image")),
    ],
    ids=str,
)
def test_ids_and_paths_that_lead_out_are_refused_with_line_and_field(theirs, whole, tmp_path, kind, way):
    """By every reader, each in its turn: all of them read the events by one function."""
    field = re.sub(r"\.(\d+)", r"[\1]", ".".join(map(str, way)))
    readers = itertools.islice(itertools.cycle(mutation.READERS), len(field) % len(mutation.READERS), None)
    for value, reader in zip(OUT_OF_IT, readers, strict=False):
        line = tampered(theirs, kind, lambda event, value=value: at(*way)(event, value))
        (tmp_path / "scratch").mkdir(exist_ok=True)
        with pytest.raises(ConfigError, match=rf"^\S*events\.jsonl:{line}: {re.escape(f'{kind}.{field}')} = ") as told:
            reader(theirs, whole, tmp_path / "scratch")
        assert "\n" not in str(told.value)


IMAGE_READERS = (mutation.merge, mutation.archive, mutation.rescore, mutation.report)


@pytest.mark.parametrize("reader", IMAGE_READERS, ids=lambda reader: reader.__name__)
def test_an_image_that_is_a_link_out_is_not_followed(theirs, whole, tmp_path, reader):
    for image in theirs.glob("images/*/*.exr"):
        image.unlink()
        image.symlink_to(tmp_path / "secret.exr")
    (tmp_path / "scratch").mkdir()
    with pytest.raises(ConfigError, match=r"events\.jsonl: image = 'images/.*leads out of "):
        reader(theirs, whole, tmp_path / "scratch")
    assert SECRET.encode() not in files_below(tmp_path / "scratch").values()


@pytest.mark.parametrize("reader", [mutation.merge, mutation.archive, mutation.rescore], ids=lambda reader: reader.__name__)
@pytest.mark.parametrize("what", ["film", "meta", "folder", "named"])
def test_a_reference_that_leads_out_is_not_followed(theirs, whole, tmp_path, reader, what):
    for meta in (theirs / "references").glob("*/*/reference.json"):
        told = json.loads(meta.read_text())
        if what == "named":
            meta.write_text(json.dumps({**told, "file": "../../../../secret.exr"}))
        elif what == "folder":
            shutil.rmtree(meta.parent)
            meta.parent.symlink_to(tmp_path / "private")
        else:
            link = meta if what == "meta" else meta.parent / told["file"]
            link.unlink()
            link.symlink_to(tmp_path / "secret.exr")
    (tmp_path / "scratch").mkdir()
    with pytest.raises(ConfigError, match=r"leads out of|file = '\.\./\.\./\.\./\.\./secret.exr'"):
        reader(theirs, whole, tmp_path / "scratch")
    assert SECRET.encode() not in files_below(tmp_path / "scratch").values()


@pytest.mark.parametrize("name", [store.LOCK, store.EVENTS, store.MANIFEST, "tables", "plots"])
def test_links_in_a_folder_are_not_written_through(theirs, tmp_path, name):
    place = theirs / name
    if place.is_dir():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)
    place.symlink_to(tmp_path / ("private" if name in ("tables", "plots") else "secret.exr"))
    before = files_below(tmp_path / "private") | {1: (tmp_path / "secret.exr").read_bytes()}
    done = sweeping.raybench("report", *["--rescore"] * (name not in ("tables", "plots")), theirs)
    assert done.returncode == 2 and "leads out of" in done.stderr and "Traceback" not in done.stderr
    assert files_below(tmp_path / "private") | {1: (tmp_path / "secret.exr").read_bytes()} == before


def test_a_report_that_is_a_link_is_replaced_not_followed(theirs, tmp_path):
    from harness.store.atomic import write_text

    (theirs / "report.html").symlink_to(tmp_path / "secret.exr")
    write_text(theirs / "report.html", "mine")
    assert (tmp_path / "secret.exr").read_text() == SECRET and (theirs / "report.html").read_text() == "mine"


def test_clearing_a_folder_removes_links_and_not_what_they_name(theirs, tmp_path):
    shutil.rmtree(theirs / "images")
    (theirs / "images").symlink_to(tmp_path / "private")
    store.clear(theirs)
    assert (tmp_path / "private" / "reference.json").read_text() == SECRET and not (theirs / "images").is_symlink()


@pytest.mark.parametrize("reader", [mutation.merge, mutation.archive], ids=lambda reader: reader.__name__)
def test_a_refused_merge_or_archive_leaves_nothing_behind(theirs, whole, tmp_path, reader):
    for film in theirs.glob("references/*/*/film-*"):
        film.unlink()
        film.symlink_to(tmp_path / "secret.exr")
    (tmp_path / "scratch").mkdir()
    with pytest.raises(ConfigError, match="leads out of"):
        reader(theirs, whole, tmp_path / "scratch")
    assert [path for path in (tmp_path / "scratch").rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    ("path", "fits"),
    [
        ("a", True),
        ("a/b.exr", True),
        ("a.b/..c", True),
        ("images/x/spp0004.exr", True),
        ("", False),
        (".", False),
        ("..", False),
        ("a/..", False),
        ("../a", False),
        ("/a", False),
        ("a//b", False),
        ("a/", False),
        ("a\nb", False),
        ("~", False),
        ("a\\b", False),
        ("x" * 1001, False),
    ],
)
def test_a_path_is_relative_and_plain(path, fits):
    assert confined.is_relative(path) is fits


def test_links_inside_the_folder_are_followed_and_loops_refused(tmp_path):
    (tmp_path / "in" / "b").mkdir(parents=True)
    os.symlink("b", tmp_path / "in" / "a")
    os.symlink("loop", tmp_path / "in" / "loop")
    assert confined.inside(tmp_path / "in", "a/x", "here").resolve() == (tmp_path / "in" / "b" / "x").resolve()
    os.symlink("..", tmp_path / "in" / "up")
    with pytest.raises(ConfigError, match=r"^here = 'up/x': leads out of "):
        confined.inside(tmp_path / "in", "up/x", "here")
    assert isinstance(_refusal(tmp_path / "in"), (ConfigError, type(None)))


def _refusal(folder):
    """A loop is refused by Python before 3.13 and stays inside after it; it is no traceback in either."""
    try:
        confined.inside(folder, "loop/x", "here")
    except ConfigError as error:
        return error
    return None


# --- types and versions ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("version", "words"),
    [
        (2, "results of format 2, and this raybench reads 3: an older raybench wrote it: measure again"),
        (4, "results of format 4, and this raybench reads 3: a newer raybench wrote it"),
        (None, "'raybench_results: 3' is expected"),
        ("3", "'raybench_results: 3' is expected"),
        (True, "is expected"),
    ],
)
def test_another_version_of_the_format_is_one_clear_line(theirs, whole, tmp_path, version, words):
    manifest = json.loads((theirs / store.MANIFEST).read_text()) | {"raybench_results": version}
    (theirs / store.MANIFEST).write_text(json.dumps(manifest))
    (tmp_path / "scratch").mkdir()
    for reader in mutation.READERS:
        with pytest.raises(ConfigError, match=re.escape(words)) as told:
            reader(theirs, whole, tmp_path / "scratch")
        assert str(told.value).startswith(str(theirs / store.MANIFEST)) and "\n" not in str(told.value)


@pytest.mark.parametrize("command", [["status"], ["report"], ["report", "--rescore"]], ids=" ".join)
def test_a_folder_of_the_first_format_ends_in_one_line(theirs, command):
    """Its version is said before anything in its events is found to be wrong."""
    manifest = json.loads((theirs / store.MANIFEST).read_text()) | {"raybench_results": 1, "examination_ids": []}
    (theirs / store.MANIFEST).write_text(json.dumps(manifest))
    with (theirs / store.EVENTS).open("a") as file:
        file.write('{"event": "conclusions", "bias": []}\n')
    done = sweeping.raybench(*command, theirs)
    said = "results of format 1, and this raybench reads 3: an older raybench wrote it: measure again"
    assert (done.returncode, done.stderr) == (2, f"raybench: {theirs / store.MANIFEST}: {said}\n")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('{"event": "start", "cell_id": 7}', r"start\.cell_id = 7: Input should be a valid string"),
        ('{"event": "later"}', "'later'.*does not match any of the expected tags"),
        ('{"event": "start"}', r"start\.cell_id: Field required"),
        ('{"event": "run", "x": ' + "[" * 100 + "]" * 100 + "}", "nested deeper than 64"),
        ('{"event": "run", "x": 99999999999999999999}', "an integer of more than 64 bits"),
        ('{"event": "run", "x": "\\ud800"}', "half of a surrogate pair"),
        ("[" * 100_000, "not an event"),
        ('{"event": ["start"]}', "expected tags|discriminator|string"),
        ("7", "not an event"),
        ("\ufeff{}", "not an event"),
    ],
)
def test_a_line_that_is_no_event_is_refused_with_its_number(tmp_path, line, words):
    good = json.dumps({"event": "start", "cell_id": "a", "of_later_versions": 1})
    (tmp_path / store.EVENTS).write_text(f"{good}\n{line}\n{good}\n")
    with pytest.raises(ConfigError, match=rf"^\S*events\.jsonl:2: .*({words})") as told:
        store.read_events(tmp_path)
    assert "\n" not in str(told.value) and len(str(told.value)) < 500


def test_what_a_run_writes_is_what_is_read(tmp_path):
    """The types are those of real events: of cells done, failed and skipped, with images and without."""
    text = sweeping.EXPERIMENT.replace("'fake_engines:Other'", "'fake_engines:Broken', 'fake_engines:Picky'")
    sweeping.run(sweeping.write(tmp_path, text.replace("images: none", "images: all")), tmp_path / "out")
    states = {getattr(event, "state", None) for event in store.read_events(tmp_path / "out")}
    assert {"done", "failed", "skipped"} <= states and store.read_manifest(tmp_path / "out").raybench_results == 3


@pytest.mark.parametrize("folder", ["baseline", "dissertation"])
def test_the_committed_results_are_read(folder):
    results = sweeping.ROOT / "results" / folder
    assert len(store.read_events(results)) > 150 and store.read_manifest(results).name


SEEDS = 20
"""Mutants of a part."""


@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_mutated_folders_end_in_success_or_one_line(whole, tmp_path, part, monkeypatch):
    """Whatever is changed in events or manifest: every reader answers, or refuses in a line. Calibrations are short."""
    calibrate = calibration.calibrate
    monkeypatch.setattr(calibration, "REPETITIONS", 10)
    monkeypatch.setattr(calibration, "calibrate", lambda analysis, repetitions=0: calibrate(analysis, 10))
    refused = answered = 0
    for seed in range(part * SEEDS, (part + 1) * SEEDS):
        for _, _, said in mutation.outcomes(whole, tmp_path, seed):
            assert "\n" not in said
            refused, answered = refused + bool(said), answered + (not said)
    assert refused > SEEDS // 2 and answered > SEEDS // 2, "both happen often"


def test_a_refusal_is_one_line_and_exit_code_2(theirs, tmp_path):
    line = tampered(theirs, "cell", lambda event: at("points", 0, "spp")(event, "many"))
    for words in (("report", theirs), ("archive", theirs, theirs, "--out", tmp_path / "m")):
        done = sweeping.raybench(*words)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, (words, done.stderr)
        assert done.stderr.startswith("raybench: ") and f"events.jsonl:{line}: cell.points[0].spp = 'many'" in done.stderr


@pytest.mark.parametrize("name", [store.EVENTS, store.MANIFEST, "reference.json"])
def test_a_pipe_in_the_place_of_a_file_is_refused_at_once(theirs, whole, tmp_path, name):
    path = next(theirs.glob("references/*/*/reference.json")) if name == "reference.json" else theirs / name
    path.unlink()
    os.mkfifo(path)
    done = sweeping.raybench("report", "--rescore", theirs)
    assert done.returncode == 2 and "raybench: " in done.stderr and "Traceback" not in done.stderr


def test_a_film_that_unpacks_to_more_than_its_size_is_refused(theirs, tmp_path):
    from harness.store import reference_files, validation

    folder = next(theirs.glob("references/*/*/reference.json")).parent
    meta = json.loads((folder / "reference.json").read_text())
    film = folder / meta["file"]
    with np.load(film) as arrays:
        held = dict(arrays)
    np.savez_compressed(film, **(held | {"squares": np.zeros((2000, 2000, 3))}))
    meta["sha256"] = reference_files.checksum(film)
    with pytest.raises(ConfigError, match=r"bytes unpacked, and a film of its size at most"):
        reference_files.film_in(folder, validation.reference_meta(meta, "reference.json"))


def test_what_an_engine_tells_never_makes_a_folder_unreadable(tmp_path, monkeypatch):
    """Figures that no reader takes are one failed cell each; the others stay, and so does what can be read."""
    from harness.run import recorder

    told = recorder.CellRecord._point

    def _point(self, answer, film, reference):
        told(self, answer._replace(seconds=-1.0) if self.cell.engine_name == "other" else answer, film, reference)

    monkeypatch.setattr(recorder.CellRecord, "_point", _point)
    outcome, _ = sweeping.run(sweeping.write(tmp_path), tmp_path / "out")
    assert outcome.states == {"done": 2, "failed": 2}
    messages = {event.message for _, event in outcome.failures}
    assert all("unusable: cell.points[0].seconds = -1.0: " in message for message in messages)
    assert len(store.latest_cells(store.read_events(tmp_path / "out"))) == 4


def test_a_message_that_is_no_unicode_can_be_stored_and_read(tmp_path):
    event = Run(time="", run_id="", command=("a\udcff",))
    with store.Events(tmp_path) as events:
        events.append(event)
    assert store.read_events(tmp_path) == [event] and event.command == ("a?",)
