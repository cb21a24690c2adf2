"""Cameras: thin lens, principal point, mirror and clip, against their formulas and between the engines."""

import math
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.numpy_reference.camera import camera_rays, clipped
from engines.scene import Orthographic, Perspective, ThinLens
from tests.test_engines_agree import _assert_equal, _image

EYE, TARGET, UP = (1.0, 2.0, 6.0), (0.2, 0.7, -0.5), (0.1, 1.0, 0.2)
FORWARD = np.subtract(TARGET, EYE) / np.linalg.norm(np.subtract(TARGET, EYE))
RIGHT = np.cross(FORWARD, UP) / np.linalg.norm(np.cross(FORWARD, UP))
ABOVE = np.cross(RIGHT, FORWARD)
SIZE = (30, 20)
PINHOLE = Perspective(EYE, TARGET, UP, 40.0, "x", SIZE)
LENS = ThinLens(EYE, TARGET, UP, 40.0, "x", SIZE, aperture_radius=0.3, focus_distance=5.0)
WINDOW = Orthographic(EYE, TARGET, UP, 3.0, SIZE)


def _places(n=200):
    random = np.random.default_rng(1)
    return random.uniform(0, SIZE[0], n), random.uniform(0, SIZE[1], n), (random.random(n), random.random(n))


def test_rays_through_one_place_of_a_lens_meet_at_the_focus_distance_and_start_all_over_the_aperture():
    _, _, lens = _places()
    origin, direction = camera_rays(LENS, np.full(200, 7.3), np.full(200, 12.9), *SIZE, lens)
    ahead = 5.0 - FORWARD @ (origin - np.array(EYE)[:, None])
    met = origin + ahead / (FORWARD @ direction) * direction
    pinhole = camera_rays(PINHOLE, np.array([7.3]), np.array([12.9]), *SIZE)[1]
    assert np.allclose(met, np.array(EYE)[:, None] + 5.0 / (FORWARD @ pinhole) * pinhole, atol=1e-13)
    aside = origin - np.array(EYE)[:, None]
    x, y = RIGHT @ aside, ABOVE @ aside
    assert np.allclose(FORWARD @ aside, 0.0, atol=1e-14)
    assert np.allclose(x, 0.3 * np.sqrt(lens[0]) * np.cos(2 * np.pi * lens[1]), atol=1e-14)
    assert np.allclose(y, 0.3 * np.sqrt(lens[0]) * np.sin(2 * np.pi * lens[1]), atol=1e-14)


def test_a_lens_without_draws_is_its_pinhole():
    px, py, _ = _places()
    for lens, pinhole in zip(camera_rays(LENS, px, py, *SIZE), camera_rays(PINHOLE, px, py, *SIZE), strict=True):
        assert np.array_equal(lens, pinhole)


@pytest.mark.parametrize("camera", [PINHOLE, WINDOW, LENS], ids=lambda camera: type(camera).__name__)
def test_the_axis_of_view_meets_the_film_at_its_principal_point(camera):
    shifted = replace(camera, principal_point=(0.2, -0.15))
    origin, direction = camera_rays(shifted, np.array([0.7 * 30]), np.array([0.35 * 20]), *SIZE)
    assert np.allclose(direction[:, 0], FORWARD, atol=1e-15) and np.allclose(origin[:, 0], EYE, atol=1e-15)
    px, py, _ = _places()
    moved = camera_rays(shifted, px + 0.2 * 30, py - 0.15 * 20, *SIZE)
    for ours, plain in zip(moved, camera_rays(camera, px, py, *SIZE), strict=True):
        assert np.allclose(ours, plain, atol=1e-14)


@pytest.mark.parametrize("camera", [PINHOLE, WINDOW, LENS], ids=lambda camera: type(camera).__name__)
def test_a_mirrored_image_has_left_and_right_exchanged(camera):
    px, py, lens = _places()
    mirrored = camera_rays(replace(camera, mirror=True), SIZE[0] - px, py, *SIZE)
    for ours, plain in zip(mirrored, camera_rays(camera, px, py, *SIZE), strict=True):
        assert np.allclose(ours, plain, atol=1e-14)
    if isinstance(camera, ThinLens):  # the aperture, too: r is negated wherever it stands
        origin, _ = camera_rays(replace(camera, mirror=True), px, py, *SIZE, lens)
        plain, _ = camera_rays(camera, px, py, *SIZE, lens)
        assert np.allclose(RIGHT @ (origin - plain), -2 * (RIGHT @ (plain - np.array(EYE)[:, None])), atol=1e-14)


