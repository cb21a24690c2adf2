"""Every wrong input gives one message: file, line, key path, value, what is expected; only SceneError comes out."""

from __future__ import annotations

import re

import pytest

import engines
from engines.errors import SceneError
from engines.schema import fields
from engines.schema.yaml_file import Located, Origin

GOOD = """\
raybench_scene: 1
camera:
  type: perspective
  eye: [0, 1, 5]
  target: [0, 1, 0]
  fov: 40
  resolution: [8, 8]
materials:
  red: {kd: [0.5, 0.1, 0.1]}
  glass: {ks: 1, kt: 1, ior: 1.5, fresnel: true}
  lamp: {emission: 5}
  gold: {conductor: {metal: Au, alpha: [0.1, 0.2]}}
shapes:
  - {sphere: {center: [0, 1, 0], radius: 1}, material: red}
  - {plane: {point: [0, 0, 0], normal: [0, 1, 0]}, material: red}
  - {triangle: {a: [0, 0, 0], b: [1, 0, 0], c: [0, 1, 0]}, material: lamp}
  - {mesh: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 2]]}, material: glass}
  - {procedural: {name: sphereflake, level: 1}, material: red}
  - {disk: {center: [0, 2, 0], normal: [0, -1, 0], radius: 0.5}, material: gold}
lights:
  - {point: {position: [0, 3, 0], intensity: 10}}
  - {directional: {direction: [0, -1, 0], irradiance: 1}}
  - {environment: {radiance: 1}}
  - {spot: {position: [0, 3, 0], target: [0, 1, 0], intensity: 5, cutoff: 30, beam_width: 20}}
"""

BEAM = "beam_width: 20}}"
SPOT = "spot: {position: [0, 3, 0], target: [0, 1, 0], intensity: 5, cutoff: 30, beam_width: 20}}"
PROJECTOR = "projector: {position: [0, 3, 0], target: [0, 1, 0]"
TEXTURES = "}}\ntextures: {t: {checkerboard: {}}, a: {attribute: face_color}}"

