"""What "model only what a scene needs" buys: kernels made for the scene against kernels made for any scene, 4 samples of
128x128 a round. The general ones carry every kind of shape, light and lobe but the image of an environment."""

import pytest

import engines
from engines.kernels import world

SCENES = ["cornell_box", "two_spheres", "furnace"]
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@pytest.mark.parametrize("kernels", ["made_for_the_scene", "made_for_any_scene"])
@pytest.mark.parametrize("scene", SCENES)
def test_paths(benchmark, monkeypatch, scene, kernels):
    if kernels == "made_for_any_scene":
        every = world.Needs(**{name: name != "image_sky" for name in world.Needs._fields})
        monkeypatch.setattr(world, "_needs", lambda *_: every)
    shader = {"name": "path_tracer", "max_depth": 6, "rr_depth": 1000}
    settings = engines.Settings(width=128, height=128, shader=shader, sampler="sobol", precision="float32")
    renderer = engines.engine("numba").prepare(engines.load_scene(scene), settings)
    renderer.warm_up()
    benchmark(renderer.render, 4)
