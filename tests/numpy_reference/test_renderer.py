"""What a renderer promises: the same bits however a render is split, prompt stops, and honest counters."""

import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from engines.errors import ConfigError, UnknownName, Unsupported
from engines.interface import Engine as EngineProtocol
from engines.interface import Renderer as RendererProtocol
from engines.interface import Settings
from engines.numpy_reference import Engine
from engines.numpy_reference import renderer as renderer_module
from engines.numpy_reference.accelerators import bvh as bvh_module
from engines.numpy_reference.accelerators import exhaustive, tracer
from engines.scene import EnvironmentLight, Orthographic, Perspective, PerspectiveArctan, Plane, PointLight, Sphere, SphereSet
from tests.numpy_reference.small_scenes import (
    GLASS,
    box_mesh,
    material,
    path_tracer,
    renderer,
    scene,
    triangle_soup,
    unit_sphere,
    whitted,
)

LIGHTS = [PointLight((0.0, 3.0, 2.0), (5.0, 5.0, 5.0)), EnvironmentLight((0.2, 0.3, 0.4))]
MATERIALS = [material(kd=0.6), GLASS, material(emission=4.0), material(kd=0.2, ks=0.6)]
MIXED = scene(
    [
        Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), 0),
        Sphere((-0.6, 0.0, 0.0), 0.8, 1),
        Sphere((1.0, 1.6, 0.3), 0.3, 2),
        box_mesh((0.4, -0.9, -0.5), (1.2, 0.2, 0.5)),
        Sphere((0.0, -0.4, 1.2), 0.4, 3),
    ],
    MATERIALS,
    LIGHTS,
)
SHADERS = ["no_shadows", whitted(), path_tracer(6, rr_depth=2), path_tracer(4, "light"), "depth_map", "albedo"]
SAMPLERS = ["constant", "stratified", "halton", "random", "sobol"]
HUGE = {"width": 1024, "height": 1024, "shader": path_tracer(100_000)}


def sums(given=MIXED, spp=3, **settings):
    film = renderer(given, **{"width": 24, "height": 16, "shader": path_tracer(6, rr_depth=2), **settings}).render(spp)
    return film.sums, film.squares, film.even_sums, film.counts


def test_engine_and_renderer_follow_the_protocols():
    engine = Engine()
    assert isinstance(engine, EngineProtocol) and engine.name == "numpy" and engine.version
    assert engine.accelerators().keys() == {"auto", "none", "bvh"}
    assert isinstance(renderer(MIXED), RendererProtocol)


@pytest.mark.parametrize("shader", SHADERS, ids=str)
def test_every_shader_gives_finite_samples_with_every_sampler_and_accelerator(shader):
    for sampler in SAMPLERS:
        images = []
        for accelerator in ("auto", "none", "bvh"):
            with np.errstate(all="raise"):  # nothing unexpected may hide behind a warning
                made = renderer(MIXED, width=8, height=6, shader=shader, sampler=sampler, accelerator=accelerator)
                film = made.render(2)
            assert film.bad_samples == 0 and film.spp == 2 and np.isfinite(film.mean()).all() and film.mean().any()
            images.append(film.mean())
        assert np.array_equal(images[0], images[1]) and np.array_equal(images[1], images[2])


