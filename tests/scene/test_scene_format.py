"""What a scene file means: defaults, short forms, legal oddities, files and folders, and camera plugins."""

from __future__ import annotations

import copy
import math
from pathlib import Path

import numpy as np
import pytest

import engines
from engines.errors import SceneError, UnknownName
from engines.image import write_image
from engines.scene import (
    Conductor,
    CustomBSDF,
    CustomCamera,
    CustomLight,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Mesh,
    Orthographic,
    Perspective,
    PerspectiveArctan,
    Plane,
    PointLight,
    Sphere,
    SphereSet,
    SpotLight,
    Triangle,
)

CAMERA = {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]}
BASE = {"raybench_scene": 1, "camera": CAMERA, "materials": {"m": {"kd": 0.5}, "lamp": {"emission": 1}}}


def scene(**parts):
    return engines.scene_from(copy.deepcopy(BASE) | parts)


def test_defaults_are_those_of_the_format():
    found = scene(shapes=[{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "lamp"}])
    assert found.camera == Perspective((0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0, "y", (256, 256))
    material = found.materials[0]
    assert (material.kd, material.ks, material.kt) == ((0.5,) * 3, (0.0,) * 3, (0.0,) * 3)
    assert (material.ior, material.fresnel, material.two_sided, material.emits) == (1.0, False, False, False)
    assert found.name == "scene" and found.source == "" and found.warnings == ()


def test_every_kind_of_shape_and_light_is_read():
    found = scene(
        shapes=[
            {"sphere": {"center": [1, 2, 3], "radius": 4}, "material": "m"},
            {"plane": {"point": [0, 1, 0], "normal": [0, 0, 5]}, "material": "lamp"},
            {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "material": "m"},
            {"mesh": {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "scale": [1, 2, 3]}, "material": "m"},
            {"procedural": {"name": "sphereflake", "level": 1}, "material": "m"},
        ],
        lights=[
            {"point": {"position": [0, 1, 0], "intensity": [1, 2, 3], "falloff": "none"}},
            {"directional": {"direction": [0, -2, 0], "irradiance": 3}},
            {"environment": {"radiance": 0.5}},
        ],
    )
    sphere, plane, triangle, mesh, spheres = found.shapes
    assert sphere == Sphere((1, 2, 3), 4, 0) and plane == Plane((0, 1, 0), (0, 0, 1), 1)
    assert triangle == Triangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 0)
    assert isinstance(mesh, Mesh) and np.array_equal(mesh.vertices, np.diag([1.0, 2.0, 3.0])) and mesh.normals is None
    assert isinstance(spheres, SphereSet) and spheres.centers.shape == (10, 3)
    point, sun, sky = found.lights
    assert point == PointLight((0, 1, 0), (1, 2, 3), falloff=False) and sun == DirectionalLight((0, -1, 0), (3, 3, 3))
    assert isinstance(sky, EnvironmentLight) and sky.radiance == (0.5,) * 3 and sky.image is None


def test_disks_and_spot_lights_are_read():
    spot = {"position": [0, 3, 0], "intensity": [1, 2, 3], "cutoff": 40}
    found = scene(
        shapes=[{"disk": {"center": [1, 2, 3], "normal": [0, -4, 0], "radius": 0.5}, "material": "lamp"}],
        lights=[{"spot": {**spot, "target": [0, 1, 0]}}, {"spot": {**spot, "direction": [0, 0, 9], "beam_width": 40}}],
    )
    assert found.shapes == (Disk((1, 2, 3), (0, -1, 0), 0.5, 1),) and found.warnings == ()
    assert found.lights[0] == SpotLight((0, 3, 0), (0, -1, 0), (1, 2, 3), 40, 30)
    assert found.lights[1] == SpotLight((0, 3, 0), (0, 0, 1), (1, 2, 3), 40, 40)


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ({"eta": [0.1, 0.2, 0.3], "k": 4}, Conductor((0.1, 0.2, 0.3), (4, 4, 4))),
        ({"eta": 1, "k": 2, "alpha": 0.3, "specular_reflectance": 0.5}, Conductor((1,) * 3, (2,) * 3, (0.3, 0.3), (0.5,) * 3)),
        ({"reflectance": [1, 0.5, 0], "alpha": [0.1, 1e-4]}, Conductor((0,) * 3, (1,) * 3, (0.1, 1e-4), (1, 0.5, 0))),
        ({"reflectance": 1, "alpha": [0, 0], "distribution": "ggx"}, Conductor((0,) * 3, (1,) * 3)),
    ],
)
def test_conductors_are_read(written, meant):
    material = scene(materials={"m": {"conductor": written, "emission": 2}}).materials[0]
    assert material.bsdf == meant and material.emission == (2, 2, 2) and material.kd == (0, 0, 0)


