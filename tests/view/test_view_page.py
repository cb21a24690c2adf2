"""The page with one image, in a headless Chromium: what is chosen, seen, stopped, turned, dragged, saved and opened again."""

import base64
import time
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import engines
from engines.image import read_film_layers, read_image, read_provenance
from engines.schema.yaml_file import parse_yaml
from tests.view.driving import PIXELS, SCENE

SAVED = "btoa(Array.from(new Uint8Array(raybench.saved.bytes), b => String.fromCharCode(b)).join(''))"
MARK = """(() => { const r = document.querySelector('.handle').getBoundingClientRect();
  return [r.x + r.width / 2, r.y + r.height / 2]; })()"""
REST = "['finished', 'stopped'].includes(raybench.state)"
PROBLEM = "document.getElementById('problem')"


RESET = """(() => { raybench.part.given = {shader: {name: 'path_tracer', max_depth: 6}, sampler: {name: 'sobol'},
    accelerator: {name: 'auto'}}; raybench.part.build('numpy'); raybench.hand.choose('');
  const values = {scene: 'ball.yaml', width: '', height: '', wanted: 2, seed: 1, mapper: 'srgb', exposure: 0};
  for (const [id, value] of Object.entries(values)) document.getElementById(id).value = value;
  document.getElementById('exposure').dispatchEvent(new Event('input'));
  raybench.opened = raybench.probe = raybench.yaml = null;
  raybench.told = {}; raybench.frame = {coarse: true};
  document.getElementById('reset').click(); })()"""


@pytest.fixture(scope="module")
def visited(browser, viewer):
    browser.problems.clear()
    browser.open(viewer.address)
    browser.wait_for("window.raybench && raybench.part && raybench.opened")
    return browser


@pytest.fixture
def page(visited):
    """The page with its image finished, as it was at first but for two samples."""
    visited.evaluate(RESET)
    visited.wait_for("raybench.opened")
    finished(visited, 2)
    return visited


def finished(page, spp):
    page.wait_for(f"raybench.state === 'finished' && raybench.told.spp === {spp} && !raybench.frame.coarse")


def canvas(page):
    """(h, w, 3) uint8."""
    data = page.evaluate("document.getElementById('canvas').toDataURL('image/png')").partition(",")[2]
    return np.asarray(Image.open(BytesIO(base64.b64decode(data))).convert("RGB"))


def red_column(page):
    """The column in the middle of what is red."""
    image = canvas(page).astype(int)
    return np.average(np.arange(image.shape[1]), weights=np.maximum(image[:, :, 0] - image[:, :, 1], 0).sum(axis=0))


def saved(page, kind, folder):
    """The file that the page saves."""
    page.evaluate("delete raybench.saved")
    page.click(f"#save-{kind}")
    page.wait_for("raybench.saved")
    path = folder / page.evaluate("raybench.saved.name")
    path.write_bytes(base64.b64decode(page.evaluate(SAVED)))
    return path


def test_it_opens_the_scene_without_errors_and_asks_this_server_alone(page, viewer):
    assert page.problems == []
    elsewhere = [url for url in page.requests if not url.startswith((viewer.address, "data:", "blob:", "file:", "chrome:"))]
    assert elsewhere == []
    assert page.evaluate("document.title") == "a ball and two lamps – raybench view"


def test_the_image_is_the_engines(page):
    settings = engines.Settings(shader={"name": "path_tracer", "max_depth": 6}, seed=1)
    scene = engines.scene_from(parse_yaml(SCENE).plain())
    film = engines.engine("numpy").prepare(scene, settings).render(2)
    assert np.abs(canvas(page).astype(int) - film.to_bitmap().astype(int)).max() <= 1


def test_the_image_is_refined_while_one_looks_and_a_stop_is_heard_long_before_its_end(page):
    page.set("#wanted", 100000)
    page.wait_for("raybench.state === 'busy' && raybench.told.spp > 2")
    pictures = set()
    for _ in range(3):
        pictures.add(page.evaluate(PIXELS))
        page.wait_for(f"{PIXELS} !== {page.evaluate(PIXELS)}")
    assert len(pictures) == 3
    page.click("#stop")
    page.wait_for("raybench.state === 'stopped'")
    spp = page.evaluate("raybench.told.spp")
    assert 2 < spp < 10000
    assert page.evaluate("document.getElementById('state').textContent") == "stopped"
    time.sleep(0.3)
    assert page.evaluate("raybench.told.spp") == spp
    page.click("#start")  # which now says "Go on"
    page.wait_for(f"raybench.state === 'busy' && raybench.told.spp > {spp}")
    page.click("#restart")
    page.wait_for(f"raybench.state === 'busy' && raybench.told.spp < {spp}")
    page.click("#stop")
    page.wait_for("raybench.state === 'stopped'")


