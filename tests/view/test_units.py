"""The modules that need neither server nor browser: projection, dragging, scene files, requests, the queue, messages."""

import math

import numpy as np
import pytest

import engines
from engines.errors import ConfigError, Unsupported
from engines.scene import Orthographic, Perspective, PerspectiveArctan, ThinLens
from engines.schema import yaml_file
from engines.schema.yaml_file import locate
from harness import config
from harness.cli.options import DEFAULT_ENGINE
from harness.metrics import Reference, measure
from harness.report.html.assembly import colour_maps
from harness.view.coalescing_queue import MAX_WAITING, CoalescingQueue
from harness.view.display import Tone, half_floats, rgba
from harness.view.draggable import center, draggables, moved
from harness.view.error_map import EPSILON, ErrorReference, false_colours
from harness.view.library import Library
from harness.view.menu import menu
from harness.view.messages import header_of, packed
from harness.view.projection import Projection
from harness.view.race import _experiment
from harness.view.requests import checked
from harness.view.view_controller import ViewController
from harness.view.yaml_export import scene_yaml
from tests.needs import needs

VIEW = {"eye": (1.0, 2.0, 5.0), "target": (0.2, 0.9, 0.0), "up": (0.1, 1.0, 0.0)}
CAMERAS = [
    Perspective(**VIEW, fov=50.0, fov_axis="y", resolution=(40, 30)),
    Perspective(**VIEW, fov=50.0, fov_axis="x", resolution=(40, 30)),
    PerspectiveArctan(**VIEW, fov=45.0, fov_axis="x", resolution=(40, 30)),
    Orthographic(**VIEW, height=3.0, resolution=(40, 30)),
    Orthographic(**VIEW, height=3.0, resolution=(40, 30), principal_point=(0.1, -0.05), mirror=True, clip=(1.0, 9.0)),
    ThinLens(
        **VIEW,
        fov=50.0,
        fov_axis="y",
        resolution=(40, 30),
        aperture_radius=0.01,
        focus_distance=5.2,
        principal_point=(-0.1, 0.05),
        mirror=True,
        clip=(2.0, 8.0),
    ),
]


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: type(camera).__name__)
def test_a_ray_goes_where_the_engine_sees_and_back_to_its_pixel(camera):
    projection = Projection(camera, 40, 30)
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "shapes": [{"sphere": {"center": [0.4, 1.1, 0.3], "radius": 0.5}, "material": "lamp"}],
            "materials": {"lamp": {"emission": 1}},
        }
    )
    from dataclasses import replace

    film = engines.engine("numpy").prepare(replace(scene, camera=camera), engines.Settings(40, 30, "path_tracer")).render(16)
    lit = film.mean()[:, :, 0] > 0.5
    rows, columns = np.nonzero(lit)
    x, y = projection.project(np.array([0.4, 1.1, 0.3]))
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx((x, y), abs=0.5)
    for place in ((3.0, 4.0), (20.0, 15.0), (37.5, 29.0)):
        origin, direction = projection.ray(*place)
        assert projection.project(origin + 3.7 * direction) == pytest.approx(place, abs=1e-3)
        point = projection.point_on_view_plane(np.array([0.4, 1.1, 0.3]), *place)
        forward = np.subtract(camera.target, camera.eye)
        assert np.dot(point - [0.4, 1.1, 0.3], forward) == pytest.approx(0.0, abs=1e-9)
        assert projection.project(point) == pytest.approx(place, abs=1e-3)


def test_a_camera_plugin_cannot_be_moved():
    from engines.scene import CustomCamera

    with pytest.raises(Unsupported):
        Projection(CustomCamera(object(), {}, (4, 4)), 4, 4)


@pytest.mark.parametrize("name", ["cornell_box", "two_spheres", "mobilert_spheres2", "veach_plates", "glassware"])
def test_a_moved_object_is_where_the_exported_scene_puts_it(name):
    _moves_as_exported(engines.load_scene(name))


