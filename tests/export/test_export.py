"""Exported scenes: Mitsuba renders its file to our image; pbrt's is held to its grammar and its numbers."""

import re
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.image import read_image
from engines.numpy_reference import textures
from engines.peers.export import export
from engines.scene.formats.ply import parse_ply
from harness.config import paths
from tests.export import pbrt_file
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


def test_a_pbrt_file_is_complete_and_every_name_in_it_is_made(tmp_path):
    file = export(_scene("two_spheres"), "pbrt", tmp_path)
    assert file.name == "two_spheres.pbrt"
    words = [word for word, _ in pbrt_file.directives(pbrt_file.check(file))]
    head = words[: words.index("WorldBegin")]
    assert head == ["Scale", "LookAt", "Camera", "Film", "PixelFilter", "Sampler", "Integrator"]
    assert words.count("Shape") == len(_scene("two_spheres").shapes)


def test_pbrt_gets_media_on_the_sides_of_shapes_and_around_the_camera(tmp_path):
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "media": {"fog": {"sigma_t": [1, 2, 4], "albedo": [0.5, 0.25, 1], "g": -0.5}, "smoke": {"sigma_t": 3, "albedo": 1}},
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0], "medium": "fog"},
            "materials": {"clear": {"null": {}}, "grey": {"kd": 0.5}},
            "shapes": [
                {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "clear", "interior": "smoke", "exterior": "fog"},
                {"triangle": {"a": [-9, -2, -9], "b": [0, -2, 9], "c": [9, -2, -9]}, "material": "grey"},
            ],
            "lights": [{"environment": {"radiance": 1}}],
        }
    )
    text = pbrt_file.check(export(scene, "pbrt", tmp_path / "a.pbrt"))
    assert [line.strip() for line in text.splitlines() if "Medium" in line] == [
        'MakeNamedMedium "medium_0" "string type" [ "homogeneous" ] "rgb sigma_a" [ 0.5 1.5 0.0 ] '
        '"rgb sigma_s" [ 0.5 0.5 4.0 ] "float g" [ -0.5 ]',
        'MakeNamedMedium "medium_1" "string type" [ "homogeneous" ] "rgb sigma_a" [ 0.0 0.0 0.0 ] '
        '"rgb sigma_s" [ 3.0 3.0 3.0 ] "float g" [ 0.0 ]',
        'MediumInterface "" "medium_0"',
        'MediumInterface "" ""',
        'MediumInterface "medium_1" "medium_0"',
    ]
    words = [word for word, _ in pbrt_file.directives(text)]
    assert words.index("MediumInterface") < words.index("Camera"), "the camera's outside is what stands before it"
    assert words[words.index("WorldBegin") + 1] == "MediumInterface"
    assert 'Integrator "volpath"' in text
    assert 'MakeNamedMaterial "material_0" "string type" [ "interface" ]' in text.splitlines()


@pytest.mark.parametrize("how", [{"wrap": "repeat"}, {"wrap": "clamp", "filter": "nearest"}])
@pytest.mark.parametrize("shape", ["mesh", "mesh without coordinates", "triangle"])
def test_pbrt_finds_the_texels_that_we_find(how, shape, tmp_path):
    """pbrt's rule, by its source: (s, t) = (uscale u + udelta, vscale v + vdelta), and 1 - t goes down the image."""
    texels = np.random.default_rng(3).random((5, 7, 3)).astype(np.float32)
    corners = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
    uvs = np.array([[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]]) if shape == "mesh" else np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    mesh = {"mesh": corners | ({"uvs": uvs.tolist()} if shape == "mesh" else {})}
    flat = {"triangle": dict(zip("abc", corners["vertices"], strict=True))}
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "textures": {"t": {"image": texels, "color_space": "raw", "scale": [2, 3], "offset": [0.3, -0.4], **how}},
            "materials": {"m": {"diffuse": {"reflectance": "t"}}},
            "shapes": [{**(flat if shape == "triangle" else mesh), "material": "m"}],
        }
    )
    file = export(scene, "pbrt", tmp_path / "a.pbrt")
    lines = pbrt_file.check(file).splitlines()
    said = next(pbrt_file.parameters(line) for line in lines if line.startswith("Texture"))
    body = next(pbrt_file.parameters(line) for line in lines if "Shape" in line)
    if shape == "triangle":
        given = np.array(body["point2 uv"], float).reshape(3, 2)
    else:
        given = parse_ply((tmp_path / body["string filename"][0]).read_bytes()).uvs
    assert given == pytest.approx(uvs, abs=1e-6)
    weights = np.random.default_rng(4).dirichlet([1, 1, 1], 50)
    u_scale, u_delta, v_scale, v_delta = (float(said[f"float {name}"][0]) for name in ("uscale", "udelta", "vscale", "vdelta"))
    place = weights @ given * [u_scale, v_scale] + [u_delta, v_delta]
    image = read_image(tmp_path / said["string filename"][0])
    rows, columns = image.shape[:2]
    x, y = place[:, 0] * columns - 0.5, (1 - place[:, 1]) * rows - 0.5

    def texel(i, j):
        if said["string wrap"] == ["repeat"]:
            return image[j % rows, i % columns]
        return image[j.clip(0, rows - 1), i.clip(0, columns - 1)]

    if said["string filter"] == ["point"]:
        found = texel(np.round(x).astype(int), np.round(y).astype(int))
    else:
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        right, down = (x - i)[:, None], (y - j)[:, None]
        found = (1 - down) * ((1 - right) * texel(i, j) + right * texel(i + 1, j))
        found += down * ((1 - right) * texel(i, j + 1) + right * texel(i + 1, j + 1))
    texture = scene.materials[0].bsdf.reflectance
    assert found == pytest.approx(textures.color(texture, (weights @ uvs).T).T, abs=1e-4)


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
