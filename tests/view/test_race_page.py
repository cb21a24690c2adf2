"""The page with a race: it reaches a target, is saved as results, and opens as a report."""

import json

import pytest

from harness.store import read_events
from harness.store.results import load_results

CONTESTANTS = """raybench.contestants.map(({seconds, points, crossings, frames, name}) =>
    ({seconds, points, crossings, frames, name}))"""
ERROR = "document.getElementById('error')"


@pytest.fixture(scope="module")
def raced(browser, viewer):
    """The page after a race of two contestants to an error of 0.5, which a sample or two reach."""
    browser.problems.clear()
    browser.open(viewer.address + "race.html")
    browser.wait_for("window.raybench && raybench.settingsForms.length === 2")
    for contestant, sampler in enumerate(("sobol", "random")):
        place = f"#settings-forms > div:nth-child({contestant + 1})"
        browser.set(f"{place} [name=engine]", "numpy")
        browser.set(f"{place} [name=sampler]", sampler)
        browser.set(f"{place} [name='shader.max_depth']", 2)
    settings = {
        "width": 16,
        "height": 12,
        "targets": "0.5 1e-7",
        "reference-spp": 32,
        "max-seconds": 1,
        "slice": 0.2,
        "reference-engine": "numpy",
    }
    for name, value in settings.items():
        browser.set(f"#{name}", value)
    browser.click("#start")
    browser.wait_for("raybench.state === 'finished'")
    return browser


def test_contestants_use_their_budget_and_reach_the_target_that_they_can_reach(raced):
    contestants = raced.evaluate(CONTESTANTS)
    assert [contestant["name"] for contestant in contestants] == ["numpy sobol", "numpy random"]
    assert all(contestant["seconds"] >= 1.0 and contestant["frames"] >= 3 for contestant in contestants)  # the budget
    for contestant in contestants:
        states = {crossing["target"]: crossing["state"] for crossing in contestant["crossings"]}
        assert states[0.5] in ("reached", "at_first") and states[1e-7] == "censored"
        assert contestant["points"][-1][1] < contestant["points"][0][1]
    text = raced.evaluate("document.querySelector('.contestant').textContent")
    assert "✓ target 0.5" in text and "not reached" in text
    warning = raced.evaluate("document.getElementById('warnings').textContent")
    assert "too few samples" in warning and "1e-07" in warning


def test_a_target_is_undecided_for_all_where_the_reference_s_noise_reaches_the_error_of_one(raced):
    script = """(() => { const [first, second] = raybench.contestants;
        const crossings = first.crossings;
        first.crossings = [{target: 0.5, seconds: 1, state: "reached", reliable: false}];
        raybench.show();
        const texts = [first.list.textContent, second.list.textContent];
        const marks = document.querySelectorAll("#plot path[stroke-width='2.5']").length;
        first.crossings = crossings;
        raybench.show();
        return [texts, marks, document.querySelectorAll("#plot path[stroke-width='2.5']").length]; })()"""
    texts, marks, marks_if_decided = raced.evaluate(script)
    assert marks == 0 and marks_if_decided in (0, 2)  # the plot names no winner, either
    for text in texts:
        assert "✓" not in text and "target 0.5: undecided, the reference is too noisy" in text


def test_the_contestant_that_renders_is_marked(raced):
    script = """[0, 1].map(racing => { raybench.showState({state: "busy", activity: "", racing});
        return raybench.contestants.findIndex(contestant => contestant.box.classList.contains("running")); })"""
    assert raced.evaluate(script) == [0, 1]
    raced.evaluate("raybench.showState({state: 'finished', activity: ''})")
    assert raced.evaluate("document.querySelectorAll('.running').length") == 0


def test_images_error_maps_and_plot_are_drawn(raced):
    script = """Array.from(document.querySelectorAll('.contestant canvas'), c => {
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; return new Set(d).size; })"""
    assert min(raced.evaluate(script)) > 5
    assert raced.evaluate("document.querySelectorAll('#plot .target').length") == 2
    assert "numpy random: error" in raced.evaluate("document.getElementById('plot').getAttribute('aria-label')")
    assert "one after the other" in raced.evaluate("document.querySelector('main p').textContent")
    assert raced.problems == []


def test_it_is_saved_as_results_and_opens_as_a_report(raced, viewer, folder):
    raced.set("#name", "../derby")
    raced.click("#save")
    raced.wait_for(f"{ERROR}.textContent.includes('letters, digits')")
    raced.set("#name", "derby")
    raced.click("#save")
    raced.wait_for("raybench.saved")
    results = load_results(folder / "results/derby")
    shown = raced.evaluate("raybench.contestants.map(contestant => contestant.points)")
    assert [len(c.done) for c in results.contestants] == [1, 1] and results.targets == [0.5, 1e-7]
    recorded = {str(c.settings.sampler): c.done[0].points for c in results.contestants}
    for points, sampler in zip(shown, ("sobol(scramble=owen)", "random"), strict=True):
        assert [point[2] for point in points] == [point.spp for point in recorded[sampler]]
        assert [point[0] for point in points] == pytest.approx([point.seconds for point in recorded[sampler]])
    images = [point.image for points in recorded.values() for point in points if point.image]
    assert len(images) >= 4 and all((folder / "results/derby" / image).is_file() for image in images)
    assert not list((folder / "results").glob(".race-*"))
    (reference,) = [event for event in read_events(folder / "results/derby") if event.event == "reference"]
    assert results.reference(reference.reference_id) is not None
    raced.open(viewer.address + "reports/derby/report.html")
    raced.wait_for("document.getElementById('viewer-canvas').dataset.ready")
    assert "derby" in raced.evaluate("location.href")
    assert raced.evaluate("document.querySelectorAll('.small-plot svg').length") > 0


def test_a_request_that_cannot_be_raced_is_an_error_message(browser, viewer):
    browser.open(viewer.address + "race.html")
    browser.wait_for("window.raybench && raybench.settingsForms.length === 2")
    for contestant in (1, 2):
        browser.set(f"#settings-forms > div:nth-child({contestant}) [name=engine]", "numpy")
        browser.set(f"#settings-forms > div:nth-child({contestant}) [name=sampler]", "sobol")
    browser.set("#reference-engine", "numpy")
    browser.click("#start")
    browser.wait_for(f"{ERROR}.textContent.includes('same settings')")
    browser.set("#targets", "none")
    browser.click("#start")
    browser.wait_for(f"{ERROR}.textContent.includes('above zero')")
    place = browser.evaluate(f"(() => {{ const box = {ERROR}.getBoundingClientRect(); return [box.top, box.bottom]; }})()")
    assert 0 < place[0] < place[1] < 900  # in the window, beside the button
    browser.set("#width", 2)
    browser.click("#start")
    assert "Width: " in browser.evaluate(f"{ERROR}.textContent")
    assert json.loads(browser.evaluate("JSON.stringify(raybench.state)")) == "stopped"
