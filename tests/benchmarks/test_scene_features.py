"""What "model only what a scene needs" buys: kernels made for the scene against kernels made for any scene, 4 samples of
128x128 a round. The general ones carry every kind of shape, light and lobe but the image of an environment, no textures and
no wrappers, and none of the tables that some integrators learn."""

import pytest

import engines
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import lights, materials
from engines.kernels.flatten import scene as flatten_scene

PROGRAMS = "programs", "textures", "attributes", "textured_emission", "light_frames", "uvs", "choices", "masks", "tilts"
TABLES = "power_lights", "light_hierarchy", "light_cells", "turned_environment", "guided"
SCENES = ["cornell_box", "two_spheres", "furnace"]
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@pytest.mark.parametrize("kernels", ["made_for_the_scene", "made_for_any_scene"])
@pytest.mark.parametrize("scene", SCENES)
def test_paths(benchmark, monkeypatch, scene, kernels):
    if kernels == "made_for_any_scene":
        kinds = tuple(kind for kind in lights.MODELS if kind != lights.IMAGE_ENVIRONMENT)
        own = {"lights": kinds, "bsdfs": (materials.MIXTURE,), "analytic": (), **dict.fromkeys(PROGRAMS + TABLES, False)}
        every = SceneFeatures(**{name: own.get(name, True) for name in SceneFeatures._fields})
        monkeypatch.setattr(flatten_scene, "_features", lambda *_: every)
    shader = {"name": "path_tracer", "max_depth": 6, "rr_depth": 1000}
    settings = engines.Settings(width=128, height=128, shader=shader, sampler="sobol", precision="float32")
    renderer = engines.engine("numba").prepare(engines.load_scene(scene), settings)
    renderer.warm_up()
    benchmark(renderer.render, 4)
