"""Disks: where they are hit, and the light of those that emit, against closed forms.

Statistical tests hold |z| < 4.5: a false alarm has probability 7e-6 each. Seeds are fixed.
"""

import numpy as np
import pytest

from engines.scene import Disk, Perspective, Plane
from tests.numpy_reference.small_scenes import (
    image,
    material,
    path_tracer,
    point_view,
    rays_around,
    renderer,
    scene,
    tracer,
    whitted,
    z_score,
)

FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)
LAMP = material(emission=3.0)


def above(height, radius, normal=(0.0, -1.0, 0.0), x=0.0):
    return Disk((x, height, 0.0), normal, radius, 1)


def floor_view(side=32):
    return point_view((0.3, 0.4, 4.0), (0.0, 0.0, 0.0), side)


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_rays_hit_a_disk_up_to_its_edge(accelerator):
    """The edge itself belongs to it; rays in its plane miss; either side is hit, and normals face the ray."""
    made = tracer(Disk((1.0, 2.0, 3.0), (0.0, 0.0, 1.0), 0.5, 0), accelerator=accelerator)
    origins = np.array(
        [
            [1.0, 2.0, 7.0],
            [1.5, 2.0, 7.0],
            [1.0, 1.5, -1.0],
            [1.5 + 1e-15, 2.0, 7.0],
            [1.4, 2.4, 7.0],
            [0.0, 2.0, 3.0],
            [1.0, 2.0, 3.0],
        ]
    )
    directions = np.array([[0, 0, -2.0], [0, 0, -1], [0, 0, 1], [0, 0, -1], [0, 0, -1], [1, 0, 0], [0, 0, 1]])
    hits = made.trace(origins, directions)
    assert hits.shape.tolist() == [0, 0, 0, -1, -1, -1, -1] and hits.primitive.tolist() == [0, 0, 0, -1, -1, -1, -1]
    assert hits.t[:3].tolist() == [2.0, 4.0, 4.0]
    assert np.array_equal(hits.normal[:3], [[0, 0, 1], [0, 0, 1], [0, 0, -1]])
    assert made.occluded(origins, directions).tolist() == [True, True, True, False, False, False, False]