# What to replace, with what, and the message after the file's name. Values of another type, those far out of range, unknown
# and missing keys are those of test_scene_refusals.py, and the words about them those of tests/schema.
CASES = [
    ("raybench_scene: 1", "raybench_scene: 2", ":1 raybench_scene = 2: must be an integer in [1, 1]"),
    ("lights:", "lihgts:", ":20 lihgts: unknown key: did you mean 'lights'? known: camera, groups, lights,"),
    ("materials:", "materials:\n  red: {kd: 1}", ":10: 'red' is there twice: first in line 9, again in line 10"),
    # camera
    ("type: perspective", "type: perspectiv", ":3 camera.type = 'perspectiv': unknown camera: did you mean 'perspective'?"),
    ("type: perspective", "type: os:getcwd", ":3 camera.type = 'os:getcwd': imports code: pass --allow-imports"),
    ("eye: [0, 1, 5]", "eye: [0, 1]", ":4 camera.eye: must be three numbers"),
    ("eye: [0, 1, 5]", "eye: [0, 1e999, 5]", ":4 camera.eye[1] = inf: must be finite"),
    ("eye: [0, 1, 5]", f"eye: [0, {'9' * 400}, 5]", ": must be finite"),
    ("target: [0, 1, 0]", "target: [0, 1, 5]", ":5 camera.target: must differ from eye"),
    ("target: [0, 1, 0]", "target: [0, 9, 5]", ":5 camera.target: up must not be parallel"),
    ("fov: 40", "up: [0, 0, 3]", ":6 camera.up: up must not be parallel"),
    ("fov: 40", "up: [0, 0, 0]", ":6 camera.up: must not be the zero vector"),
    ("fov: 40", "fov: 180", ":6 camera.fov = 180: must lie in (0, 180) degrees"),
    ("[8, 8]", "[0, 8]", ":7 camera.resolution[0] = 0: must be an integer in [1, 65536]"),
    ("[8, 8]", "[8, 8.0]", ":7 camera.resolution[1] = 8.0: must be an integer in [1, 65536]"),
    ("[8, 8]", "[8, true]", ":7 camera.resolution[1] = True: must be an integer in [1, 65536]"),
    ("[8, 8]", "[65536, 65536]", "this machine has"),
    # materials
    ("kd: [0.5, 0.1, 0.1]", "kd: [0.5, 1.4, 0.1]", ":9 materials.red.kd[1] = 1.4: must lie in [0, 1]"),
    ("kd: [0.5, 0.1, 0.1]", "kd: [1, 2]", ":9 materials.red.kd: must be a number or [r, g, b]"),
    (
        "kd: [0.5, 0.1, 0.1]",
        "kdd: 1",
        ":9 materials.red.kdd: unknown key: did you mean 'kd'? known: blend, bump, by_side, conductor,",
    ),
    ("kd: [0.5, 0.1, 0.1]", "kd: 0.5, ks: [0.1, 0.6, 0]", ":9 materials.red: kd + ks + kt = 1.1 in green: must not exceed 1"),
    ("ks: 1, kt: 1", "ks: 1, kt: 1, kd: 0.1", ":10 materials.glass: kd + max(ks, kt) = 1.1 in red: must not exceed 1"),
    # shapes
    ("material: glass", "material: glas", ":17 shapes[3].material = 'glas': unknown material: did you mean 'glass'?"),
    ("- {sphere:", "- {spere:", ":14 shapes[0].spere: unknown shape: did you mean 'sphere'?"),
    ("{sphere: {center: [0, 1, 0], radius: 1}, material: red}", "{material: red}", ":14 shapes[0]: must have one kind"),
    ("radius: 1}", "radius: 0}", ":14 shapes[0].sphere.radius = 0: must be greater than 0"),
    ("normal: [0, 1, 0]", "normal: [0, 0, 0]", ":15 shapes[1].plane.normal: must not be the zero vector"),
    ("c: [0, 1, 0]", "c: [2, 0, 0]", ":16 shapes[2]: material 'lamp' emits, but the shape has no area"),
    ("[[0, 1, 2]]", "[[0, 1, 3]]", ":17 shapes[3].mesh.faces[0][2] = 3: must be an integer in [0, 2]"),
    ("[[0, 1, 2]]", "[[0, 1, -1]]", ":17 shapes[3].mesh.faces[0][2] = -1: must be an integer in [0, 2]"),
    ("[[0, 1, 2]]", "[[0, 1, 1.5]]", ":17 shapes[3].mesh.faces[0][2] = 1.5: must be an integer in [0, 2]"),
    ("[[0, 1, 2]]", "[[0, 1, 2, 0]]", ":17 shapes[3].mesh.faces[0]: must be three numbers"),
    ("[[0, 1, 2]]", "[]", ":17 shapes[3].mesh.faces: must not be empty"),
    (", faces: [[0, 1, 2]]", "", ":17 shapes[3].mesh.faces: is missing"),
    ("faces: [[0, 1, 2]]", "faces: [[0, 1, 2]], file: a.obj", "shapes[3].mesh.vertices: either file, or vertices and faces"),
    ("[1, 0, 0], [0, 1, 0]]", "[1e308, 0, 0], [0, 1, 0]], scale: 1e10", "vertices must be finite"),
    ("material: glass", "material: [lamp]", "shapes[3].material: unknown material"),
    (
        "name: sphereflake",
        "name: sphereflak",
        ":18 shapes[4].procedural.name = 'sphereflak': unknown procedural shape: did you",
    ),
    ("level: 1", "level: 15", ":18 shapes[4].procedural: procedural shape 'sphereflake' of this size would need"),
    ("level: 1", "level: 1, radius: 1e308, center: [1e308, 1e308, 1e308]", "coordinates must be finite"),
    ("name: sphereflake, level: 1", "name: box, half_size: [1, 0, 1]", "shapes[4].procedural.half_size: [1.0, 0.0, 1.0]: must"),
    (
        "name: sphereflake, level: 1",
        "name: quad, points: [[0, 0, 0]]",
        "shapes[4].procedural.points: 1 points: four are expected",
    ),
    ("name: sphereflake, level: 1", "name: quad", "shapes[4].procedural.points: is missing"),
    # lights
    ("- {point:", "- {pont:", ":21 lights[0].pont: unknown light: did you mean 'point'?"),
    ("{radiance: 1}", "{}", ":23 lights[2].environment: needs radiance, image, or both"),
    ("{radiance: 1}", "{image: sky.exr}", ":23 lights[2].environment.image = 'sky.exr': no such file"),
    ("{radiance: 1}", "{image: ../../etc/passwd.exr}", "= '../../etc/passwd.exr': lies outside the scene's folder"),
    ("{environment: {radiance: 1}}", "5", ":23 lights[2] = 5: must be a mapping with one key"),
    # disks, conductors, spot lights
    ("metal: Au", "metal: Av", ":12 materials.gold.conductor.metal = 'Av': unknown metal: known: Ag, Al, "),
    ("metal: Au, ", "", ":12 materials.gold.conductor: needs metal, eta and k, or reflectance"),
    (
        "metal: Au",
        "metal: Au, reflectance: 1",
        ":12 materials.gold.conductor.reflectance: either metal, eta and k, or reflectance",
    ),
    ("metal: Au", "eta: 1", ":12 materials.gold.conductor.k: is missing"),
    ("metal: Au", "eta: 1, k: [1, -2, 3]", ":12 materials.gold.conductor.k[1] = -2: must not be negative"),
    (
        "metal: Au",
        "eta: 0, k: 0",
        ":12 materials.gold.conductor: the larger of eta and k is 0 in red: must lie in [1e-06, 1e+06]",
    ),
    (
        "metal: Au",
        "eta: [1, 0, 0], k: [0, 1, 1e-7]",
        ":12 materials.gold.conductor: the larger of eta and k is 1e-07 in blue: ",
    ),
    ("metal: Au", "eta: 1e7, k: 1", ":12 materials.gold.conductor: the larger of eta and k is 1e+07 in red: must lie in "),
    ("metal: Au", "reflectance: 1.5", ":12 materials.gold.conductor.reflectance = 1.5: must lie in [0, 1]"),
    (
        "metal: Au",
        "reflectance: 1, specular_reflectance: 1",
        ":12 materials.gold.conductor.specular_reflectance: a factor of metal",
    ),
    ("alpha: [0.1, 0.2]", "alpha: [0.1, 0]", ":12 materials.gold.conductor.alpha[1] = 0: must lie in [0.0001, 1], or be 0"),
    ("alpha: [0.1, 0.2]", "alpha: 1e-5", ":12 materials.gold.conductor.alpha = 1e-05: must lie in [0.0001, 1], or be 0"),
    ("alpha: [0.1, 0.2]", "alpha: [0.1, 0.2, 3]", ":12 materials.gold.conductor.alpha: must be a number, or two"),
    ("{conductor:", "{kd: 0.5, conductor:", ":12 materials.gold.kd: either conductor, or kd, ks, kt, ior, fresnel"),
    ("target: [0, 1, 0], i", "target: [0, 3, 0], i", ":24 lights[3].spot.target: must differ from position"),
    ("target: [0, 1, 0], i", "i", ":24 lights[3].spot: needs target, or direction"),
    (
        "target: [0, 1, 0], i",
        "target: [0, 1, 0], direction: [0, 1, 0], i",
        ":24 lights[3].spot.direction: either target, or direction",
    ),
    ("target: [0, 1, 0], i", "direction: [0, 0, 0], i", ":24 lights[3].spot.direction: must not be the zero vector"),
    ("beam_width: 20", "beam_width: 31", ":24 lights[3].spot.beam_width = 31: must not exceed cutoff, which is 30"),
    ("cutoff: 30", "up: [1, 0, 0]", ":24 lights[3].spot.up: belongs to a texture: a cone is the same all around"),
    ("cutoff: 30", "texture: t", ":24 lights[3].spot.texture = 't': must be the name of a texture, and"),
    (BEAM, f"texture: t{TEXTURES}", ":24 lights[3].spot: up must not be parallel to the axis of the light"),
    (BEAM, f"texture: t, up: [0, 9, 0]{TEXTURES}", ":24 lights[3].spot.up: up must not be parallel to the axis of the light"),
    (BEAM, f"texture: a, up: [1, 0, 0]{TEXTURES}", ":24 lights[3].spot.texture = 'a': must be an image or a checkerboard"),
    (
        f"cutoff: 30, {BEAM}",
        f"cutoff: 90, texture: t, up: [1, 0, 0]{TEXTURES}",
        ":24 lights[3].spot.cutoff = 90: must be below 90",
    ),
    # projectors
    (SPOT, f"{PROJECTOR}, texture: t{TEXTURES}", ":24 lights[3].projector: up must not be parallel to the axis of the light"),
    (SPOT, f"{PROJECTOR}, texture: u{TEXTURES}", ":24 lights[3].projector.texture = 'u': unknown texture: known: a, t"),
    (SPOT, f"{PROJECTOR}, texture: t, fov: 180{TEXTURES}", ":24 lights[3].projector.fov = 180: must lie in (0, 180) degrees"),
    (SPOT, f"{PROJECTOR}{TEXTURES}", ":24 lights[3].projector.texture: is missing"),
]


