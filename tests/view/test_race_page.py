"""The page with a race: to a target, saved as results, and opened as a report."""

import json

import pytest

from harness.results import load_results
from harness.store import read_events

LANES = """raybench.lanes.map(({seconds, points, crossings, frames, name}) =>
    ({seconds, points, crossings, frames, name}))"""
PROBLEM = "document.getElementById('problem')"


@pytest.fixture(scope="module")
def raced(browser, viewer):
    """The page after a race of two lanes to an error of 0.5, which a sample or two reach."""
    browser.problems.clear()
    browser.open(viewer.address + "race.html")
    browser.wait_for("window.raybench && raybench.parts.length === 2")
    for lane, sampler in enumerate(("sobol", "random")):
        place = f"#parts > div:nth-child({lane + 1})"
        browser.set(f"{place} [name=engine]", "numpy")
        browser.set(f"{place} [name=sampler]", sampler)
        browser.set(f"{place} [name='shader.max_depth']", 2)
    settings = {"width": 16, "height": 12, "targets": "0.5 1e-7", "reference-spp": 32, "max-seconds": 1, "slice": 0.2,
                "reference-engine": "numpy"}  # fmt: skip
    for name, value in settings.items():
        browser.set(f"#{name}", value)
    browser.click("#start")
    browser.wait_for("raybench.state === 'finished'")
    return browser


def test_lanes_have_had_equal_time_and_reached_what_they_could(raced):
    lanes = raced.evaluate(LANES)
    assert [lane["name"] for lane in lanes] == ["numpy sobol", "numpy random"]
    assert all(1.0 <= lane["seconds"] < 20 and lane["frames"] >= 3 for lane in lanes)  # hours, were it for the targets
    for lane in lanes:
        states = {crossing["target"]: crossing["state"] for crossing in lane["crossings"]}
        assert states[0.5] in ("reached", "at_first") and states[1e-7] == "censored"
        assert lane["points"][-1][1] < lane["points"][0][1]
    words = raced.evaluate("document.querySelector('.lane').textContent")
    assert "✓ target 0.5" in words and "not reached" in words


def test_pictures_error_maps_and_plot_are_drawn(raced):
    script = """Array.from(document.querySelectorAll('.lane canvas'), c => {
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; return new Set(d).size; })"""
    assert min(raced.evaluate(script)) > 5
    assert raced.evaluate("document.querySelectorAll('#plot .target').length") == 2
    assert "numpy random: error" in raced.evaluate("document.getElementById('plot').getAttribute('aria-label')")
    assert "one after the other" in raced.evaluate("document.querySelector('main p').textContent")
    assert raced.problems == []


def test_it_is_saved_as_results_and_opens_as_a_report(raced, viewer, folder):
    raced.set("#name", "derby")
    raced.click("#save")
    raced.wait_for("raybench.saved")
    results = load_results(folder / "results/derby")
    shown = raced.evaluate("raybench.lanes.map(lane => lane.points)")
    assert [len(c.done) for c in results.contenders] == [1, 1] and results.targets == [0.5, 1e-7]
    recorded = {c.settings.sampler: c.done[0]["points"] for c in results.contenders}
    for points, sampler in zip(shown, ("sobol(scramble=owen)", "random"), strict=True):
        assert [point[2] for point in points] == [point["spp"] for point in recorded[sampler]]
        assert [point[0] for point in points] == pytest.approx([point["seconds"] for point in recorded[sampler]])
    images = [point["image"] for points in recorded.values() for point in points if point["image"]]
    assert len(images) >= 4 and all((folder / "results/derby" / image).is_file() for image in images)
    assert not list((folder / "results").glob(".race-*"))
    (reference,) = [event for event in read_events(folder / "results/derby") if event["event"] == "reference"]
    assert results.reference(reference["reference_id"]) is not None
    raced.open(viewer.address + "reports/derby/report.html")
    raced.wait_for("document.getElementById('viewer-canvas').dataset.ready")
    assert "derby" in raced.evaluate("location.href") and raced.evaluate("document.querySelectorAll('.plot svg').length") > 3


def test_what_cannot_be_raced_is_a_message(browser, viewer):
    browser.open(viewer.address + "race.html")
    browser.wait_for("window.raybench && raybench.parts.length === 2")
    for lane in (1, 2):
        browser.set(f"#parts > div:nth-child({lane}) [name=engine]", "numpy")
        browser.set(f"#parts > div:nth-child({lane}) [name=sampler]", "sobol")
    browser.set("#reference-engine", "numpy")
    browser.click("#start")
    browser.wait_for(f"{PROBLEM}.textContent.includes('same settings')")
    browser.set("#targets", "none")
    browser.click("#start")
    browser.wait_for(f"{PROBLEM}.textContent.includes('above zero')")
    assert json.loads(browser.evaluate("JSON.stringify(raybench.state)")) == "stopped"
