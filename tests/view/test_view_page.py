"""The page with one image, in a headless Chromium: settings, frames, stop, camera, dragging, probe, and saved files."""

import base64
import time
from io import BytesIO

import numpy as np
import psutil
import pytest
from PIL import Image

import engines
from engines.image import read_film_layers, read_image, read_provenance
from engines.schema.yaml_file import parse_yaml
from tests.view.viewer_process import PIXELS, SCENE, Viewer

SAVED = "btoa(Array.from(new Uint8Array(raybench.saved.bytes), b => String.fromCharCode(b)).join(''))"
HANDLE = """(() => { const r = document.querySelector('.handle').getBoundingClientRect();
  return [r.x + r.width / 2, r.y + r.height / 2]; })()"""
REST = "['finished', 'stopped'].includes(raybench.state)"
ERROR = "document.getElementById('error')"
UNFOLD = "document.querySelectorAll('details').forEach((each) => { each.open = true; })"
VISIBLE = """Array.from(document.querySelectorAll('button:not(.handle), input, select'))
  .filter((each) => each.checkVisibility()).map((each) => each.id || each.name)"""


RESET = """(() => { raybench.settingsForm.reset('numpy'); raybench.input.choose('');
  const values = {scene: 'ball.yaml', width: '', height: '', 'target-spp': 2, seed: 1, mapper: 'srgb', exposure: 0};
  for (const [id, value] of Object.entries(values)) document.getElementById(id).value = value;
  document.getElementById('exposure').dispatchEvent(new Event('input'));
  raybench.opened = raybench.probe = raybench.yaml = null;
  raybench.status = {}; raybench.frame = {preview: true};
  document.getElementById('reset').click(); })()"""


@pytest.fixture(scope="module")
def visited(browser, viewer):
    browser.problems.clear()
    browser.open(viewer.address)
    browser.wait_for("window.raybench && raybench.settingsForm && raybench.opened")
    assert browser.evaluate(VISIBLE) == ["show-keys", "theme", "start", "stop", "restart", "scene", "engine"]
    browser.evaluate(UNFOLD)
    return browser


@pytest.fixture
def page(visited):
    """The page with its image finished, as it was at first but for two samples."""
    visited.evaluate(RESET)
    visited.wait_for("raybench.opened")
    finished(visited, 2)
    return visited


def finished(page, spp):
    page.wait_for(f"raybench.state === 'finished' && raybench.status.spp === {spp} && !raybench.frame.preview")


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


def test_the_image_is_refined_and_stop_ends_it_long_before_its_last_sample(page):
    page.set("#target-spp", 100000)
    page.wait_for("raybench.state === 'busy' && raybench.status.spp > 2")
    pictures = set()
    for _ in range(3):
        pictures.add(page.evaluate(PIXELS))
        page.wait_for(f"{PIXELS} !== {page.evaluate(PIXELS)}")
    assert len(pictures) == 3
    page.click("#stop")
    page.wait_for("raybench.state === 'stopped'")
    spp = page.evaluate("raybench.status.spp")
    assert 2 < spp < 10000
    assert page.evaluate("document.getElementById('state').textContent") == "stopped"
    time.sleep(0.3)
    assert page.evaluate("raybench.status.spp") == spp
    page.click("#start")  # which is now labelled "Continue"
    page.wait_for(f"raybench.state === 'busy' && raybench.status.spp > {spp}")
    page.click("#restart")
    page.wait_for(f"raybench.state === 'busy' && raybench.status.spp < {spp}")
    page.click("#stop")
    page.wait_for("raybench.state === 'stopped'")


def test_frames_keep_coming_during_a_render(page):
    page.set("#target-spp", 100000)
    page.wait_for("raybench.state === 'busy' && raybench.status.spp > 2")
    page.evaluate("""(() => { raybench.samples = []; const show = raybench.input.showHandles.bind(raybench.input);
        raybench.input.showHandles = (handles) => { raybench.samples.push(raybench.frame.spp); show(handles); }; })()""")
    page.wait_for("raybench.samples.length > 24")
    samples = page.evaluate("raybench.samples")
    assert (np.diff(samples) >= 0).all() and 2 < samples[0] < samples[-1] < 100000
    assert page.evaluate("raybench.state") == "busy"
    page.click("#stop")
    page.wait_for(REST)