def test_grazing_rays_hit_where_they_cross_the_plane():
    """Down to a slope of 1e-9; the crossing is computed here in extended precision."""
    rng = np.random.default_rng(2)
    slope, angle, radius = (10.0 ** -rng.uniform(1, 9, 400), rng.uniform(0, 2 * np.pi, 400), np.sqrt(rng.uniform(0, 2, 400)))
    target = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(400)], -1)
    direction = np.stack([np.cos(3 * angle), np.sin(3 * angle), -slope], -1)
    origin = target - 2.0 * direction
    o, d = origin.astype(np.longdouble), direction.astype(np.longdouble)
    t = -o[:, 2] / d[:, 2]
    inside = np.hypot(*(o + t[:, None] * d)[:, :2].T) <= 1.0
    hits = tracer(Disk((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0, 0)).trace(origin, direction)
    assert 100 < inside.sum() < 300 and np.array_equal(hits.shape == 0, inside)
    assert np.allclose(hits.t[inside], t[inside].astype(float), rtol=1e-6)


def test_a_tree_finds_what_a_list_finds_among_tilted_disks():
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    disks = [
        Disk(tuple(c), tuple(n), float(r), 0)
        for c, n, r in zip(rng.normal(size=(300, 3)), normals, rng.uniform(0.05, 0.4, 300), strict=True)
    ]
    origins, directions = rays_around(4000)
    plain, tree = (tracer(*disks, accelerator=name).trace(origins, directions) for name in ("none", "bvh"))
    assert (plain.shape >= 0).mean() > 0.3
    assert np.array_equal(plain.t, tree.t) and np.array_equal(plain.shape, tree.shape)


def test_a_ray_that_leaves_a_disk_does_not_meet_it_again():
    tilted = Disk((1e3, 2e3, -3e3), (0.48, 0.6, 0.64), 7.0, 0)
    context = tracer(tilted)._context
    rng = np.random.default_rng(4)
    toward = rng.normal(size=(3, 2000))
    origin = np.array(tilted.center)[:, None] + 5.0 * toward
    direction = -toward / np.linalg.norm(toward, axis=0)
    hits = context.closest(origin, direction)
    assert (hits.primitive_id == 0).all()
    at = context.surface(origin, direction, hits)
    leaving = direction - 2.0 * (at.geometric * direction).sum(axis=0) * at.geometric
    assert (context.closest(at.spawn(leaving), leaving, hits.primitive_id).primitive_id < 0).all()
    assert (context.closest(at.spawn(leaving), leaving).primitive_id < 0).all()


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
@pytest.mark.parametrize(("height", "radius"), [(2.0, 1.0), (0.5, 3.0)])
def test_a_disk_above_a_point_gives_pi_l_sin_squared(height, radius, direct):
    """E = pi L sin^2 of the half angle under which it is seen; a diffuse floor shows rho E / pi."""
    held = scene([FLOOR, above(height, radius)], [material(kd=0.8), LAMP], (), floor_view())
    expected = 0.8 * 3.0 * radius**2 / (radius**2 + height**2)
    assert abs(z_score(image(held, path_tracer(2, direct), spp=64, seed=1), expected, 4e-2)) < 4.5


def test_whitted_shows_the_light_of_a_disk():
    held = scene([FLOOR, above(2.0, 1.0)], [material(kd=0.8), LAMP], (), floor_view())
    assert abs(z_score(image(held, whitted(), spp=64, seed=1), 0.8 * 3.0 / 5.0, 1e-2)) < 4.5


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
def test_a_tilted_disk_off_the_axis_gives_the_integral_over_its_area(direct):
    """E = the integral of L cos cos / d^2, by quadrature over the disk."""
    normal = np.array([-0.6, -0.8, 0.0])
    held = scene([FLOOR, above(2.0, 0.7, tuple(normal), x=1.5)], [material(kd=0.8), LAMP], (), floor_view())
    node, weight = np.polynomial.legendre.leggauss(64)
    r, phi = 0.35 * (node[:, None] + 1.0), 2.0 * np.pi * (np.arange(128) + 0.5) / 128
    across, aside = np.array([0.8, -0.6, 0.0]), np.array([0.0, 0.0, 1.0])
    place = np.array([1.5, 2.0, 0.0]) + (r * np.cos(phi))[..., None] * across + (r * np.sin(phi))[..., None] * aside
    d2 = (place**2).sum(axis=-1)
    kernel = place[..., 1] * -(place @ normal) / d2**2
    irradiance = 3.0 * (kernel * r * (0.35 * weight)[:, None] * 2.0 * np.pi / 128).sum()
    seen = image(held, path_tracer(2, direct), spp=64, seed=2)
    assert abs(z_score(seen, 0.8 * irradiance / np.pi, 1e-2)) < 4.5


def test_a_disk_emits_on_its_front_and_on_both_sides_if_it_is_said_to():
    """From behind it is black, as a light and as it is seen."""
    away = above(2.0, 1.0, (0.0, 1.0, 0.0))
    for two_sided, expected in ((False, 0.0), (True, 0.8 * 3.0 / 5.0)):
        materials = [material(kd=0.8), material(emission=3.0, two_sided=two_sided)]
        for direct in ("light", "bsdf", "mis"):
            seen = image(scene([FLOOR, away], materials, (), floor_view()), path_tracer(2, direct), spp=64, seed=3)
            if two_sided:
                assert abs(z_score(seen, expected, 1e-2)) < 4.5
            else:
                assert not seen.any()
        below = Perspective((0.0, 0.5, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 1.0), 1.0, "y", (2, 2))
        assert np.array_equal(image(scene([away], materials, (), below), path_tracer(1)), np.full((2, 2), 3.0 * two_sided))


def test_points_on_a_disk_are_uniform_and_where_the_specification_puts_them():
    """r sqrt(u0) (cos t1 + sin t2) in the local frame of the normal, here (x, y) of (0, 0, 1)."""
    held = scene([Disk((1.0, 2.0, 3.0), (0.0, 0.0, 1.0), 0.5, 1)], [material(kd=0.5), material(emission=1.0, two_sided=True)])
    lights = renderer(held)._context.lights
    u0, u1, _ = np.random.default_rng(5).random((3, 1000))
    point = np.zeros((3, 1000))
    found = lights.sample(np.zeros(1000, int), point, point, u0, u1, u0)
    expected = [
        1.0 + 0.5 * np.sqrt(u0) * np.cos(2 * np.pi * u1),
        2.0 + 0.5 * np.sqrt(u0) * np.sin(2 * np.pi * u1),
        3.0 + 0 * u0,
    ]
    assert np.allclose(found.wi * found.distance, expected, rtol=1e-13)
    cosine = np.abs(found.wi[2])
    assert np.allclose(found.pdf, found.distance**2 / (cosine * np.pi * 0.25), rtol=1e-12)
    assert np.allclose(found.weight, 1.0 / found.pdf, rtol=1e-12)


def test_depth_map_sees_the_corner_of_a_tilted_disks_box():
    """max_point is the upper corner of the box: centre + r sqrt(1 - n^2) along each axis."""
    tilted = Disk((0.0, 0.0, 0.0), (0.6, 0.0, 0.8), 2.0, 0)
    context = renderer(scene([tilted]))._context
    assert np.allclose(context.geometry.upper_corner, [1.6, 2.0, 1.2], rtol=1e-15)
