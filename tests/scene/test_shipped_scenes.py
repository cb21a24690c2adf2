"""The scenes that come with raybench: what they hold, to the digit where others compare with them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.scene import (
    DirectionalLight,
    EnvironmentLight,
    Mesh,
    Orthographic,
    Perspective,
    PerspectiveArctan,
    Plane,
    PointLight,
    Sphere,
    SpotLight,
    Triangle,
)
from engines.scene.files import scene_names
from engines.scene.geometry import face_normals

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SHIPPED = sorted(file.stem for file in SCENES.glob("*.yaml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_scene_loads_without_warning_and_says_where_it_comes_from(name):
    assert engines.load_scene(name).warnings == ()
    first = (SCENES / f"{name}.yaml").read_text().splitlines()[0]
    assert first.startswith("# ")


def test_scenes_are_listed_by_bare_name():
    assert len(SHIPPED) > 20 and {*SHIPPED, "lantern"} <= set(scene_names())
    assert engines.load_scene("lantern").source.endswith("lantern.xml")


def test_the_gallery_shows_every_shipped_scene():
    text = (SCENES.parent / "docs" / "gallery.md").read_text()
    pictures = SCENES.parent / "docs" / "pictures" / "gallery"
    shown = set(re.findall(r"pictures/gallery/(\w+\.\w+)", text))
    assert {file.name for file in pictures.iterdir()} == shown
    models = [file.stem for file in SCENES.glob("*.glb")]
    assert {Path(name).stem for name in shown} == {*SHIPPED, *models, "dahlquist_port"}
    sizes = [file.stat().st_size for file in pictures.iterdir()]
    assert max(sizes) < 1_000_000 and sum(sizes) < 6_000_000


def test_textures_are_small_and_each_has_a_function_that_draws_it():
    files = list((SCENES / "textures").glob("*.*"))
    drawn = re.findall(r"^def (\w+)\(\):", (SCENES / "textures" / "make.py").read_text(), re.M)
    assert sum(file.stat().st_size for file in files) < 3_000_000
    assert {file.stem for file in files if file.suffix != ".py"} == set(drawn)


def test_the_watch_is_a_small_file_with_its_own_camera_and_lamps():
    file = SCENES / "watch.glb"
    scene = engines.load_scene(file)
    assert file.stat().st_size < 300_000
    assert all("clear coat" in text or "between its cones" in text for text in scene.warnings)
    assert isinstance(scene.camera, Perspective) and [type(light) for light in scene.lights] == [SpotLight]
    assert sum(material.emits for material in scene.materials) == 3


@pytest.mark.parametrize("name", ["dusty_room", "milk"])
def test_scenes_with_media_bound_them(name):
    scene = engines.load_scene(name)
    assert len(scene.media) == 1 and any(shape.interior != shape.exterior for shape in scene.shapes)


def test_the_living_room_has_the_triangles_and_materials_of_a_furnished_room():
    scene = engines.load_scene("living_room")
    assert 90_000 < face_count(scene) < 150_000
    assert {type(material.bsdf).__name__ for material in scene.materials} >= {"Bump", "Mask", "Plastic", "Dielectric"}


def face_count(scene):
    return sum(len(shape.faces) for shape in scene.shapes if isinstance(shape, Mesh))


def test_the_cornell_box_is_exact():
    scene = engines.load_scene("cornell_box")
    assert scene.camera == Perspective((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077, "y", (256, 256))
    assert len(scene.shapes) == 8 and face_count(scene) == 36 and scene.lights == ()
    white, green, red, light = (
        (0.885809, 0.698859, 0.666422),
        (0.105421, 0.37798, 0.076425),
        (0.570068, 0.0430135, 0.0443706),
        (18.387, 13.9873, 6.75357),
    )
    normals = [(0, 1, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (1, 0, 0), (0, -1, 0)]
    colors = [white, white, white, green, red, white]
    boxes = [
        [(-1, 1), (-1, -1), (-1, 1)],
        [(-1, 1), (1, 1), (-1, 1)],
        [(-1, 1), (-1, 1), (-1, -1)],
        [(1, 1), (-1, 1), (-1, 1)],
        [(-1, -1), (-1, 1), (-1, 1)],
        [(-0.23, 0.23), (0.99, 0.99), (-0.18, 0.2)],
    ]
    for shape, normal, color, box in zip(scene.shapes[:6], normals, colors, boxes, strict=True):
        found = face_normals(shape.vertices, shape.faces)
        assert np.array_equal(found / np.linalg.norm(found, axis=1, keepdims=True), [normal] * 2)
        assert [(low, high) for low, high in zip(shape.vertices.min(0), shape.vertices.max(0), strict=True)] == box
        assert scene.materials[shape.materials[0]].kd == color
    emitting = [shape for shape in scene.shapes if scene.materials[shape.materials[0]].emits]
    assert emitting == [scene.shapes[5]]
    lamp = scene.materials[emitting[0].materials[0]]
    assert lamp.emission == light and not lamp.two_sided


@pytest.mark.parametrize(
    ("index", "half", "center", "degrees"),
    [(6, (0.3, 0.3, 0.3), (0.335, -0.7, 0.38), -17), (7, (0.3, 0.61, 0.3), (-0.33, -0.4, -0.28), 18.25)],
)
def test_the_boxes_of_the_cornell_box_are_turned_the_right_way(index, half, center, degrees):
    shape = engines.load_scene("cornell_box").shapes[index]
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    corners = {
        tuple(np.round([x * cos + z * sin + center[0], y + center[1], z * cos - x * sin + center[2]], 12))
        for x in (-half[0], half[0])
        for y in (-half[1], half[1])
        for z in (-half[2], half[2])
    }
    assert {tuple(vertex) for vertex in np.round(shape.vertices, 12)} == corners


def test_mesh_sphere_is_the_cornell_room_with_a_large_mesh():
    box, mesh = engines.load_scene("cornell_box"), engines.load_scene("mesh_sphere")
    assert mesh.camera == box.camera and face_count(mesh) == 12 + 81_920
    for ours, theirs in zip(mesh.shapes[:6], box.shapes[:6], strict=True):
        assert np.array_equal(ours.vertices, theirs.vertices)
    assert np.allclose(np.linalg.norm(mesh.shapes[6].vertices - [0, -0.4, 0], axis=1), 0.6)


def test_cornell_spheres_is_mobilerts_scene_with_z_negated():
    scene = engines.load_scene("cornell_spheres")
    kinds = [type(shape).__name__ for shape in scene.shapes]
    assert kinds == ["Plane"] * 6 + ["Sphere"] * 2 + ["Triangle"] * 4
    for plane in scene.shapes[:6]:
        assert isinstance(plane, Plane) and np.dot(np.array(scene.camera.eye) - plane.point, plane.normal) > 0
    mirror, glass = (shape for shape in scene.shapes if isinstance(shape, Sphere))
    assert (mirror.center, mirror.radius) == ((0.45, -0.65, -0.4), 0.35)
    assert scene.materials[mirror.material].ks == (0.9,) * 3
    assert scene.materials[glass.material].kt == (0.9,) * 3 and scene.materials[glass.material].ior == 1.9
    assert scene.materials[scene.shapes[10].material].two_sided


def test_the_four_scenes_of_mobilert_hold_what_it_holds():
    """Counts by kind: planes, spheres, triangles, point lights; the cameras are its own."""
    wanted = {"cornell": (6, 2, 1, 1), "cornell2": (6, 2, 4, 0), "spheres": (0, 1, 1, 0), "spheres2": (1, 5, 0, 1)}
    for name, counts in wanted.items():
        scene = engines.load_scene(f"mobilert_{name}")
        held = [sum(isinstance(shape, kind) for shape in scene.shapes) for kind in (Plane, Sphere, Triangle)]
        assert (*held, sum(isinstance(light, PointLight) for light in scene.lights)) == counts
        for plane in (shape for shape in scene.shapes if isinstance(shape, Plane)):
            assert np.dot(np.subtract(scene.camera.eye, plane.point), plane.normal) > 0, "the front faces the camera"
        assert isinstance(scene.camera, Orthographic if name == "spheres" else PerspectiveArctan)
    assert engines.load_scene("mobilert_spheres").camera.height == 5


def test_the_back_wall_begins_where_mobilert_draws_it():
    """Its left edge was seen at column 53 of 256 and by formula lies at 52.8; a pinhole of 45 degrees shows it at 57.8."""
    from engines.numpy_reference.camera import camera_rays

    columns = np.linspace(0, 256, 100_001)
    scene = engines.load_scene("mobilert_cornell")
    origins, directions = camera_rays(scene.camera, columns, np.full_like(columns, 128.0), 256, 256)
    x = (origins + directions * (-1 - origins[2]) / directions[2])[0]
    assert columns[np.abs(x + 1).argmin()] == pytest.approx(52.8, abs=0.1)


@pytest.mark.parametrize(
    ("name", "file"), [("water", "CornellBox-Water.obj"), ("teapot", "teapot.obj"), ("conference", "conference.obj")]
)
def test_views_of_mobilerts_meshes_work_with_a_file_beside_them_and_say_which_is_missing(tmp_path, name, file):
    scene = tmp_path / f"{name}.yaml"
    scene.write_text((SCENES / "mobilert" / f"{name}.yaml").read_text())
    with pytest.raises(SceneError, match=rf"{name}.yaml:7 shapes\[0\].mesh.file = '{file}': no such file: looked in"):
        engines.load_scene(scene)
    (tmp_path / "paint.mtl").write_text("newmtl paint\nKd 0.5 0.25 0.125\n")
    (tmp_path / file).write_text("mtllib paint.mtl\nv -500 0 0\nv 500 0 0\nv 0 900 0\nusemtl paint\nf 1 2 3\n")
    found = engines.load_scene(scene)
    assert isinstance(found.camera, PerspectiveArctan) and found.materials[0].kd == (0.5, 0.25, 0.125)
    settings = engines.Settings(8, 8, shader="albedo", sampler="random")
    image = engines.engine("numpy").prepare(found, settings).render(1).mean()
    assert image[4, 4] == pytest.approx((0.5, 0.25, 0.125)), "the camera looks at the mesh"


def test_the_furnace_has_emission_and_albedo_one_half_on_both_sides():
    scene = engines.load_scene("furnace")
    (material,) = scene.materials
    assert material.kd == material.emission == (0.5,) * 3 and material.two_sided and scene.lights == ()
    assert face_count(scene) == 12


def test_the_terrain_has_a_sun_a_sky_and_many_triangles():
    scene = engines.load_scene("terrain")
    assert face_count(scene) >= 50_000
    assert [type(light) for light in scene.lights] == [DirectionalLight, EnvironmentLight]
