"""Engines of others that break the contract: each fails in its own cell, with its reason, and the run goes on."""

import json
import math
import os

import numpy as np
import pytest
import wrong_engines

from engines.errors import RendererFailed
from engines.film import Film
from engines.processes import BadMessage
from harness import store
from harness.analysis import analyse, frames
from harness.config.settings import SceneFile
from harness.measure import films, messages, pool
from harness.measure.requests import ReferenceRequest
from harness.report.tables.verdicts import time_to_quality
from harness.store.results import load_results
from tests.harness import sweeping
from tests.harness.shared_references import SETTINGS

RIGHT = ("Steady", "Unsure", "Talkative")


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A run, by the command, of engines that are wrong in all ways and one that is right, with the report."""
    folder = tmp_path_factory.mktemp("wrong")
    names = ["fake_engines:Steady", *(f"wrong_engines:{name}" for name in (*wrong_engines.WORDS, *RIGHT[1:]))]
    text = sweeping.EXPERIMENT.replace("['fake_engines:Steady', 'fake_engines:Other']", f"{names}")
    path = sweeping.write(folder, text.replace("repeats: 2", "repeats: 1").replace("images: none", "images: all"))
    return sweeping.raybench("run", path, "--out", folder / "out", "--allow-imports", cwd=folder), folder / "out"


def events(folder):
    return {event.engine: event for event in store.latest_cells(store.read_events(folder)).values()}


def test_the_run_goes_to_its_end_and_says_so(swept):
    done, out = swept
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    states = [event.state for event in events(out).values()]
    assert states.count("failed") == len(wrong_engines.WORDS) and states.count("done") == len(RIGHT)
    assert (out / "report.html").is_file()


@pytest.mark.parametrize("name", wrong_engines.WORDS)
def test_a_wrong_engine_fails_its_cell_and_the_reason_is_clear(swept, name):
    event = events(swept[1])[getattr(wrong_engines, name).name]
    assert event.state == "failed" and wrong_engines.WORDS[name] in event.message


def test_an_engine_that_cannot_say_what_it_can_do_is_tried_and_that_is_said(swept):
    done, out = swept
    assert {events(out)[name].state for name in ("unsure", "talkative")} == {"done"}
    said = " ".join(done.stderr.split())
    assert "unsure: why_not failed: ZeroDivisionError: no tree" in said
    assert "talkative: why_not answered True: None or a sentence is expected" in said


def test_pixels_that_are_not_finite_are_counted_and_win_nothing(swept):
    _, out = swept
    found = events(out)
    assert [point.metrics["nonfinite"] for point in found["late_infinity"].points] == [0, 0, 0, 2]
    for name in ("not_a_number", "late_infinity", "too_bright"):
        assert found[name].points[-1].metrics["relmse_e0.01"] == math.inf
    ranked = {contestant.settings.engine for contestant in load_results(out).contestants if contestant.done}
    assert ranked == {"steady", "unsure", "talkative"}
    report = (out / "report.html").read_text()
    assert "2 of 96 pixels of the engine" in report and "late_infinity" in report


def test_what_is_not_finite_is_flagged_in_the_verdicts(tmp_path):
    text = sweeping.EXPERIMENT.replace("fake_engines:Other", "wrong_engines:NowAndThen")
    outcome, _ = sweeping.run(sweeping.write(tmp_path, text), tmp_path / "out")
    assert outcome.states == {"done": 3, "failed": 1}
    verdicts = {v.contestant.settings.engine: v for v in analyse(load_results(tmp_path / "out")).verdicts}
    assert {"nonfinite_pixels", "bad_samples"} <= set(verdicts["now_and_then"].flags)
    assert not {"nonfinite_pixels", "bad_samples"} & set(verdicts["steady"].flags)
    assert verdicts["now_and_then"].failures == 1


def test_samples_that_are_not_finite_are_flagged_in_every_table_though_no_pixel_shows_them(tmp_path):
    """The film counts them as black: the image is finite, every cell is done."""
    text = sweeping.EXPERIMENT.replace("fake_engines:Other", "fake_engines:Spotty")
    outcome, _ = sweeping.run(sweeping.write(tmp_path, text), tmp_path / "out")
    assert outcome.states == {"done": 4}
    analysis = analyse(load_results(tmp_path / "out"))
    verdicts = {v.contestant.settings.engine: v for v in analysis.verdicts}
    flags = {name: set(verdict.flags) - {"contended"} for name, verdict in verdicts.items()}  # the machine may be busy
    assert flags == {"spotty": {"bad_samples"}, "steady": set()}
    shown = frames.verdicts(analysis).frame
    assert shown[shown.engine == "spotty"]["flags"].str.contains("bad_samples").all()
    rows = {row["contestant"]: row["warnings"] for row in time_to_quality(analysis).rows}
    assert "bad samples" in rows["spotty"] and "bad samples" not in rows["steady"]


def test_checkpoints_before_the_failure_are_kept(swept):
    points = events(swept[1])["late_infinity"].points
    assert [(point.spp, bool(point.image)) for point in points] == [(1, True), (2, True), (4, True), (8, False)]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("NotANumber", "seed 9000: 1 pixels of the image are NaN or infinite: finite radiance is expected"),
        ("OtherSize", "(8, 12, 3) is expected"),
        ("Babbler", "where messages are sent"),
    ],
)
def test_a_reference_by_a_wrong_engine_fails_and_the_run_goes_on(tmp_path, name, words):
    path = sweeping.write(tmp_path)
    outcome, listener = sweeping.run(path, tmp_path / "out", [f"reference.engine=wrong_engines:{name}", "repeats=1"])
    assert outcome.states == {"failed": 2}
    assert "no reference: " in listener.notes[0] and words in listener.notes[0]


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"hello",
        b"[]",
        b"{}",
        b'{"type": 3}',
        b'{"type": ["end"]}',
        b'{"type": "dance"}',
        b"\xff\xfe",
        b"[" * 5000,
        b'{"type": "point", "spp": 1}',
        b'{"type": "point", "spp": true, "seconds": 1}',
        b'{"type": "point", "spp": 1, "seconds": Infinity}',
        b'{"type": "point", "spp": 1, "seconds": -1}',
        b'{"type": "point", "spp": 1, "seconds": 1, "rays": "many"}',
        b'{"type": "prepared", "load_seconds": 1}',
        b'{"type": "end", "counters": {"rays": NaN}, "machine": {}}',
        b'{"type": "end", "counters": {}, "machine": 3}',
        b'{"type": "failed", "message": 3}',
        b'{"type": "failed", "message": "no", "further": 1}',
    ],
)
def test_what_is_no_message_is_refused(line):
    with pytest.raises(BadMessage):
        messages.answer_of(line)


def test_text_of_a_message_can_always_be_written():
    message = messages.answer_of(b'{"type": "failed", "message": "caf\\udce9"}')
    assert json.dumps(message, ensure_ascii=False).encode()


def test_a_request_after_one_that_was_left_finds_a_fresh_process(tmp_path):
    request = ReferenceRequest(SceneFile("nowhere", "nowhere"), "", SETTINGS, 1, (1,), True)
    with pool.Pool(True, tmp_path / "log") as workers:
        worker = workers.worker("fake_engines:Steady")
        worker.ask(messages.Job("harness.measure.jobs:reference", request))
        assert workers.worker("fake_engines:Steady") is not worker and not worker.usable


def test_numbers_too_large_for_arithmetic_are_no_message():
    for line in (b'{"type": "point", "spp": 1, "seconds": 1%s}', b'{"type": "end", "counters": {"rays": 1%s}, "machine": {}}'):
        with pytest.raises(BadMessage, match="is expected") as refused:
            messages.answer_of(line % (b"0" * 400))
        assert len(str(refused.value)) < 400


@pytest.mark.parametrize("damage", ["an array", "a FIFO", "text", "a bomb", "an odd method"])
def test_a_film_that_was_tampered_with_is_an_engines_failure(tmp_path, damage):
    path = tmp_path / "film.npz"
    film = Film(2, 2)
    film.add(np.ones((4, 3)))
    films.leave(film, path, 2, 2, 1)
    assert films.take(path, 2, 2, 1).spp == 1
    if damage == "an array":
        with path.open("wb") as file:
            np.save(file, film.sums)
    elif damage == "a FIFO":
        path.unlink()
        os.mkfifo(path)
    elif damage == "text":
        path.write_text("a film")
    elif damage == "a bomb":
        np.savez_compressed(path, sums=np.zeros(1 << 22), counts=film.counts)
    else:
        content = bytearray(path.read_bytes())
        content[8] = content[content.index(b"PK\x01\x02") + 10] = 99
        path.write_bytes(content)
    with pytest.raises(RendererFailed, match="the worker's film cannot be read"):
        films.take(path, 2, 2, 1)
