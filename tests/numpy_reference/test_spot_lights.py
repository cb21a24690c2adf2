"""Spot lights: a floor shows kd/pi I s cos / d^2, with the falloff s in the angle from the axis."""

import numpy as np
import pytest

from engines.scene import Disk, Plane, SpotLight
from tests.numpy_reference.small_scenes import exact, image, material, path_tracer, point_view, renderer, scene, whitted

FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)


def tilted_spot(degrees, cutoff=30.0, beam_width=20.0):
    """Two metres above the origin, with the axis this far from straight down."""
    angle = np.radians(degrees)
    return SpotLight((0.0, 2.0, 0.0), (float(np.sin(angle)), float(-np.cos(angle)), 0.0), (np.pi,) * 3, cutoff, beam_width)


@pytest.mark.parametrize(
    ("degrees", "share"), [(0, 1.0), (5, 1.0), (19.999, 1.0), (22.5, 0.75), (25, 0.5), (29, 0.1), (30.001, 0.0), (180, 0.0)]
)
@pytest.mark.parametrize(
    "shader", [{"name": "no_shadows", "ambient": 0.0}, whitted(), path_tracer(2)], ids=lambda shader: shader["name"]
)
def test_the_light_falls_off_linearly_in_the_angle(degrees, share, shader):
    view = point_view((0.0, 1.0, 2.0), (0.0, 0.0, 0.0))
    held = scene([FLOOR], [material(kd=0.5)], [tilted_spot(degrees)], view)
    assert np.allclose(exact(held, shader), 0.5 * share / 4.0, rtol=1e-3 if degrees > 19 else 1e-12)


def test_inside_its_beam_a_spot_light_is_a_point_light():
    """At an angle of 40 degrees from the vertical: cos^3 / h^2, times a colour."""
    x = float(2.0 * np.tan(np.radians(40.0)))
    light = SpotLight((0.0, 2.0, 0.0), (0.0, -1.0, 0.0), (1.0, 2.0, 3.0), 60.0, 45.0)
    view = point_view((x, 1.0, 2.0), (x, 0.0, 0.0))
    seen = exact(scene([FLOOR], [material(kd=0.5)], [light], view), path_tracer(2))
    assert np.allclose(seen, 0.5 / np.pi * np.cos(np.radians(40.0)) ** 3 / 4.0 * np.array([1, 2, 3]), rtol=1e-9)


def test_a_spot_light_without_a_soft_edge_ends_at_its_cutoff():
    lights = renderer(scene([FLOOR], (), [tilted_spot(0.0, 20.0, 20.0)]))._context.lights
    angle = np.radians([0.0, 10.0, 19.999, 20.001, 90.0])
    point = np.stack([np.sin(angle), 2.0 - np.cos(angle), 0.0 * angle])
    none = np.zeros(5)
    found = lights.sample(np.zeros(5, int), point, np.zeros((3, 5)), none, none, none)
    assert np.allclose(found.weight[0], [np.pi, np.pi, np.pi, 0.0, 0.0], rtol=1e-12)
    assert lights.delta.all() and np.isinf(found.pdf).all() and np.allclose(found.distance, 1.0)


def test_what_stands_in_the_cone_casts_a_shadow():
    blocker = Disk((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 0.1, 0)
    view = point_view((0.0, 0.5, 2.0), (0.0, 0.0, 0.0))
    held = scene([FLOOR, blocker], [material(kd=0.5)], [tilted_spot(0.0)], view)
    assert not image(held, whitted()).any() and not image(held, path_tracer(2)).any() and image(held, "no_shadows").all()


def test_near_the_axis_the_angle_keeps_its_digits():
    """A beam of a thousandth of a degree: the falloff is that of the angle, which the cosine could not tell."""
    light = SpotLight((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0), 1e-3, 1e-9)
    lights = renderer(scene([FLOOR], (), [light]))._context.lights
    angle = np.radians(1e-3) * np.array([0.25, 0.5, 0.75])
    none = np.zeros(3)
    found = lights.sample(np.zeros(3, int), np.stack([np.sin(angle), none, np.cos(angle)]), np.zeros((3, 3)), none, none, none)
    assert np.allclose(found.weight[0], [0.75, 0.5, 0.25], rtol=1e-5)