@pytest.mark.parametrize("kind", ["spot", "projector"])
@pytest.mark.parametrize("aim", ["target: [0, 0, 1]", "direction: [0, -1, 0.5]"])
def test_a_moved_light_keeps_its_direction(aim, kind, tmp_path):
    (tmp_path / "spot.yaml").write_text(f"""\
raybench_scene: 1
camera: {{type: perspective, eye: [0, 0, 5], target: [0, 0, 0]}}
textures: {{board: {{checkerboard: {{}}}}}}
materials: {{lamp: {{emission: 1}}}}
shapes: [{{disk: {{center: [0, 2, 0], normal: [0, -1, 0], radius: 1}}, material: lamp}}]
lights: [{{{kind}: {{position: [0, 2, 0], {aim}, {"intensity: 1" if kind == "spot" else "texture: board"}}}}}]
""")
    scene = engines.load_scene(tmp_path / "spot.yaml")
    again = _moves_as_exported(scene)
    assert [item.kind for item in draggables(scene)] == ["light", kind]
    assert again.lights[0].direction == pytest.approx(scene.lights[0].direction)


def _moves_as_exported(scene):
    """The scene that is read from the YAML of one of which every object was moved."""
    objects, step = draggables(scene), np.array([0.125, -0.25, 0.5])
    assert objects
    after = scene
    for item in objects:
        before = center(scene, item)
        after = moved(after, item, step)
        assert center(after, item) == pytest.approx(before + step, abs=1e-12)
    from pathlib import Path

    text = scene_yaml(Path(scene.source), scene.camera, {item.id: step for item in objects})
    again = engines.scene_from(yaml_file.parse_yaml(text).plain(), folder=Path(scene.source).parent)
    for item in objects:
        assert center(again, item) == pytest.approx(center(after, item), rel=1e-7, abs=1e-7)
    assert again.camera == scene.camera and len(again.lights) == len(scene.lights)
    return again


def test_the_library_lists_scenes_and_refuses_paths_outside_its_folder(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner/mine.yaml").write_text("raybench_scene: 1\n")
    (tmp_path / "notes.yaml").write_text("a: 1\n")
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden/no.yaml").write_text("raybench_scene: 1\n")
    library = Library(tmp_path)
    assert "inner/mine.yaml" in library.names() and "cornell_box" in library.names()
    assert not {"notes.yaml", ".hidden/no.yaml"} & {*library.names()}
    assert library.find("inner/mine.yaml") == tmp_path / "inner/mine.yaml"
    for name in ("../x.yaml", "/etc/passwd", "inner/../../x.yaml", "nothing", "inner/none.yaml", "a\0b/c.yaml"):
        with pytest.raises(ConfigError):
            library.find(name)
    with pytest.raises(ConfigError, match="--folder"):
        Library(tmp_path / "inner").name_of(str(tmp_path / "notes.yaml"))


def test_the_menu_has_what_the_engines_list(tmp_path):
    listed = menu(Library(tmp_path))
    assert [e["name"] for e in listed["engines"]] == engines.engine_names()
    assert listed["preferred"] == DEFAULT_ENGINE
    shader = next(s for s in listed["shaders"] if s["name"] == "path_tracer")
    kinds = {option["key"]: option for option in shader["options"]}
    assert kinds["direct"]["values"] == ["light", "bsdf", "mis"] and kinds["max_depth"]["kind"] == "integer"
    assert kinds["direct"]["accepts"].startswith("one of ") and kinds["direct"]["description"]
    refused = {e["name"]: e["refusals"] for e in listed["engines"]}
    assert refused["numpy"] == refused["embreex_batch"] == {"sampler": {}, "shader": {}}
    strata = next(s for s in listed["samplers"] if s["name"] == "stratified")["options"][0]
    assert strata["values"] == [4, 16, 64, 256, 1024, 4096] and strata["default"] == 64


@needs("mitsuba-llvm")
def test_the_menu_has_samplers_of_mitsubas_own_and_says_which_of_ours_it_lacks(tmp_path):
    refused = {engine["name"]: engine["refusals"] for engine in menu(Library(tmp_path))["engines"]}["mitsuba"]["sampler"]
    assert "sobol" in refused and "independent" not in refused


def test_an_engine_that_renders_nothing_is_listed_with_the_reason(tmp_path):
    listed = {engine["name"]: engine for engine in menu(Library(tmp_path))["engines"]}
    assert "renders no images" in listed["open3d"]["problem"]
    samplers = {sampler["name"] for sampler in menu(Library(tmp_path))["samplers"]}
    for engine in listed.values():
        offered = samplers | {sampler["name"] for sampler in engine["samplers"]}
        assert engine["problem"] or offered - {*engine["refusals"]["sampler"]}, engine["name"]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"type": "nothing"}, "unknown request"),
        ({"type": "open"}, "scene"),
        ({"type": "probe", "x": -1, "y": 0}, "x"),
        ({"type": "camera", "eye": [0, 0, math.nan], "target": [0, 0, 0], "up": [0, 1, 0]}, "eye"),
        ({"type": "save", "name": "../out"}, "name"),
        ({"type": "stop", "more": 1}, "more"),
        ({"type": "race", "scene": "x", "contestants": [], "width": 8, "height": 8, "targets": [1]}, "contestants"),
    ],
)
def test_a_request_that_is_wrong_is_refused_by_name(request_, words):
    with pytest.raises(ConfigError, match=words):
        checked(request_)