def test_settings_are_chosen_from_what_the_engines_list(page):
    before = page.evaluate(PIXELS)
    page.set("#render-settings [name=shader]", "albedo")
    finished(page, 2)
    page.wait_for(f"{PIXELS} !== {before}")
    names = page.evaluate("Array.from(document.querySelectorAll('#render-settings [name=accelerator] option'), o => o.value)")
    assert {*engines.engine("numpy").accelerators()} <= {*names}
    page.set("#render-settings [name=sampler]", "halton")
    page.wait_for("document.querySelector('#render-settings [name=\"sampler.scramble\"]')")
    finished(page, 2)
    page.set("#width", 24)
    page.set("#height", 20)
    page.wait_for("document.getElementById('canvas').width === 24 && document.getElementById('canvas').height === 20")
    finished(page, 2)


def test_a_refusal_of_an_engine_is_an_error_message(page):
    page.set("#render-settings [name=precision]", "float32")
    page.wait_for(f"!{ERROR}.hidden")
    assert "float64 only" in page.evaluate(f"{ERROR}.textContent")
    page.wait_for(REST)
    page.drag(page.spot(0.1, 0.15), page.spot(0.2, 0.15))  # the image that was there can still be turned
    finished(page, 2)


def test_an_invalid_entry_is_a_message_and_keeps_the_image(page):
    before = page.evaluate(PIXELS)
    page.set("#width", 0)
    assert "greater than or equal to 1" in page.evaluate(f"{ERROR}.textContent")
    assert page.evaluate(PIXELS) == before and page.evaluate("raybench.state") == "finished"
    page.set("#width", 24)
    page.wait_for("document.getElementById('canvas').width === 24")
    finished(page, 2)
    assert page.evaluate(f"{ERROR}.hidden")


def test_options_are_remembered_and_a_choice_that_an_engine_lacks_is_announced_and_comes_back(page):
    page.set("#render-settings [name='shader.max_depth']", 3)
    page.set("#render-settings [name=shader]", "albedo")
    page.set("#render-settings [name=shader]", "path_tracer")
    assert page.evaluate("raybench.settingsForm.value().shader.max_depth") == 3
    finished(page, 2)
    engines_ = "raybench.menu.engines.find(engine => engine.name === 'numba').refusals.sampler"
    choose = (
        "(() => {{ const form = raybench.settingsForm; form.engine.value = '{}'; form.offer(); return ["
        "form.value().sampler.name, form.notice.textContent]; }})()"
    )
    page.evaluate(f"{engines_} = {{sobol: 'not this one'}}")
    name, notice = page.evaluate(choose.format("numba"))
    assert name != "sobol" and notice == f"numba has no sampler sobol: {name} is used."
    assert page.evaluate(choose.format("numpy")) == ["sobol", "numpy has the sampler sobol: it is used again."]
    page.evaluate(f"{engines_} = {{}}")


def test_the_error_map_compares_with_a_kept_image_of_the_same_view(page):
    page.press("e")
    assert "needs a reference" in page.evaluate(f"{ERROR}.textContent")
    page.click("#keep-reference")
    page.wait_for("raybench.frame.error === 0")
    assert "0.00" in page.evaluate("document.getElementById('scale').textContent")
    first = canvas(page)
    page.set("#seed", 2)
    page.wait_for("raybench.frame.error > 0 && raybench.state === 'finished'")
    assert first.max() < 10 < canvas(page).max()
    page.click("#toggle-histogram")
    assert page.evaluate("document.getElementById('histogram').getAttribute('aria-label')") == "error map: no histogram"
    page.evaluate("document.getElementById('canvas').focus()")
    page.press("ArrowLeft")
    page.wait_for("!raybench.reference.name && document.getElementById('show').value === 'image'")
    finished(page, 2)
    page.wait_for("raybench.shares.black < 1")
    page.click("#toggle-histogram")


