"""The engine cycles: its shapes and lookups, what it declines; where there is a Python with bpy, conformance and images."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.conformance import check_engine
from engines.peers.adapters.tessellation import disk_mesh, squares
from engines.peers.cycles import Engine, geometry
from engines.peers.cycles.nodes import _tall, looked_up
from engines.scene import Disk, EnvironmentLight, Plane
from harness.config import paths
from harness.statistics.equivalence import equivalence
from tests.needs import needs

NAME = "engines.peers.cycles:Engine"
PATH = {"name": "path_tracer", "max_depth": 8, "rr_depth": 8}
SETTINGS = Settings(32, 32, shader=PATH, sampler="sobol", precision="float32", threads=2, seed=3)
installed = needs("cycles")


def scene(shape=None, light=None, **material):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "plain",
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "textures": {"wide": {"image": np.full((2, 2, 3), 1.5, np.float32)}, "half": {"checkerboard": {}}},
            "materials": {"it": material or {"kd": 0.5}},
            "shapes": [{**(shape or {"sphere": {"center": [0, 0, 0], "radius": 1}}), "material": "it"}],
            "lights": [{"environment": light or {"radiance": 1}}],
        }
    )


def normals(vertices, faces):
    corners = np.asarray(vertices)[faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_a_disk_of_triangles_has_the_area_and_the_front_of_the_disk():
    made = disk_mesh(Disk((1.0, 2.0, 3.0), (0.6, 0.0, -0.8), 2.0, 0), geometry.DISK_EDGES, same_area=True)
    found = normals(made.vertices, made.faces)
    np.testing.assert_allclose(found.sum(axis=0) / 2, 4 * np.pi * np.array([0.6, 0.0, -0.8]), atol=1e-12)


def test_a_sphere_of_triangles_has_the_area_of_the_sphere_and_faces_outwards():
    vertices, faces, smooth = geometry.tessellated(geometry.SphereGroup(0, np.array([[1.0, 2.0, 3.0]]), np.array([0.5])))
    found = normals(vertices, faces)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1).sum() / 2, np.pi, rtol=1e-12)
    assert (np.einsum("ij,ij->i", found, smooth[faces[:, 0]]) > 0).all()


def test_rings_of_a_plane_cover_it_and_have_its_front():
    plane = Plane((0.0, 1.0, 0.0), (0.0, 0.6, 0.8), 0)
    found = normals(*squares(plane, 2.0 * geometry.GROWTH ** np.arange(geometry.RINGS)))
    half = 2.0 * geometry.GROWTH ** (geometry.RINGS - 1)
    np.testing.assert_allclose(found.sum(axis=0) / 2, (2 * half) ** 2 * np.array(plane.normal), rtol=1e-9, atol=1.0)
    assert (found @ plane.normal > 0).all()


def test_normals_that_point_to_the_back_of_their_faces_reach_cycles_on_the_front():
    vertices, faces, smooth = geometry.tessellated(geometry.SphereGroup(0, np.zeros((1, 3)), np.ones(1)))
    for given in (smooth, -smooth):
        found = geometry._fronts_agree(geometry.FlatMesh("ball", 0, vertices, faces, given)).normals
        np.testing.assert_array_equal(found, smooth)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_an_environment_is_looked_up_where_raybench_does(mirror):
    axes = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    rotation = axes * np.sign(np.linalg.det(axes)) * np.array([[mirror], [1.0], [1.0]])
    matrix, flipped = looked_up(EnvironmentLight((1.0, 1.0, 1.0), None, tuple(map(tuple, rotation))))
    assert flipped == (mirror < 0) and np.linalg.det(matrix) > 0
    for direction in np.random.default_rng(6).normal(size=(20, 3)):
        x, y, z = rotation.T @ direction / np.linalg.norm(direction)
        there = matrix @ direction / np.linalg.norm(direction)
        u = 0.5 - np.arctan2(there[1], there[0]) / (2 * np.pi)  # Blender's
        u = 1 - u if flipped else u
        assert np.isclose((np.arctan2(x, -z) / (2 * np.pi) - u + 0.5) % 1, 0.5)
        assert np.isclose(np.arcsin(there[2]), np.pi / 2 - np.arccos(y))
        assert np.isfinite(z)


def test_an_image_of_few_rows_gets_more_that_lie_between_them():
    image = np.random.default_rng(7).random((8, 4, 3))
    tall = _tall(image)
    times = len(tall) // len(image)
    assert len(tall) >= 256 and times % 2 == 1
    np.testing.assert_array_equal(tall[times // 2 :: times], image)
    np.testing.assert_allclose(tall[times], image[0] + (image[1] - image[0]) * (times // 2 + 1) / times, rtol=1e-12)


@pytest.mark.parametrize(
    ("held", "shader", "words"),
    [
        (scene(kt=0.9, ior=1.9), PATH, "without Fresnel"),
        (scene(plastic={}), PATH, "Plastic"),
        (scene(conductor={"metal": "Au", "alpha": 0.3}), PATH, "roughness above 0.1"),
        (scene(conductor={"metal": "Au", "alpha": [0.1, 0.2]}), PATH, "each tangent"),
        (scene(conductor={"metal": "Au", "specular_reflectance": 0.5}), PATH, "has a factor"),
        (scene(dielectric={"alpha": 0.1, "specular_reflectance": 0.5}), PATH, "with a tint"),
        (scene(null={}), PATH, "no segments there"),
        (scene(kd="half"), PATH, "not on a Sphere"),
        (scene(kd="wide"), PATH, "leave the range"),
        (scene({"cylinder": {"p0": [0, 0, 0], "p1": [0, 1, 0], "radius": 1}}), PATH, "Cylinder"),
        (scene(light={"image": np.ones((4, 8, 3)), "rows": "poles"}), PATH, "poles"),
        (scene(), {**PATH, "direct": "bsdf"}, "direct mis"),
        (scene(), {**PATH, "light_sampler": "power"}, "uniform or bvh"),
        (scene(), {**PATH, "transparent_shadows": True}, "transparent_shadows False"),
        (scene(), {**PATH, "hide_emitters": True}, "hide_emitters False"),
        (scene(), {**PATH, "max_depth": 2000}, "max_depth from 1 to"),
        (scene(), "whitted", "no shader whitted"),
    ],
)
def test_what_has_no_exact_counterpart_is_declined(held, shader, words):
    with pytest.raises(Unsupported, match=words):
        Engine().prepare(held, Settings(8, 8, shader=shader, sampler="sobol"))


def test_what_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr("engines.peers.adapters.engine.util.find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    assert "docs/guides/cycles.md" in str(Engine().why_not(scene(), SETTINGS))


def test_nothing_of_blender_is_imported_before_it_is_used():
    script = f"import engines, sys; engines.engine({NAME!r}).accelerators(); print('bpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@installed
def test_cycles_conforms():
    found = check_engine(engines.engine(NAME))
    assert [str(finding) for finding in found if finding.verdict == "broken"] == []
    held = {finding.key for finding in found if finding.verdict == "holds"}
    assert {"images_are_upright", "the_furnace_is_uniform", "threads_change_nothing"} <= held


def replicates(engine, held, count=6, spp=32):
    """(count, h, w, 3) images of other seeds."""
    made = (engine.prepare(held, Settings(32, 32, shader=PATH, sampler="sobol", threads=2, seed=k)) for k in range(count))
    return [renderer.render(spp).mean() for renderer in made]


@installed
@pytest.mark.parametrize(("name", "power"), [("cornell_box", 0.05), ("cornell_mesh", 0.05), ("two_spheres", 0.08)])
def test_cycles_and_numba_make_the_same_image(name, power):
    """`power`: the bound on the difference of the image means that the test must reach."""
    held = engines.load_scene(paths.find("scenes", name))
    found = equivalence(replicates(engines.engine("numba"), held), replicates(engines.engine(NAME), held))
    assert found.verdict != "different", found
    assert found.image_bound < power, f"a test that could have seen nothing: {found}"


@installed
def test_the_light_tree_finds_small_bright_lights_and_leaves_the_mean():
    """Of the choice by area the variance is some twenty times as large at these samples."""
    held = engines.load_scene(paths.find("scenes", "veach_plates"))
    spread, means = [], []
    for chosen in ("uniform", "bvh"):
        settings = replace(SETTINGS, shader={**PATH, "light_sampler": chosen})
        images = [engines.engine(NAME).prepare(held, replace(settings, seed=seed)).render(16).mean() for seed in range(4)]
        below = np.array(images)[:, 20:]  # no lamp is seen there
        spread.append(below.var(axis=0, ddof=1).mean())
        means.append(below.mean(axis=(1, 2, 3)))
    assert 5.0 * spread[1] < spread[0]
    error = np.hypot(*(each.std(ddof=1) / 2 for each in means))
    assert abs(means[0].mean() - means[1].mean()) < 4.0 * error


@installed
def test_calls_continue_the_sequence_and_seeds_matter():
    whole, split, other = (
        engines.engine(NAME).prepare(scene(), Settings(32, 32, shader=PATH, sampler="sobol", seed=seed)) for seed in (3, 3, 4)
    )
    split.render(3)
    image = whole.render(8).mean()
    np.testing.assert_allclose(split.render(5).mean(), image, rtol=1e-5)
    assert (other.render(8).mean() != image).any()


@installed
def test_a_constant_environment_is_one_of_the_lights_and_pixels_share_no_samples():
    """A plane in the sun: where Cycles does not sample the environment, every sample has the same radiance."""
    held = engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "plain",
            "camera": {"type": "orthographic", "eye": [0, 3, 2], "target": [0, 0, 0], "up": [0, 1, 0], "height": 1},
            "materials": {"it": {"kd": 0.5}},
            "shapes": [{"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "it"}],
            "lights": [{"environment": {"radiance": 1}}, {"directional": {"direction": [0, -1, 0], "irradiance": 1}}],
        }
    )
    settings = Settings(64, 64, shader={"name": "path_tracer", "max_depth": 2}, sampler="sobol", precision="float32", seed=3)
    image = engines.engine(NAME).prepare(held, settings).render(1).mean()[..., 0]
    exact = replace(settings, precision="float64")
    ours = engines.engine("numpy").prepare(held, exact).render(1).mean()[..., 0]
    assert image.var() > ours.var() > 0.0 and image.mean() == pytest.approx(ours.mean(), rel=0.02)
    error = image - image.mean()
    for one, other in ((error[1:], error[:-1]), (error[:, 1:], error[:, :-1])):
        assert abs((one * other).mean()) < 0.06 * image.var(), "neighbouring pixels share samples"