def test_of_waiting_changes_of_settings_the_last_is_rendered_and_a_reset_before_it_is_kept(tmp_path):
    controller = ViewController(lambda message: None, Library(tmp_path), False)
    choices = {kind: {"name": "x"} for kind in ("shader", "sampler", "accelerator")}
    settings = {"engine": "numpy", "threads": 1, **choices}
    for seed, keep_edits in ((1, True), (2, False), (3, True), (4, True)):
        request = {"type": "open", "scene": "x", "settings": settings, "seed": seed, "keep_edits": keep_edits}
        controller.receive(checked(request))
    assert [controller._work.take(0.0).seed for _ in range(2)] == [2, 4] and not controller._work


def test_the_queue_keeps_the_last_request_of_a_key_and_a_limited_number_of_others():
    queue = CoalescingQueue()
    for index in range(1000):
        queue.put(index, key="camera")
        queue.put("other")
    assert queue.take() == "other"  # older than the camera, which is replaced at the end
    rest = []
    while (found := queue.take(0.0)) is not None:
        rest.append(found)
    assert rest.count(999) == 1 and len(rest) <= MAX_WAITING


def test_messages_keep_bytes_and_replace_numbers_that_json_lacks():
    message = packed({"type": "x", "values": [math.nan, math.inf, 1.5], "name": "é"}, b"\x00\xff")
    assert header_of(message) == {"type": "x", "values": [None, None, 1.5], "name": "é"} and message.endswith(b"\x00\xff")


def test_the_error_map_is_that_of_the_metric_and_a_pixel_without_an_error_is_magenta():
    reference, mean = np.random.default_rng(3).exponential(0.5, (2, 12, 12, 3)).astype(np.float32)
    error = ErrorReference(reference, (), "").error(mean)
    known = measure(mean, Reference(reference, reference, reference, reference, 2), EPSILON)[f"relmse_e{EPSILON:g}"]
    assert error.mean(dtype=np.float64) == pytest.approx(known, rel=1e-5)
    error[0, :3] = (np.nan, 1e-5, 1.0)
    shown = np.frombuffer(false_colours(error), np.uint8).reshape(12, 12, 4)[0]
    assert shown[0].tolist() == [255, 0, 255, 255]
    assert shown[1].tolist()[:3] == colour_maps()["magma"][0] and shown[2].tolist()[:3] == colour_maps()["magma"][-1]


@pytest.mark.parametrize("mapper", ["srgb", "linear", "reinhard", "aces"])
def test_the_canvas_shows_what_the_film_would_save(mapper):
    film = engines.Film(7, 5)
    rng = np.random.default_rng(1)
    for _ in range(3):
        film.add(rng.exponential(0.5, (5, 7, 3)))
    shown = np.frombuffer(rgba(film, Tone(mapper, 1.0)), np.uint8).reshape(5, 7, 4)
    wanted = engines.film.to_bitmap(2 * film.mean(), mapper)
    assert np.abs(shown[:, :, :3].astype(int) - wanted).max() <= 1 and (shown[:, :, 3] == 255).all()
    halves = np.frombuffer(half_floats(film), "<f2").reshape(5, 7, 3)
    assert halves == pytest.approx(film.mean(), rel=1e-3)


def test_values_of_a_mitsuba_files_parameters_reach_races(tmp_path):
    contestant = {
        "engine": "numpy",
        "shader": {"name": "path_tracer"},
        "sampler": {"name": "random"},
        "accelerator": {"name": "auto"},
        "threads": 1,
    }
    request = checked(
        {
            "type": "race",
            "seq": 1,
            "scene": "lantern",
            "contestants": [contestant, {**contestant, "engine": "numba"}],
            "width": 8,
            "height": 8,
            "targets": [0.1],
        }
    )
    file = Library(tmp_path).find("lantern")
    experiment = config.parse(locate(_experiment(request, file, {"width": "16"}), "race", ConfigError), tmp_path, "race", "")
    scenes = {combination.scene.parameters for combination in experiment.combinations}
    assert scenes == {(("width", "16"),)}
