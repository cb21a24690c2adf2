"""The five spheres in raybench's terms: the shipped scene, the port as an engine, and how near other engines come."""

import numpy as np
import pytest

import engines
from engines import Settings, dahlquist
from engines.dahlquist import physical
from engines.image import read_image
from engines.scene import load_scene
from harness.config import paths

FRAME = {"shader": {"name": "whitted", "max_depth": 6, "ambient": 0.0}, "sampler": {"name": "constant", "value": 0.0}}


@pytest.fixture(scope="module")
def scene():
    return load_scene(paths.find("scenes", "dahlquist"))


@pytest.fixture(scope="module")
def eleventh():
    animation = dahlquist.Animation()
    for _ in range(11):
        animation.step(3000)
    return animation.centres


def test_the_shipped_scene_is_the_eleventh_call(scene, eleventh):
    mapping = physical.scene(eleventh, "dahlquist_sky.exr")
    centers = [shape["sphere"]["center"] for shape in mapping["shapes"]]
    assert np.allclose([shape.center for shape in scene.shapes], centers, rtol=1e-7)
    assert np.array_equal(physical.from_world([shape.center for shape in scene.shapes]), eleventh)
    assert scene.camera.fov == pytest.approx(mapping["camera"]["fov"], rel=1e-8)
    sky = read_image(paths.find("scenes", "dahlquist").parent / "dahlquist_sky.exr")
    assert np.abs(sky - physical.sky(dahlquist.smooth_probe())).max() < 1e-3


def test_the_ports_film_is_its_frame(scene):
    settings = Settings(160, 160, threads=2)
    engine = engines.engine("dahlquist")
    film = engine.prepare(scene, settings).render(3)
    tracer = dahlquist.Tracer(160, 160, probe=dahlquist.smooth_probe())
    for _ in range(10):
        tracer.animation.step(3000)
    frame = tracer.call(3000)[..., :3]
    assert np.abs(film.mean() * 255 - frame).max() < 1e-9
    assert film.spp == 3
    assert np.abs(film.half(0) - film.half(1)).max() < 1e-12
    assert np.nanmax(film.variance_of_mean()) < 1e-12


def test_the_reference_comes_near_the_ports_spheres(scene):
    """Spheres alone; what is left are shadows, deeper mirrors, and a sixty-fourth of each mirror."""
    settings = Settings(64, 64, **FRAME)
    tracer = dahlquist.Tracer(64, 64, engine="numpy", probe=dahlquist.smooth_probe())
    for _ in range(10):
        tracer.animation.step(3000)
    frame = tracer.call(3000)
    spheres = frame[..., 3] == dahlquist.SPHERE
    image = np.clip(engines.engine("numpy").prepare(scene, settings).render(1).mean(), 0, 1)
    difference = np.abs(image * 255 - frame[..., :3]).max(axis=2)[spheres]
    assert np.median(difference) < 5
    assert np.mean(difference > 16) < 0.06


def test_the_port_declines_other_scenes():
    engine = engines.engine("dahlquist")
    for name in ("two_spheres", "cornell_box"):
        assert "five balls" in (engine.why_not(load_scene(paths.find("scenes", name)), Settings()) or "")


def test_the_port_declines_an_image_that_is_not_square(scene):
    assert engines.engine("dahlquist").why_not(scene, Settings(64, 48)) is not None