def test_a_bad_scene_is_an_error_message_with_its_line(page):
    page.set("#scene", "bad.yaml")
    page.wait_for(f"!{ERROR}.hidden")
    words = page.evaluate(f"{ERROR}.textContent")
    assert "bad.yaml:5" in words and "kd" in words
    assert page.evaluate("raybench.state") == "finished"  # as the image is, which stays
    page.set("#scene", "../../etc/passwd")
    page.wait_for(f"/outside|leads out/.test({ERROR}.textContent)")
    page.set("#scene", "deep/other.yaml")
    page.wait_for("document.title.startsWith('another ball')")
    finished(page, 2)
    assert page.evaluate(f"{ERROR}.hidden")


def test_tone_mapper_and_exposure_change_the_picture_and_not_the_samples(page):
    before = canvas(page).mean()
    page.set("#exposure", 2)
    page.wait_for("raybench.frames > 0 && document.getElementById('exposure-value').textContent === '+2 EV'")
    page.until(lambda: canvas(page).mean() > before + 10)
    brighter = page.evaluate(PIXELS)
    page.set("#mapper", "aces")
    page.wait_for(f"{PIXELS} !== {brighter}")
    assert page.evaluate("raybench.status.spp") == 2


def test_a_drag_beside_objects_orbits_the_camera_in_previews_and_then_refines(page):
    eye = page.evaluate("raybench.input.orbit.eye")
    before, frames = page.evaluate(PIXELS), page.evaluate("raybench.frames")
    page.evaluate("""(() => { raybench.previews = 0; const ack = raybench.input.showHandles.bind(raybench.input);
        raybench.input.showHandles = (h) => { raybench.previews += raybench.frame.preview ? 1 : 0; ack(h); }; })()""")
    page.drag(page.spot(0.1, 0.15), page.spot(0.4, 0.15))
    page.wait_for("raybench.previews > 0")
    finished(page, 2)
    page.wait_for(f"{PIXELS} !== {before}")
    after = page.evaluate("raybench.input.orbit.eye")
    assert np.linalg.norm(np.subtract(after, [0, 1, 0])) == pytest.approx(5, abs=1e-9) and after != eye
    assert page.evaluate("raybench.frames") > frames + 1


def test_keys_orbit_pan_and_zoom(page):
    page.evaluate("document.getElementById('canvas').focus()")
    camera = "JSON.stringify([raybench.input.orbit.eye, raybench.input.orbit.target])"
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
    distance = page.evaluate("raybench.input.orbit.distance")
    for kind, apart in (("touchStart", 20), ("touchMove", 35), ("touchMove", 50), ("touchEnd", None)):
        fingers = {} if apart is None else {side + 1: (middle[0] + side * apart, middle[1]) for side in (-1, 1)}
        page.touch(kind, fingers)
    page.wait_for(f"raybench.input.orbit.distance < {distance} * 0.7")
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
    assert page.evaluate("raybench.input.orbit.eye") == [0, 1, 5]


def test_a_light_is_dragged_by_its_handle_and_by_keys(page):
    before = page.evaluate(PIXELS)
    start = page.evaluate(HANDLE)
    page.drag(start, (start[0] + 120, start[1] + 20))
    finished(page, 2)
    page.wait_for(f"{PIXELS} !== {before}")
    page.until(lambda: page.evaluate(HANDLE)[0] == pytest.approx(start[0] + 120, abs=3))
    page.evaluate("document.querySelector('.handle').focus()")
    page.press("ArrowLeft")
    page.wait_for(f"{HANDLE}[0] < {start[0] + 110}")
    finished(page, 2)


def test_the_probe_shows_value_variance_and_error(page, tmp_path):
    page.point(*page.spot(0.5, 0.8))
    page.wait_for("raybench.probe")
    probe = page.evaluate("raybench.probe")
    layers = read_film_layers(saved(page, "exr", tmp_path))
    at = probe["y"], probe["x"]
    assert probe["mean"] == pytest.approx(layers.mean[at], rel=1e-6)
    assert probe["variance"] == pytest.approx(layers.variance[at], rel=1e-4, abs=1e-12)
    assert probe["error"] == pytest.approx(np.sqrt(probe["variance"]), rel=1e-9)
    assert "standard error" in page.evaluate("document.getElementById('probe').textContent")
    assert page.evaluate("document.getElementById('probe').classList.contains('top')")  # it does not hide the probed pixel
    page.evaluate("document.getElementById('canvas').focus()")
    page.press("p")
    page.wait_for("raybench.probe.x === 24 && raybench.probe.y === 18")
    page.press("ArrowRight")
    page.wait_for("raybench.probe.x === 25")
    page.click("#restart")  # the probed image is replaced
    page.wait_for("document.getElementById('probe').hidden")