def test_a_conductor_without_an_index_reflects_all_and_gold_is_yellow():
    materials = {"mirror": {"conductor": {"reflectance": [1, 0.5, 0]}}, "gold": {"conductor": {"metal": "Au"}}}
    mirror, gold = (material.bsdf.albedo for material in scene(materials=materials).materials)
    assert mirror == (1, 0.5, 0)
    assert 0.95 < gold[0] < 1 and 0.75 < gold[1] < 0.85 and 0.3 < gold[2] < 0.4


def test_arrays_of_a_scene_are_read_only_and_not_the_callers_own():
    vertices = np.eye(3)
    mesh = scene(shapes=[{"mesh": {"vertices": vertices, "faces": [[0, 1, 2]]}, "material": "m"}]).shapes[0]
    vertices[0, 0] = 9
    assert mesh.vertices[0, 0] == 1 and mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == mesh.materials.dtype == np.int32
    for array in (mesh.vertices, mesh.faces, mesh.materials):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.full((3, 3), np.nan), [[0, 1, 2]], r"vertices\[0\]\[0\] = nan: must be finite"),
        (np.eye(3), np.array([[0, 1, 3]]), r"faces\[0\]\[2\] = 3: must be an integer in \[0, 2\]"),
        (np.eye(3), np.array([[0.0, 1, 2]]), r"must have the shape \(n, 3\)"),
        (np.eye(4), [[0, 1, 2]], r"array \(4, 4\)"),
        (np.array(["a"]), [[0, 1, 2]], "array"),
        (np.zeros((0, 3)), [], "must not be empty"),
    ],
)
def test_wrong_arrays_are_refused(vertices, faces, message):
    with pytest.raises(SceneError, match=message):
        scene(shapes=[{"mesh": {"vertices": vertices, "faces": faces}, "material": "m"}])


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e-30, 1.0, 1e30, 1e200, 1.7e308])
def test_directions_of_any_length_become_unit(length):
    found = scene(shapes=[{"plane": {"point": [0, 0, 0], "normal": [length, length, 0]}, "material": "m"}])
    assert math.hypot(*found.shapes[0].normal) == pytest.approx(1.0, abs=1e-15)


def test_arctan_cameras_are_read_like_pinholes():
    camera = {"type": "perspective_arctan", "eye": [0, 1, 5], "target": [0, 1, 0], "fov": 45, "resolution": [4, 3]}
    assert scene(camera=camera).camera == PerspectiveArctan((0, 1, 5), (0, 1, 0), (0, 1, 0), 45, "y", (4, 3))
    assert scene(camera=camera).content_hash != scene(camera={**camera, "type": "perspective"}).content_hash


def test_orthographic_cameras_are_read():
    camera = {"type": "orthographic", "eye": [0, 1, 5], "target": [0, 1, 0], "height": 5, "resolution": [4, 3]}
    assert scene(camera=camera).camera == Orthographic((0, 1, 5), (0, 1, 0), (0, 1, 0), 5, (4, 3))
    with pytest.raises(SceneError, match=r"camera.height = 0: must be greater than 0"):
        scene(camera=camera | {"height": 0})


def test_what_is_legal_but_rarely_meant_gives_one_warning_each():
    assert scene().warnings == (
        "the scene is empty: it has no shapes",
        "the scene has no light: images that need light will be black",
    )
    assert scene(shapes=None, lights=None).warnings == scene().warnings
    flat = {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [2, 0, 0]}, "material": "m"}
    mesh = {"mesh": {"vertices": np.eye(3), "faces": [[0, 1, 2], [0, 0, 1], [2, 2, 2]]}, "material": "lamp"}
    assert scene(shapes=[flat, mesh]).warnings == ("3 triangles have no area: they are never hit",)
    assert scene(shapes=[flat], lights=[{"environment": {"radiance": 1}}]).warnings == (
        "1 triangle has no area: it is never hit",
    )


@pytest.mark.parametrize("scale", [1e-160, 1e-30, 1.0, 1e30, 1e160, 1e308])
def test_tiny_and_huge_triangles_have_area(scale):
    corners = {"a": [-scale, 0, 0], "b": [scale, 0, 0], "c": [0, scale, 0]}
    assert scene(shapes=[{"triangle": corners, "material": "lamp"}]).warnings == ()