@pytest.mark.parametrize(("old", "new", "message"), CASES)
def test_each_wrong_value_is_refused_where_it_stands(tmp_path, old, new, message):
    assert old in GOOD
    file = tmp_path / "box.yaml"
    file.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(SceneError) as caught:
        engines.load_scene(file)
    text = str(caught.value)
    assert text.startswith(f"{file}:") and message in text and "\n" not in text
    assert re.match(re.escape(str(file)) + r":\d+[ :]", text)


def test_the_scene_they_are_made_from_is_good(tmp_path):
    (tmp_path / "box.yaml").write_text(GOOD)
    scene = engines.load_scene(tmp_path / "box.yaml")
    assert len(scene.shapes) == 6 and len(scene.lights) == 4 and scene.warnings == ()


@pytest.mark.parametrize("data", [None, 3, [], "text", {}, {"raybench_scene": 1}, {"raybench_scene": True, "camera": {}}])
def test_wrong_mappings_are_refused_by_key_path_alone(data):
    with pytest.raises(SceneError) as caught:
        engines.scene_from(data)
    assert ":0" not in str(caught.value)


def test_unknown_bare_names_list_the_nearest():
    with pytest.raises(SceneError, match=r"scene 'cornel_box': unknown scene: did you mean 'cornell_box'\?"):
        engines.load_scene("cornel_box")


