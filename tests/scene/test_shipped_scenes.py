"""The scenes that come with raybench: what they hold, to the digit where others compare with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import engines
from engines.scene import DirectionalLight, EnvironmentLight, Mesh, Perspective, Plane, Sphere
from engines.scene.files import scene_names
from engines.scene.geometry import face_normals

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SHIPPED = ["cornell_box", "cornell_spheres", "furnace", "mesh_sphere", "terrain", "two_spheres"]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_scene_loads_without_warning_and_says_where_it_comes_from(name):
    assert engines.load_scene(name).warnings == ()
    first = (SCENES / f"{name}.yaml").read_text().splitlines()[0]
    assert first.startswith("# ")


def test_scenes_are_listed_by_bare_name():
    assert set(SHIPPED) <= set(scene_names())


def face_count(scene):
    return sum(len(shape.faces) for shape in scene.shapes if isinstance(shape, Mesh))


def test_the_cornell_box_is_exact():
    scene = engines.load_scene("cornell_box")
    assert scene.camera == Perspective((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077, "y", (256, 256))
    assert len(scene.shapes) == 8 and face_count(scene) == 36 and scene.lights == ()
    white, green, red, light = ((0.885809, 0.698859, 0.666422), (0.105421, 0.37798, 0.076425),
                                (0.570068, 0.0430135, 0.0443706), (18.387, 13.9873, 6.75357))  # fmt: skip
    normals = [(0, 1, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (1, 0, 0), (0, -1, 0)]
    colors = [white, white, white, green, red, white]
    boxes = [[(-1, 1), (-1, -1), (-1, 1)], [(-1, 1), (1, 1), (-1, 1)], [(-1, 1), (-1, 1), (-1, -1)],
             [(1, 1), (-1, 1), (-1, 1)], [(-1, -1), (-1, 1), (-1, 1)],
             [(-0.23, 0.23), (0.99, 0.99), (-0.18, 0.2)]]  # fmt: skip
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
        for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (-half[2], half[2])
    }  # fmt: skip
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


def test_the_furnace_has_emission_and_albedo_one_half_on_both_sides():
    scene = engines.load_scene("furnace")
    (material,) = scene.materials
    assert material.kd == material.emission == (0.5,) * 3 and material.two_sided and scene.lights == ()
    assert face_count(scene) == 12


def test_the_terrain_has_a_sun_a_sky_and_many_triangles():
    scene = engines.load_scene("terrain")
    assert face_count(scene) >= 50_000
    assert [type(light) for light in scene.lights] == [DirectionalLight, EnvironmentLight]