def test_an_emitting_mesh_without_area_is_refused():
    flat = {"mesh": {"vertices": np.eye(3), "faces": [[0, 0, 1], [2, 2, 2]]}, "material": "lamp"}
    with pytest.raises(SceneError, match=r"shapes\[0\]: material 'lamp' emits, but the shape has no area"):
        scene(shapes=[flat])


@pytest.mark.parametrize(
    "material",
    [
        {"kd": 0},
        {"kd": 1},
        {"kd": 0.6, "ks": 0.3, "kt": 0.1},
        {"ks": 1, "kt": 1, "fresnel": True, "ior": 1},
        {"kt": 1, "ior": 1e-3},
        {"kd": 1, "emission": 1e30, "two_sided": True},
        {},
    ],
)
def test_extreme_materials_are_legal(material):
    scene(materials={"m": material})


def test_a_camera_inside_an_object_and_an_image_of_one_pixel_are_legal():
    inside = {"sphere": {"center": [0, 0, 3], "radius": 1}, "material": "lamp"}
    found = scene(camera=CAMERA | {"resolution": [1, 1]}, shapes=[inside])
    assert found.camera.resolution == (1, 1) and found.warnings == ()


def test_bare_names_and_paths_find_the_same_scene(monkeypatch, tmp_path):
    by_name = engines.load_scene("cornell_box")
    assert engines.load_scene(by_name.source).content_hash == by_name.content_hash
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "mine.yaml").write_text(Path(by_name.source).read_text())
    monkeypatch.chdir(tmp_path)
    assert engines.load_scene("mine").content_hash == by_name.content_hash
    assert engines.load_scene(Path("scenes/mine.yaml")).name == by_name.name
    assert engines.load_scene("furnace").name == "furnace"


def _with_mesh(folder, name):
    (folder / "s.yaml").write_text(f"""
raybench_scene: 1
camera: {{type: perspective, eye: [0, 0, 3], target: [0, 0, 0]}}
materials: {{m: {{kd: 0.5}}}}
shapes: [{{mesh: {{file: {name}}}, material: m}}]
""")
    return folder / "s.yaml"


def test_paths_are_confined_to_the_scenes_folder(tmp_path):
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    inner = tmp_path / "inner"
    (inner / "meshes").mkdir(parents=True)
    (inner / "meshes" / "a.obj").write_text(obj)
    (tmp_path / "b.obj").write_text(obj)
    (inner / "link.obj").symlink_to(tmp_path / "b.obj")
    assert len(engines.load_scene(_with_mesh(inner, "meshes/a.obj")).shapes) == 1
    assert len(engines.load_scene(_with_mesh(inner, inner / "meshes/../meshes/a.obj")).shapes) == 1
    for outside in ("../b.obj", tmp_path / "b.obj", "link.obj"):
        file = _with_mesh(inner, outside)
        with pytest.raises(SceneError, match="lies outside the scene's folder"):
            engines.load_scene(file)
        assert len(engines.load_scene(file, allow_outside=True).shapes) == 1


def test_environment_images_are_read_from_the_folder_of_the_scene(tmp_path):
    image = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32)
    write_image(tmp_path / "sky.exr", image)
    lights = [{"environment": {"image": "sky.exr", "radiance": 2}}]
    light = engines.scene_from(BASE | {"lights": lights}, folder=tmp_path).lights[0]
    assert np.array_equal(light.image, image) and light.radiance == (2, 2, 2) and not light.image.flags.writeable
    image[1, 2, 0] = -0.002
    write_image(tmp_path / "sky.exr", image)
    found = engines.scene_from(BASE | {"lights": lights}, folder=tmp_path)
    assert np.array_equal(found.lights[0].image, np.maximum(image, 0))
    (said,) = (warning for warning in found.warnings if "negative" in warning)
    assert said == "lights[0].environment.image: 1 texels with negative radiance, down to -0.002, are taken as 0"
    (tmp_path / "sky.exr").write_bytes(b"garbage")
    with pytest.raises(SceneError, match=r"lights\[0\].environment.image: .*is not a usable image"):
        engines.scene_from(BASE | {"lights": lights}, folder=tmp_path)


class Fisheye:
    name = "fisheye"