@pytest.mark.parametrize("name", ["", "a\0b", "x" * 5000, "missing/box.yaml", "."])
def test_paths_that_are_none_are_refused(name):
    with pytest.raises(SceneError):
        engines.load_scene(name)


@pytest.mark.parametrize("number", [".nan", ".inf", "-.inf"])
def test_a_number_that_is_not_finite_is_refused_where_it_stands(tmp_path, number):
    """Every number of the good scene in turn."""
    file, lines = tmp_path / "box.yaml", GOOD.split("\n")
    numbers = [(i, found.span()) for i, line in enumerate(lines) for found in re.finditer(r"(?<=[ \[:])[0-9.]+\b", line)]
    assert len(numbers) > 50
    for index, (start, end) in numbers:
        line = lines[index][:start] + number + lines[index][end:]
        file.write_text("\n".join([*lines[:index], line, *lines[index + 1 :]]))
        with pytest.raises(SceneError) as caught:
            engines.load_scene(file)
        assert str(caught.value).startswith(f"{file}:{index + 1} ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", " \n", "\n\n# nothing\n", "\ufeff", "---\n"])
def test_an_empty_scene_is_refused_with_file_and_line(tmp_path, text):
    (tmp_path / "box.yaml").write_text(text)
    with pytest.raises(SceneError, match=r"box\.yaml:[12][: ].*(a mapping is expected|must be a mapping)"):
        engines.load_scene(tmp_path / "box.yaml")


def test_a_name_is_looked_up_without_a_walk_through_all_names():
    class Names(dict):
        def __iter__(self):
            raise AssertionError("a search through all names, for every shape")

    assert fields.one_of(Located("b", Origin("", SceneError)), Names(a=1, b=2), "material") == "b"


def test_messages_are_short_whatever_they_quote_and_list():
    scene = {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]},
        "materials": {f"m{index}": {} for index in range(1000)},
        "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "m" + "x" * 10_000}],
    }
    with pytest.raises(SceneError, match=r"shapes\[0\].material = .*unknown material: known: .* and 900 more$") as caught:
        engines.scene_from(scene)
    assert len(str(caught.value)) < 2000
    with pytest.raises(SceneError, match=r"^k{80}: unknown key") as caught:
        engines.scene_from({"k" * 10_000: 1})
    assert len(str(caught.value)) < 300
