"""The page of Dahlquist's program: animation, switches, dragged spheres."""

import time

import pytest

from tests.view.viewer_process import PIXELS


@pytest.fixture(scope="module")
def demo(browser, viewer):
    browser.problems.clear()
    browser.open(viewer.address + "dahlquist.html", height=1200)
    browser.wait_for("window.raybench && raybench.menu")
    for name, value in {"engine": "numpy", "width": 64, "height": 64}.items():
        browser.set(f"#{name}", value)
    browser.wait_for("document.getElementById('canvas').width === 64 && raybench.status.frame_seconds")
    return browser


def test_it_moves_and_shows_its_rates_beside_those_of_the_original(demo):
    before = demo.evaluate(PIXELS)
    demo.wait_for(f"{PIXELS} !== {before}")
    assert demo.evaluate("raybench.status.rays_per_second") > 0
    rows = demo.evaluate("Array.from(document.querySelectorAll('#figures tr'), row => row.textContent)")
    assert len(rows) == 5 and rows[0].startswith("here, 64x64") and "33.4 M" in rows[1]


def test_speed_zero_stands_still_and_switches_change_the_picture(demo):
    demo.set("#interlaced", True)
    demo.wait_for("raybench.status.calls_per_frame === 2")  # the table compares whole frames
    assert "two interlaced calls" in demo.evaluate("document.getElementById('own-name').textContent")
    demo.set("#interlaced", False)
    demo.set("#speed", 0)
    time.sleep(1.5)  # the spheres follow with a delay
    pause = "await new Promise(done => setTimeout(done, 300))"
    demo.wait_for(f"(async () => {{ const before = {PIXELS}; {pause}; return before === {PIXELS}; }})()")
    still = demo.evaluate(PIXELS)
    for switch in ("reflections", "environment"):
        demo.set(f"#{switch}", False)
        demo.wait_for(f"{PIXELS} !== {still}")
        still = demo.evaluate(PIXELS)


def test_a_sphere_is_dragged_by_the_mouse_and_by_keys(demo):
    demo.evaluate("raybench.touchedSpheres.length = 0")
    demo.evaluate("document.getElementById('canvas').focus()")
    demo.press("1")
    demo.wait_for("raybench.held && raybench.held.sphere === 0")
    place = demo.evaluate("[raybench.held.x / 64, raybench.held.y / 64]")
    before = demo.evaluate(PIXELS)
    demo.press("ArrowRight")
    demo.wait_for(f"{PIXELS} !== {before}")
    demo.press("Escape")
    demo.drag(demo.spot(*place), demo.spot(place[0] + 0.2, place[1]))
    demo.wait_for("raybench.touchedSpheres.length === 1 && raybench.touchedSpheres[0] >= 0")
    demo.click("#stop")
    demo.wait_for("raybench.state === 'stopped'")
    assert demo.problems == []