def test_images_are_saved_and_open_again(page, tmp_path):
    shown = canvas(page)
    png = saved(page, "png", tmp_path)
    assert np.abs(np.asarray(engines.image.read_bitmap(png)).astype(int) - shown).max() <= 1
    exr = saved(page, "exr", tmp_path)
    probe = read_provenance(exr)
    assert probe["engine"] == "numpy" and probe["spp"] == 2 and probe["camera"]["eye"] == [0, 1, 5]
    assert np.abs(engines.film.to_bitmap(read_image(exr)).astype(int) - shown).max() <= 1


def test_the_address_holds_settings_and_camera(browser, viewer):
    settings = {
        "scene": "deep/other.yaml",
        "engine": "numpy",
        "shader": "path_tracer",
        "shader.max_depth": 2,
        "width": 24,
        "height": 20,
        "spp": 3,
        "exposure": 1,
        "camera": "1,1,5,0,1,0,0,1,0",
    }
    browser.open(f"{viewer.address}#{'&'.join(f'{key}={value}' for key, value in settings.items())}")
    browser.wait_for("window.raybench && raybench.settingsForm && raybench.opened")
    finished(browser, 3)
    assert browser.evaluate("document.title").startswith("another ball") and canvas(browser).shape == (20, 24, 3)
    assert browser.evaluate("raybench.input.orbit.eye") == [1, 1, 5]
    browser.set("#seed", 7)
    finished(browser, 3)
    address = browser.evaluate("decodeURIComponent(location.hash)")
    assert all(f"{key}={value}" in address for key, value in {**settings, "seed": 7}.items())


def test_a_new_worker_displays_as_the_lost_one_and_has_no_reference(browser, folder):
    with Viewer(folder, "ball.yaml", "--engine", "numpy") as other:
        browser.open(f"{other.address}#scene=ball.yaml&spp=2&exposure=3")
        browser.wait_for("window.raybench && raybench.opened")
        finished(browser, 2)
        before = browser.evaluate(PIXELS)
        browser.evaluate(UNFOLD)
        browser.click("#keep-reference")
        browser.wait_for("raybench.frame.error === 0")
        workers = psutil.Process(other.pid).children()
        min(workers, key=lambda worker: worker.create_time()).kill()  # the younger one is in reserve
        browser.wait_for(f"{ERROR}.textContent.includes('killed')")
        browser.wait_for("document.getElementById('reference-state').textContent.includes('lost')")
        browser.click("#start")
        browser.wait_for("raybench.opened")
        finished(browser, 2)
        browser.wait_for(f"{PIXELS} === {before}")
        assert browser.evaluate("document.getElementById('show').value") == "image"


def test_once_the_server_has_ended_every_change_says_so(browser, folder):
    with Viewer(folder, "ball.yaml", "--engine", "numpy") as other:
        browser.open(f"{other.address}#scene=ball.yaml&spp=2")
        browser.wait_for("window.raybench && raybench.opened")
        finished(browser, 2)
    browser.wait_for(f"{ERROR}.textContent.includes('start raybench view again')")
    browser.click("#start")
    assert not browser.evaluate(f"{ERROR}.hidden")
    browser.set("#seed", 2)
    time.sleep(0.6)  # a preparation is shown after a quarter of a second
    assert not browser.evaluate(f"{ERROR}.hidden") and browser.evaluate("document.getElementById('busy').hidden")


def test_an_engine_that_is_not_available_is_announced(browser, viewer):
    browser.open(f"{viewer.address}#scene=ball.yaml&engine=open3d&spp=1")
    browser.wait_for("window.raybench && raybench.settingsForm")
    notice = browser.evaluate("raybench.settingsForm.notice.textContent")
    assert notice.startswith("open3d is not available: numpy is used.")


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