def test_frames_come_at_least_every_fifth_of_a_second(page):
    page.set("#wanted", 100000)
    page.wait_for("raybench.state === 'busy' && raybench.told.spp > 2")
    page.evaluate("""(() => { raybench.times = []; const marks = raybench.hand.handles.bind(raybench.hand);
        raybench.hand.handles = (places) => { raybench.times.push(performance.now()); marks(places); }; })()""")
    page.wait_for("raybench.times.length > 24")
    assert np.quantile(np.diff(page.evaluate("raybench.times")), 0.25) < 200  # milliseconds; the machine may be busy
    page.click("#stop")
    page.wait_for(REST)


def test_parts_are_chosen_from_what_the_engines_list(page):
    before = page.evaluate(PIXELS)
    page.set("#part [name=shader]", "albedo")
    finished(page, 2)
    page.wait_for(f"{PIXELS} !== {before}")
    names = page.evaluate("Array.from(document.querySelectorAll('#part [name=accelerator] option'), o => o.value)")
    assert {*engines.engine("numpy").accelerators()} <= {*names}
    page.set("#part [name=sampler]", "halton")
    page.wait_for("document.querySelector('#part [name=\"sampler.scramble\"]')")
    finished(page, 2)
    page.set("#width", 24)
    page.set("#height", 20)
    page.wait_for("document.getElementById('canvas').width === 24 && document.getElementById('canvas').height === 20")
    finished(page, 2)


def test_what_an_engine_lacks_is_a_message_in_the_page(page):
    page.set("#part [name=precision]", "float32")
    page.wait_for(f"!{PROBLEM}.hidden")
    assert "float64 only" in page.evaluate(f"{PROBLEM}.textContent")
    page.wait_for(REST)
    page.drag(page.spot(0.1, 0.15), page.spot(0.2, 0.15))  # the image that was there can still be turned
    finished(page, 2)


def test_a_bad_scene_is_a_message_in_the_page_with_its_line(page):
    page.set("#scene", "bad.yaml")
    page.wait_for(f"!{PROBLEM}.hidden")
    words = page.evaluate(f"{PROBLEM}.textContent")
    assert "bad.yaml:5" in words and "kd" in words
    page.set("#scene", "../../etc/passwd")
    page.wait_for(f"/outside|leads out/.test({PROBLEM}.textContent)")
    page.set("#scene", "deep/other.yaml")
    page.wait_for("document.title.startsWith('another ball')")
    finished(page, 2)
    assert page.evaluate(f"{PROBLEM}.hidden")


def test_tone_mapper_and_exposure_change_the_picture_and_not_the_samples(page):
    before = canvas(page).mean()
    page.set("#exposure", 2)
    page.wait_for("raybench.frames > 0 && document.getElementById('exposure-told').textContent === '+2 EV'")
    page.until(lambda: canvas(page).mean() > before + 10)
    brighter = page.evaluate(PIXELS)
    page.set("#mapper", "aces")
    page.wait_for(f"{PIXELS} !== {brighter}")
    assert page.evaluate("raybench.told.spp") == 2


def test_a_drag_beside_things_turns_the_camera_coarsely_and_is_then_refined(page):
    eye = page.evaluate("raybench.hand.orbit.eye")
    before, frames = page.evaluate(PIXELS), page.evaluate("raybench.frames")
    page.evaluate("""(() => { raybench.coarse = 0; const ack = raybench.hand.handles.bind(raybench.hand);
        raybench.hand.handles = (h) => { raybench.coarse += raybench.frame.coarse ? 1 : 0; ack(h); }; })()""")
    page.drag(page.spot(0.1, 0.15), page.spot(0.4, 0.15))
    page.wait_for("raybench.coarse > 0")
    finished(page, 2)
    page.wait_for(f"{PIXELS} !== {before}")
    after = page.evaluate("raybench.hand.orbit.eye")
    assert np.linalg.norm(np.subtract(after, [0, 1, 0])) == pytest.approx(5, abs=1e-9) and after != eye
    assert page.evaluate("raybench.frames") > frames + 1


def test_keys_turn_shift_and_zoom(page):
    page.evaluate("document.getElementById('canvas').focus()")
    camera = "JSON.stringify([raybench.hand.orbit.eye, raybench.hand.orbit.target])"
    seen = [page.evaluate(camera)]
    for key in ("ArrowLeft", "ArrowUp", "Shift+ArrowRight"):
        page.press(key)
        seen.append(page.evaluate(camera))
    page.press("+")
    seen.append(page.evaluate(camera))
    assert len(set(seen)) == 5
    finished(page, 2)
    page.click("#reset")
    page.wait_for(f"{camera} === {seen[0]!r}")


