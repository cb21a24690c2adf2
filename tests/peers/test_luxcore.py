"""The engine luxcore, in a process of its own: its conformance, its images against numba's, and what it declines."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.conformance import check_engine
from engines.packages import install_extra
from engines.peers.luxcore import Engine
from engines.peers.luxcore.description import importances
from harness.config import paths
from harness.statistics.equivalence import equivalence
from tests.needs import needs
from tests.plain_scene import plain_scene

NAME = "engines.peers.luxcore:Engine"
DEEP = {"name": "path_tracer", "max_depth": 8, "rr_depth": 8}
SETTINGS = Settings(32, 32, shader=DEEP, sampler="random", precision="float32", threads=2, seed=3)
installed = needs("luxcore")


@pytest.fixture(scope="module")
def luxcore():
    return engines.engine(NAME)


def replicates(engine, held, count=6, spp=24):
    """(count, h, w, 3) independent images, and the renderer."""
    renderer = engine.prepare(held, SETTINGS)
    sums, counts = [np.zeros((32, 32, 3))], [np.zeros((32, 32), int)]
    for _ in range(count):
        film = renderer.render(spp)
        sums.append(film.sums.copy())
        counts.append(film.counts.copy())
    return np.diff(sums, axis=0) / np.diff(counts, axis=0)[..., None], renderer


def test_nothing_of_luxcore_is_imported_before_it_is_used():
    script = f"import engines, sys; engines.engine({NAME!r}).accelerators(); print('pyluxcore' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_what_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr("engines.peers.adapters.engine.util.find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, "pyluxcore", raising=False)
    assert install_extra("luxcore") in str(Engine().why_not(plain_scene(), SETTINGS))


@pytest.mark.parametrize(
    ("material", "shader", "words"),
    [
        ({"kd": 0.5}, {**DEEP, "rr_depth": 5}, "roulette"),
        ({"kd": 0.5}, {**DEEP, "max_depth": 1}, "max_depth from 2 to"),
        ({"kd": 0.5}, {**DEEP, "light_sampler": "bvh"}, "uniform or power"),
        ({"kd": 0.5}, {**DEEP, "transparent_shadows": True}, "transparent_shadows False"),
        ({"kd": 0.5}, {**DEEP, "hide_emitters": True}, "hide_emitters False"),
        ({"kt": 0.9, "ior": 1.9}, DEEP, "Fresnel"),
        ({"kd": [0.9, 0, 0], "ks": [0, 0.9, 0]}, DEEP, "more than 1"),
        ({"conductor": {"metal": "Au"}}, DEEP, "smooth metal"),
        ({"conductor": {"reflectance": 0.9, "alpha": 0.1}}, DEEP, "rough conductors"),
        ({"dielectric": {"alpha": 0.1}}, DEEP, "rough glass"),
        ({"emission": 2}, DEEP, "triangles only"),
    ],
)
def test_what_has_no_exact_counterpart_is_declined(material, shader, words):
    with pytest.raises(Unsupported, match=words):
        Engine().prepare(plain_scene(**material), Settings(8, 8, shader=shader, sampler="random"))


def test_textures_that_are_looked_up_otherwise_are_declined():
    image = {"image": np.full((2, 2, 3), 0.5, np.float32)}
    held = engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "image",
            "camera": {"type": "perspective", "eye": [0, 0, 8], "target": [0, 0, 0]},
            "textures": {"it": {**image, "filter": "nearest"}},
            "materials": {"it": {"kd": "it"}},
            "shapes": [{"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "material": "it"}],
            "lights": [{"environment": {"radiance": 1}}],
        }
    )
    assert "bilinear, repeated" in str(Engine().why_not(held, SETTINGS))


@installed
def test_luxcore_conforms(luxcore):
    found = check_engine(luxcore)
    assert [str(finding) for finding in found if finding.verdict == "broken"] == []
    held = {finding.key for finding in found if finding.ok}
    assert {"images_are_upright", "the_furnace_is_uniform", "stop_from_a_thread_ends_the_render"} <= held


@installed
@pytest.mark.parametrize(("name", "power"), [("cornell_box", 0.05), ("cornell_mesh", 0.05), ("two_spheres", 0.08)])
def test_luxcore_and_numba_make_the_same_image(luxcore, name, power):
    """`power`: the bound on the difference of the image means that the test must reach."""
    held = engines.load_scene(paths.find("scenes", name))
    theirs, renderer = replicates(luxcore, held)
    found = equivalence(list(replicates(engines.engine("numba"), held)[0]), list(theirs))
    assert found.verdict != "different", found
    assert found.image_bound < power, f"a test that could have seen nothing: {found}"
    assert renderer.counters()["bad_samples"] == 0


@installed
def test_the_film_counts_what_pixels_have(luxcore):
    renderer = luxcore.prepare(plain_scene(), SETTINGS)
    for total in (40, 80):
        film = renderer.render(40)
        assert film.counts.min() >= total
        np.testing.assert_allclose(film.counts.mean() - total, renderer.counters()["surplus_samples"], rtol=1e-9)
    assert np.isfinite(film.variance_of_mean()).all()


@installed
def test_calls_do_not_repeat_their_samples_and_seeds_matter(luxcore):
    lit = plain_scene()
    (one, two), _ = replicates(luxcore, lit, 2, 8)
    assert (one != two).any()
    other = luxcore.prepare(lit, Settings(32, 32, shader=DEEP, sampler="random", seed=4)).render(8).mean()
    assert (one != other).any()


@installed
def test_images_on_diffuse_surfaces_lie_where_numpy_has_them(luxcore):
    """Steep texels, repeated, under texture coordinates that are turned and moved."""
    pixels = np.random.default_rng(1).random((3, 4, 3)).astype(np.float32)
    corners, uvs = ([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], [[-0.2, 1.3], [1.2, 1.3], [1.2, -0.2], [-0.2, -0.2]])
    held = engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "image",
            "camera": {"type": "perspective", "eye": [0, 0, 8], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40},
            "textures": {"it": {"image": pixels, "filter": "bilinear", "to_uv": [[0.8, 0.3, 0.1], [-0.2, 0.9, 0.3]]}},
            "materials": {"it": {"kd": "it"}},
            "shapes": [{"mesh": {"vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]], "uvs": uvs}, "material": "it"}],
            "lights": [{"directional": {"direction": [0, 0, -1], "irradiance": 3}}],
        }
    )
    there = luxcore.prepare(held, SETTINGS).render(64).mean()
    ours = engines.engine("numpy").prepare(held, replace(SETTINGS, precision="float64")).render(64).mean()
    np.testing.assert_allclose(there, ours, atol=0.03 * ours.max())
    assert ours.std(axis=(0, 1)).min() > 0.1 * ours.max(), "the image must have contrast"


def test_triangles_of_area_lights_share_the_probability_of_their_shape():
    """Two shapes of one material, of 3 triangles together; a triangle that emits on both sides is two."""
    corners = {"a": [0, 0, 1], "b": [1, 0, 1], "c": [0, 1, 1]}
    quad = {"name": "rectangle", "corner": [0, 0, 0], "edge1": [1, 0, 0], "edge2": [0, 1, 0]}
    held = engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "lamps",
            "camera": {"type": "perspective", "eye": [0, 0, 8], "target": [0, 0, 0]},
            "materials": {"dull": {"kd": 0.5}, "one": {"emission": 1}, "both": {"emission": 1, "two_sided": True}},
            "shapes": [
                {"procedural": quad, "material": "one"},
                *({"triangle": corners, "material": name} for name in ("one", "both", "dull")),
            ],
        }
    )
    assert importances(held).tolist() == [1.0, 2 / 3, 1 / 2]
