"""Exported scenes: Mitsuba renders its file to our image; pbrt's is held to its grammar and its numbers."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.peers.export import export
from harness.config import paths
from tests.harness.sweeping import raybench
from tests.image_tests import image_tests
from tests.mitsuba.peer import mi
from tests.needs import needs

SIDE, SPP, REPLICATES = 24, 16, 12


def _scene(name):
    return engines.load_scene(paths.find("scenes", name))


def _by_mitsuba(file):
    """(REPLICATES, h, w, 3) images of the exported file, whose own resolution and integrator count."""
    mi.set_variant("scalar_rgb")
    loaded = mi.load_file(str(file))
    return np.stack([np.array(mi.render(loaded, spp=SPP, seed=seed)) for seed in range(REPLICATES)])


def _with_resolution(scene, width, height):
    return replace(scene, camera=replace(scene.camera, resolution=(width, height)))


@pytest.mark.parametrize("name", ["cornell_box", "two_spheres", "furnace"])
@needs("mitsuba-scalar")
def test_mitsuba_renders_the_exported_file_to_our_image(name, tmp_path):
    scene = _with_resolution(_scene(name), SIDE, SIDE)
    theirs = _by_mitsuba(export(scene, "mitsuba", tmp_path / "scene.xml", max_depth=5))
    shader = {"name": "path_tracer", "max_depth": 5, "rr_depth": 1000}
    renderer = engines.engine("embree").prepare(scene, Settings(SIDE, SIDE, shader=shader, sampler="random", seed=9))
    sums = np.stack([np.zeros((SIDE, SIDE, 3)), *(renderer.render(SPP).sums.copy() for _ in range(REPLICATES))])
    found = image_tests(np.diff(sums, axis=0) / SPP, theirs, 1e-4, margin=0.02)
    assert not found.different, found
    assert found.detectable < 0.1


def _directives(text):
    """(word, arguments) of every directive of a pbrt file, a directive a line."""
    for line in text.splitlines():
        words = shlex.split(line.replace("[", " [ ").replace("]", " ] "))
        yield words[0], words[1:]


def test_a_pbrt_file_is_complete_and_every_name_in_it_is_made(tmp_path):
    file = export(_scene("two_spheres"), "pbrt", tmp_path)
    assert file.name == "two_spheres.pbrt"
    text = file.read_text()
    found = list(_directives(text))
    kinds = [word for word, _ in found]
    head = kinds[: kinds.index("WorldBegin")]
    assert head == ["Scale", "LookAt", "Camera", "Film", "PixelFilter", "Sampler", "Integrator"]
    assert kinds.count("AttributeBegin") == kinds.count("AttributeEnd") == len(_scene("two_spheres").shapes)
    made = {arguments[0] for word, arguments in found if word == "MakeNamedMaterial"}
    assert {arguments[0] for word, arguments in found if word == "NamedMaterial"} <= made
    for mesh in re.findall(r'"plymesh" "string filename" \[ "(.+?)" \]', text):
        assert (file.parent / mesh).read_bytes().startswith(b"ply\n")
    parameters = re.findall(r'"(\w+) \w+" \[ (.+?) \]', text)
    assert {kind for kind, _ in parameters} <= {"float", "integer", "string", "rgb", "point3", "bool"}
    for kind, values in parameters:
        if kind in ("float", "rgb", "point3"):
            assert np.isfinite([float(value) for value in values.split()]).all()
        if kind in ("rgb", "point3"):
            assert len(values.split()) % 3 == 0


def test_pbrt_measures_the_angle_along_the_shorter_side(tmp_path):
    camera = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0], "fov": 60, "resolution": [300, 100]}
    for axis, angle in (("y", 60.0), ("x", 2 * np.degrees(np.arctan(np.tan(np.radians(30)) / 3)))):
        scene = engines.scene_from({"raybench_scene": 1, "name": "empty", "camera": {**camera, "fov_axis": axis}})
        text = export(scene, "pbrt", tmp_path / "a.pbrt").read_text()
        assert float(re.findall(r'"float fov" \[ (\S+) \]', text)[0]) == pytest.approx(angle)


@pytest.mark.parametrize("form", ["mitsuba", "pbrt"])
def test_what_has_no_counterpart_is_refused_by_name(form, tmp_path):
    with pytest.raises(Unsupported, match="transmission"):
        export(_scene("cornell_spheres"), form, tmp_path / "a")
    assert not list(tmp_path.rglob("*.*"))


def test_the_command_says_what_it_wrote_and_refuses_other_forms(tmp_path):
    done = raybench("export", "cornell_box", "--to", "mitsuba", "-o", tmp_path / "box.xml")
    assert done.returncode == 0, done.stderr
    assert "box.xml" in done.stdout
    done = raybench("export", "cornell_box", "--to", "pbrtt", "-o", tmp_path)
    assert done.returncode == 2
    assert "'pbrt'" in done.stderr
    assert "Traceback" not in done.stderr


def _metal(conductor, **spot):
    spot = {"position": [0, 3, 0], "target": [0, 0, 0], "intensity": 4, "cutoff": 30, "beam_width": 30, **spot}
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"metal": {"conductor": conductor}},
            "lights": [{"spot": spot}],
            "shapes": [{"disk": {"center": [1, 2, 3], "normal": [0, 1, 0], "radius": 2}, "material": "metal"}],
        }
    )


def test_pbrt_gets_a_disk_of_metal_under_a_spot_light(tmp_path):
    text = export(_metal({"eta": 0.5, "k": [1, 2, 3], "alpha": 0.25}), "pbrt", tmp_path / "a.pbrt").read_text()
    assert '"rgb eta" [ 0.5 0.5 0.5 ] "rgb k" [ 1.0 2.0 3.0 ]' in text
    assert '"float roughness" [ 0.25 ] "bool remaproughness" [ false ]' in text
    assert '"float coneangle" [ 30.0 ] "float conedeltaangle" [ 0 ]' in text and '"float radius" [ 2.0 ]' in text
    (columns,) = re.findall(r"ConcatTransform \[ (.+?) \]", text)
    matrix = np.array(columns.split(), float).reshape(4, 4).T
    assert np.allclose(matrix @ [0, 0, 0, 1], [1, 2, 3, 1]) and np.allclose(matrix @ [0, 0, 1, 0], [0, 1, 0, 0])
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3)) and np.linalg.det(matrix) == pytest.approx(1)


@pytest.mark.parametrize(
    ("scene", "what"),
    [
        (_metal({"metal": "Au", "alpha": [0.1, 0.2]}), "material 'metal'.*anisotropic"),
        (_metal({"metal": "Au", "specular_reflectance": 0.5}), "material 'metal'.*scaled"),
        (_metal({"metal": "Au"}, beam_width=20), "spot lights fall off"),
    ],
)
def test_what_pbrt_shades_otherwise_is_refused(scene, what, tmp_path):
    with pytest.raises(Unsupported, match=what):
        export(scene, "pbrt", tmp_path / "a.pbrt")