@pytest.mark.parametrize("camera", [PINHOLE, WINDOW, LENS], ids=lambda camera: type(camera).__name__)
def test_clipped_rays_start_and_end_in_two_planes_across_the_axis(camera):
    px, py, lens = _places()
    assert clipped(camera, *camera_rays(camera, px, py, *SIZE, lens)) is None
    camera = replace(camera, clip=(1.5, 4.0))
    origin, direction = camera_rays(camera, px, py, *SIZE, lens)
    start, length = clipped(camera, origin, direction)
    depth = FORWARD @ (start - np.array(EYE)[:, None])
    assert np.allclose(depth, 1.5, atol=1e-13)
    assert np.allclose(FORWARD @ (start + length * direction - np.array(EYE)[:, None]), 4.0, atol=1e-13)
    assert np.allclose(np.cross((start - origin).T, direction.T), 0.0, atol=1e-13)


def _room(camera, lamp=3.0):
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"white": {"kd": 0.7}, "blue": {"kd": [0.2, 0.3, 0.8]}, "lamp": {"emission": lamp}},
            "shapes": [
                {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "white"},
                {"sphere": {"center": [-0.9, 0.8, 1.4], "radius": 0.7}, "material": "blue"},
                {"sphere": {"center": [1.1, 0.6, -0.6], "radius": 0.6}, "material": "white"},
                {"triangle": {"a": [-2, 0, -2], "b": [2, 0, -2], "c": [0, 3, -2]}, "material": "blue"},
                {"sphere": {"center": [0, 4, 1], "radius": 0.7}, "material": "lamp"},
            ],
            "lights": [{"environment": {"radiance": [0.2, 0.3, 0.4]}}],
        }
    )
    return replace(scene, camera=camera)


ALTERED = {"principal_point": (0.08, -0.05), "mirror": True, "clip": (4.6, 8.0)}


@pytest.mark.parametrize(
    "camera",
    [replace(PINHOLE, **ALTERED), replace(WINDOW, **ALTERED), replace(LENS, **ALTERED)],
    ids=lambda camera: type(camera).__name__,
)
def test_numba_in_float64_equals_the_reference_through_every_camera(camera):
    """The clip cuts off the near side of one ball and all that lies behind the other."""
    size = {"width": 24, "height": 24}
    _assert_equal(_room(camera), ["none"], shader="path_tracer", sampler="sobol", spp=3, **size)
    unclipped = _image("numpy", _room(replace(camera, clip=(0.0, math.inf))), spp=1, **size)
    assert np.abs(unclipped - _image("numpy", _room(camera), spp=1, **size)).max() > 0.1


@pytest.mark.parametrize("sampler", ["random", "stratified", "halton"])
def test_numba_in_float64_equals_the_reference_through_a_lens_with_every_sampler(sampler):
    """depth_map shows where each ray starts."""
    _assert_equal(_room(LENS), ["none"], shader="depth_map", sampler=sampler, spp=3, width=24, height=24)


def test_accelerators_that_know_the_eye_see_through_a_lens_and_behind_a_near_plane():
    for camera in (LENS, replace(PINHOLE, clip=(4.6, math.inf)), replace(PINHOLE, mirror=True, principal_point=(0.1, 0.0))):
        _assert_equal(_room(camera), ["area_hierarchy", "bvh"], shader="depth_map", spp=2, width=24, height=24)


def test_an_update_of_the_camera_changes_lens_and_clip():
    scene = _room(PINHOLE)
    renderer = engines.engine("numba").prepare(scene, Settings(24, 24, "depth_map", seed=3, precision="float64"))
    for camera in (LENS, replace(LENS, clip=(4.6, 8.0)), PINHOLE):
        renderer.update(camera=camera)
        seen = renderer.render(2).mean()
        truth = _image("numpy", _room(camera), shader="depth_map", width=24, height=24)
        assert np.abs(seen - truth).max() < 1e-9