@pytest.mark.parametrize("shader", SHADERS, ids=str)
def test_splitting_a_render_changes_no_bit(shader):
    once = sums(shader=shader, spp=5)
    split = renderer(MIXED, width=24, height=16, shader=shader)
    for spp in (1, 3, 0, 1):
        film = split.render(spp)
    for a, b in zip(once, (film.sums, film.squares, film.even_sums, film.counts), strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("shader", SHADERS, ids=str)
@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_neither_chunks_nor_tiles_nor_lanes_nor_threads_change_a_bit(monkeypatch, shader, accelerator):
    expected = sums(shader=shader, accelerator=accelerator)
    monkeypatch.setattr(renderer_module, "CHUNK", 37)
    monkeypatch.setattr(exhaustive, "TILE", 100)
    monkeypatch.setattr(bvh_module, "LANES", 11)
    found = sums(shader=shader, accelerator=accelerator, threads=3)
    assert all(np.array_equal(a, b) for a, b in zip(expected, found, strict=True))


def test_the_image_depends_on_the_seed():
    assert np.array_equal(sums(seed=3)[0], sums(seed=3)[0])
    assert not np.array_equal(sums(seed=3)[0], sums(seed=4)[0])
    assert not np.array_equal(sums(seed=3)[0], sums(seed=3 + 2**32)[0])


def test_warm_up_leaves_the_film_alone():
    made = renderer(MIXED)
    made.warm_up()
    assert made.film.spp == 0 and made.counters()["compile_seconds"] == 0.0


def test_passes_are_announced_and_can_stop_the_render():
    made, seen = renderer(MIXED, width=8, height=8), []

    def stop_at_two(film):
        seen.append(film.spp)
        if len(seen) == 2:
            made.stop()

    film = made.render(10, on_pass=stop_at_two)
    assert seen == [1, 2] and film.spp == 2
    assert made.render(1).spp == 3


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_stop_returns_at_once_and_keeps_whole_passes_only(accelerator):
    """A pass of a closed, white room takes minutes; `stop` comes from another thread."""
    count = 2000 if accelerator == "bvh" else 200
    inside = Perspective((0.0, 0.0, 0.9), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 90.0, "y", (8, 8))
    room = scene([box_mesh(), triangle_soup(count, 0.1)], [material(kd=1.0)], [], inside)
    made = renderer(room, accelerator=accelerator, **HUGE)
    thread = threading.Thread(target=made.render, args=(1,))
    begin = time.process_time()
    thread.start()
    while time.process_time() < begin + 0.5:  # until it is at work
        time.sleep(0.01)
    begin = time.process_time()
    made.stop()
    thread.join()
    assert time.process_time() - begin < 0.2  # of this process: a busy machine lets it wait
    assert not made.film.counts.any() and not made.film.sums.any()


def test_update_restarts_the_film_and_renders_the_new_scene():
    made = renderer(MIXED, width=16, height=12)
    made.render(2)
    camera = Orthographic((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 3.0, (8, 8))
    shapes = MIXED.shapes[:2]
    made.update(camera=camera, shapes=shapes)
    assert made.film.spp == 0 and not made.film.sums.any()
    anew = renderer(replace(MIXED, camera=camera, shapes=shapes), width=16, height=12)
    assert np.array_equal(made.render(2).sums, anew.render(2).sums)
    made.update(camera=MIXED.camera)
    made.update(shapes=[*MIXED.shapes])
    assert np.array_equal(made.render(2).sums, renderer(MIXED, width=16, height=12).render(2).sums)


def test_update_with_another_resolution_gives_another_film_unless_settings_fix_it():
    made = renderer(MIXED)
    made.update(camera=replace(MIXED.camera, resolution=(5, 3)))
    assert (made.render(1).width, made.film.height) == (5, 3)
    assert (made.settings.width, made.settings.height) == (5, 3)


def test_auto_takes_a_tree_when_there_is_much_and_says_so():
    assert renderer(MIXED).settings.accelerator.name == "none"
    count = tracer.AUTO_LIMIT + 1
    many = SphereSet(np.random.default_rng(0).random((count, 3)), np.full(count, 0.1), 0)
    made = renderer(scene([many]))
    assert made.settings.accelerator.describe() == {"name": "bvh", "leaf_size": 4}
    assert made.counters()["accelerator_bytes"] > 0
    made.update(shapes=[unit_sphere()])
    assert made.settings.accelerator.name == "none" and made.counters()["accelerator_bytes"] == 0


def test_settings_are_given_back_in_full():
    given = renderer(MIXED, shader="whitted", threads=2).settings
    assert given.shader.describe() == {"name": "whitted", "ambient": 0.1, "max_depth": 6}
    assert given.sampler.describe() == {"name": "random"}
    assert (given.precision, given.threads, given.width, given.height) == ("float64", 2, 8, 8)
    again, once = Engine().prepare(MIXED, given).render(1), renderer(MIXED, shader="whitted").render(1)
    assert np.array_equal(again.sums, once.sums)


def test_rays_are_counted():
    made = renderer(scene([], [material()], []), width=10, height=10, shader="albedo")
    made.render(3)
    assert made.counters()["rays"] == 300
    made.trace(np.zeros((7, 3)), np.ones((7, 3)))
    assert made.counters()["rays"] == 307
    assert made.counters().keys() >= {"rays", "build_seconds", "compile_seconds", "accelerator_bytes", "bad_samples"}


def test_the_engine_says_what_it_cannot_do():
    engine = Engine()
    for settings, error in (
        (Settings(shader="path_tracr"), UnknownName),
        (Settings(accelerator="grid"), UnknownName),
        (Settings(sampler={"name": "sobol", "scrambel": 1}), UnknownName),
        (Settings(accelerator={"name": "bvh", "leaf_size": 0}), ConfigError),
        (Settings(shader={"name": "path_tracer", "max_depth": 0}), ConfigError),
    ):
        for call in (engine.why_not, engine.prepare):
            with pytest.raises(error):
                call(MIXED, settings)
    sentence = engine.why_not(MIXED, Settings(precision="float32"))
    with pytest.raises(Unsupported) as raised:
        engine.prepare(MIXED, Settings(precision="float32"))
    assert sentence and str(raised.value) == sentence
    for settings in (Settings(), Settings(threads=2), Settings(precision="float64")):
        assert engine.why_not(MIXED, settings) is None


def test_cameras_send_rays_through_the_window_they_describe():
    """The corners of a 2 x 1 image: half extents (a h, h) for fov_axis y, (h, h / a) for x; metres if parallel."""
    from engines.numpy_reference.camera import camera_rays

    px, py = np.array([0.0, 2.0]), np.array([0.0, 1.0])
    eye, target, up = (1.0, 2.0, 3.0), (1.0, 2.0, -1.0), (0.0, 5.0, 0.3)
    for axis, (x, y) in (("y", (2.0, 1.0)), ("x", (1.0, 0.5))):
        origin, direction = camera_rays(Perspective(eye, target, up, 90.0, axis, (2, 1)), px, py, 2, 1)
        expected = np.array([[-x, y, -1.0], [x, -y, -1.0]])
        assert np.allclose(direction.T, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-15)
        assert (eye == origin.T).all()
    origin, direction = camera_rays(Orthographic(eye, target, up, 3.0, (2, 1)), px, py, 2, 1)
    assert np.allclose(origin.T, [[-2.0, 3.5, 3.0], [4.0, 0.5, 3.0]], atol=1e-15)
    assert (direction.T == [0.0, 0.0, -1.0]).all()


def test_the_arctan_camera_has_slopes_that_are_the_arctangent_of_an_angle():
    """The share s of the half image has the angle s radians upwards, and 2 s across; A(1) = pi/4 and A(2) = pi/2 - A(1/2)."""
    from engines.numpy_reference.camera import camera_rays

    camera = PerspectiveArctan((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), math.degrees(2.0), "y", (20, 10))
    px, py = np.linspace(0.0, 20.0, 11), np.linspace(10.0, 0.0, 11)
    _, direction = camera_rays(camera, px, py, 20, 10)
    across, upwards = direction[0] / -direction[2], direction[1] / -direction[2]
    share = np.linspace(-1.0, 1.0, 11)
    assert np.abs(across - np.arctan(2.0 * share)).max() < 1.6e-3 > np.abs(upwards - np.arctan(share)).max()
    assert upwards[[0, 5, 10]] == pytest.approx([-math.pi / 4, 0.0, math.pi / 4], abs=1e-15)
    half = 0.5 * math.pi / 4 + 0.5 * 0.5 * (0.2447 + 0.0663 * 0.5)
    _, direction = camera_rays(camera, np.array([15.0, 20.0]), np.array([7.5, 2.5]), 20, 10)
    assert direction[1] / -direction[2] == pytest.approx([-half, half], abs=1e-15)
    assert (direction[0] / -direction[2])[1] == pytest.approx(math.pi / 2 - half, abs=1e-15)