def test_camera_plugins_are_imported_only_with_leave():
    camera = {"type": "collections:Counter", "angle": 180, "resolution": [4, 4]}
    with pytest.raises(SceneError, match=r"camera.type = 'collections:Counter': imports code: pass --allow-imports"):
        scene(camera=camera)
    found = engines.scene_from(BASE | {"camera": camera}, allow_imports=True).camera
    assert isinstance(found, CustomCamera) and found.options == {"angle": 180} and found.resolution == (4, 4)
    for missing in ("no_such_module_x:y", "collections:nothing", ":", "a:"):
        with pytest.raises(SceneError, match=f"camera.type = '{missing}': cannot be imported"):
            engines.scene_from(BASE | {"camera": camera | {"type": missing}}, allow_imports=True)


class Own:
    name = "own"
    options = {"color": (1, 1, 1), "position": (0, 0, 0), "width": 0.5}  # noqa: RUF012


PLACES = {"light": lambda body: {"lights": [{"plugin": body}]}, "BSDF": lambda body: {"materials": {"grey": {"plugin": body}}}}


def of_plugin(place, body, **leave):
    made = engines.scene_from(BASE | PLACES[place](body), **leave)
    return made.lights[0] if place == "light" else made.materials[0].bsdf


@pytest.mark.parametrize("place", PLACES)
def test_light_and_bsdf_plugins_have_their_options_in_order(place):
    found = of_plugin(place, {"type": Own(), "width": 1, "color": 0.25})
    assert isinstance(found, CustomLight | CustomBSDF)
    assert list(found.options.items()) == [("color", (0.25,) * 3), ("position", (0.0,) * 3), ("width", 1.0)]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ({"type": Own(), "widht": 1}, r"plugin.widht: unknown key: did you mean 'width'\? known: color, position, type, width"),
        ({"type": Own(), "width": [1, 2, 3]}, r"plugin.width: must be a number"),
        ({"type": Own(), "width": float("inf")}, r"plugin.width = inf: must be finite"),
        ({"type": Own(), "position": [1, 2]}, r"plugin.position: must be three numbers"),
        ({"type": Own(), "color": "red"}, r"plugin.color = 'red': must be three numbers"),
        ({"width": 1}, r"plugin.type: is missing"),
        ({"type": "own"}, r"plugin.type = 'own': must be module:attribute"),
        ({"type": 3}, r"plugin.type = 3: must be text"),
        ({"type": object()}, r"plugin.type = .*: is no (light|BSDF) plugin: it has no `options`"),
        (4, r"plugin = 4: must be a mapping with a type, module:attribute"),
    ],
)
@pytest.mark.parametrize("place", PLACES)
def test_what_is_wrong_with_a_plugin_is_said(place, body, said):
    with pytest.raises(SceneError, match=said):
        of_plugin(place, body)


@pytest.mark.parametrize("place", PLACES)
def test_light_and_bsdf_plugins_are_imported_only_with_leave(place):
    with pytest.raises(SceneError, match=r"plugin.type = 'collections:Counter': imports code: pass --allow-imports"):
        of_plugin(place, {"type": "collections:Counter"})
    with pytest.raises(SceneError, match=r"plugin.type = 'no_such_module_x:y': cannot be imported"):
        of_plugin(place, {"type": "no_such_module_x:y"}, allow_imports=True)


def test_a_camera_plugin_that_lists_its_options_has_them_in_order():
    camera = {"type": Own(), "width": 1, "resolution": [4, 4]}
    found = engines.scene_from(BASE | {"camera": camera}).camera
    assert list(found.options.items()) == [("color", (1.0,) * 3), ("position", (0.0,) * 3), ("width", 1.0)]
    with pytest.raises(SceneError, match=r"camera.widht: unknown key: did you mean 'width'\?"):
        engines.scene_from(BASE | {"camera": camera | {"widht": 1}})


def test_options_that_a_plugin_lacks_are_refused_from_python_too():
    with pytest.raises(UnknownName, match="unknown option of the light 'own' 'with': did you mean 'width'"):
        CustomLight(Own(), {"with": 1})


def test_a_material_has_a_plugin_or_lobes():
    with pytest.raises(SceneError, match="kd: either plugin, or kd, ks"):
        engines.scene_from(BASE | {"materials": {"grey": {"plugin": {"type": Own()}, "kd": 1}}})


def test_a_camera_plugin_may_be_given_as_an_object_from_python():
    plugin = Fisheye()
    found = scene(camera={"type": plugin, "angle": 90}).camera
    assert isinstance(found, CustomCamera) and isinstance(found.plugin, Fisheye) and found.options == {"angle": 90}