def test_two_fingers_zoom(page):
    middle = page.spot(0.5, 0.1)
    distance = page.evaluate("raybench.hand.orbit.distance")
    for kind, apart in (("touchStart", 20), ("touchMove", 35), ("touchMove", 50), ("touchEnd", None)):
        fingers = {} if apart is None else {side + 1: (middle[0] + side * apart, middle[1]) for side in (-1, 1)}
        page.touch(kind, fingers)
    page.wait_for(f"raybench.hand.orbit.distance < {distance} * 0.7")
    finished(page, 2)


def test_a_sphere_is_dragged_and_the_scene_says_so(page):
    before = red_column(page)
    page.drag(page.spot(0.5, 0.55), page.spot(0.75, 0.55))
    page.until(lambda: red_column(page) > before + 6)
    finished(page, 2)
    page.click("#copy-yaml")
    page.wait_for("raybench.yaml")
    scene = engines.scene_from(parse_yaml(page.evaluate("raybench.yaml")).plain())
    center = np.array(scene.shapes[0].center)
    assert center[0] > 0.5 and center[1:] == pytest.approx([0.8, 0.0], abs=0.05)
    assert page.evaluate("raybench.hand.orbit.eye") == [0, 1, 5]


def test_a_light_is_dragged_by_its_mark_and_by_keys(page):
    before = page.evaluate(PIXELS)
    start = page.evaluate(MARK)
    page.drag(start, (start[0] + 120, start[1] + 20))
    finished(page, 2)
    page.wait_for(f"{PIXELS} !== {before}")
    page.until(lambda: page.evaluate(MARK)[0] == pytest.approx(start[0] + 120, abs=3))
    page.evaluate("document.querySelector('.handle').focus()")
    page.press("ArrowLeft")
    page.wait_for(f"{MARK}[0] < {start[0] + 110}")
    finished(page, 2)


def test_a_pixel_tells_value_variance_and_error(page, tmp_path):
    page.point(*page.spot(0.5, 0.8))
    page.wait_for("raybench.probe")
    told = page.evaluate("raybench.probe")
    layers = read_film_layers(saved(page, "exr", tmp_path))
    at = told["y"], told["x"]
    assert told["mean"] == pytest.approx(layers.mean[at], rel=1e-6)
    assert told["variance"] == pytest.approx(layers.variance[at], rel=1e-4, abs=1e-12)
    assert told["error"] == pytest.approx(np.sqrt(told["variance"]), rel=1e-9)
    assert "standard error" in page.evaluate("document.getElementById('probe').textContent")
    page.evaluate("document.getElementById('canvas').focus()")
    page.press("p")
    page.wait_for("raybench.probe.x === 24 && raybench.probe.y === 18")
    page.press("ArrowRight")
    page.wait_for("raybench.probe.x === 25")
    page.click("#restart")  # what was told of is no more
    page.wait_for("document.getElementById('probe').textContent.startsWith('Point')")


def test_images_are_saved_and_open_again(page, tmp_path):
    shown = canvas(page)
    png = saved(page, "png", tmp_path)
    assert np.abs(np.asarray(engines.image.read_bitmap(png)).astype(int) - shown).max() <= 1
    exr = saved(page, "exr", tmp_path)
    told = read_provenance(exr)
    assert told["engine"] == "numpy" and told["spp"] == 2 and told["camera"]["eye"] == [0, 1, 5]
    assert np.abs(engines.film.to_bitmap(read_image(exr)).astype(int) - shown).max() <= 1


@pytest.mark.parametrize("name", ["view.html", "race.html", "dahlquist.html"])
def test_pages_fit_from_360_to_2560_pixels_dark_and_light_and_all_controls_have_names(browser, viewer, name):
    browser.open(viewer.address + name)
    browser.wait_for("window.raybench && raybench.menu")
    for width, dark in ((360, True), (700, False), (2560, False)):
        browser.window(width, 900, dark)
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        colour = browser.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (colour == "rgb(255, 255, 255)") != dark
    unnamed = browser.evaluate("""Array.from(document.querySelectorAll('button, input, select, canvas, progress'))
        .filter(e => !(e.textContent.trim() && e.tagName === 'BUTTON' || e.getAttribute('aria-label') || e.labels?.length))
        .map(e => e.outerHTML)""")
    assert unnamed == []
    assert browser.evaluate("document.querySelectorAll('[role=status]').length") >= 1
