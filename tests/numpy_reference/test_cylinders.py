"""Cylinders: where they are hit, and the light of those that emit, against closed forms and extended precision.

Statistical tests hold |z| < 4.5: a false alarm has probability 7e-6 each. Seeds are fixed.
"""

import numpy as np
import pytest

from engines.scene import Cylinder, Perspective, Plane
from tests.cylinder_truth import TILTED, truth
from tests.numpy_reference.small_scenes import (
    image,
    material,
    path_tracer,
    point_view,
    rays_around,
    renderer,
    scene,
    tracer,
    z_score,
)

FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)
LAMP = material(emission=3.0)


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_rays_hit_the_side_of_a_cylinder_and_pass_through_its_open_ends(accelerator):
    """From outside the nearer side, from inside the farther one, the rims included; normals face the ray."""
    made = tracer(Cylinder((1.0, 0.0, 0.0), (1.0, 2.0, 0.0), 0.5, 0), accelerator=accelerator)
    origins = np.array(
        [
            [1, 1, 4],
            [1, 1, 0],
            [1, 1, 0],
            [1, 0, 4],
            [1, 2, 4],
            [1, 2.0000001, 4],
            [1.2, 5, 0.1],
            [1, 3, 0],
            [1, 1, 4],
            [1, 5, 0.0],
            [1.6, 1, 4],
        ],
        float,
    )
    directions = np.array(
        [
            [0, 0, -2],
            [0, 0, -1],
            [1, 0, 0],
            [0, 0, -1],
            [0, 0, -1],
            [0, 0, -1],
            [0, -1, 0],
            [0.5, -1.5, 0],
            [0, 0, 1],
            [0, -1, 0.1],
            [0, 0, -1],
        ],
        float,
    )
    hits = made.trace(origins, directions)
    assert np.allclose(hits.t, [1.75, 0.5, 0.5, 3.5, 3.5, np.inf, np.inf, 1.0, np.inf, 5.0, np.inf], rtol=1e-15)
    wanted = [[0, 0, 1], [0, 0, 1], [-1, 0, 0], [0, 0, 1], [0, 0, 1]]
    assert np.allclose(hits.normal[:5], wanted, atol=1e-15)
    assert np.array_equal(made.occluded(origins, directions), np.isfinite(hits.t))


def test_a_tilted_cylinder_is_hit_where_sixty_digits_say():
    origins, directions = rays_around(1500)
    expected = truth(TILTED, origins, directions)
    hits = tracer(TILTED).trace(origins, directions)
    assert 60 < np.isfinite(expected).sum() < 1400
    assert np.array_equal(np.isfinite(hits.t), np.isfinite(expected)) and np.allclose(hits.t, expected, rtol=1e-12)


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_a_cylinder_is_hit_from_far_away(far):
    """Across the side the error is that of the origin's coordinates."""
    rng = np.random.default_rng(1)
    target = np.array(TILTED.p0) + rng.random((200, 1)) * np.subtract(TILTED.p1, TILTED.p0) + rng.uniform(-0.3, 0.3, (200, 3))
    away = rng.normal(size=(200, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    origins = target + far * away
    expected = truth(TILTED, origins, -away)
    hits = tracer(TILTED).trace(origins, -away)
    assert np.isfinite(expected).sum() > 120
    assert np.array_equal(np.isfinite(hits.t), np.isfinite(expected))
    found = np.isfinite(expected)
    across = np.abs((hits.normal * away).sum(axis=1))[found]
    assert (np.abs(hits.t[found] - expected[found]) * across).max() < 8 * far * np.finfo(float).eps


def test_grazing_rays_hit_or_miss_as_sixty_digits_say():
    """Lines that pass the axis at (1 +- 1e-9) and (1 +- 1e-12) of the radius."""
    rng = np.random.default_rng(2)
    n = 300
    phi, slope = rng.uniform(0, 2 * np.pi, n), rng.uniform(-0.3, 0.3, n)
    share = 1.0 + rng.choice([-1e-9, 1e-9, -1e-12, 1e-12], n)
    out = np.stack([np.cos(phi), np.sin(phi), np.zeros(n)], -1)
    along = np.stack([-np.sin(phi), np.cos(phi), slope], -1)
    standing = Cylinder((0.0, 0.0, -2.0), (0.0, 0.0, 2.0), 0.7, 0)
    origins = 0.7 * share[:, None] * out - 3.0 * along
    expected = truth(standing, origins, along)
    hits = tracer(standing).trace(origins, along)
    assert 100 < np.isfinite(expected).sum() < 200
    assert np.array_equal(np.isfinite(hits.t), np.isfinite(expected))
    assert np.allclose(hits.t, expected, rtol=1e-9)


def test_rays_along_the_axis_miss_and_nearly_along_it_hit_the_inside():
    origin = np.tile([0.4, 0.3, 0.5], (3, 1)) + np.outer([0.1, 0.1, 0.1], [1, 0, 0])
    axis = np.subtract(TILTED.p1, TILTED.p0)
    aside = np.cross(axis, [0.0, 0.0, 1.0])
    directions = np.array([axis, axis + 1e-12 * aside, axis + 0.2 * aside])
    expected = truth(TILTED, origin, directions)
    hits = tracer(TILTED).trace(origin, directions)
    assert np.isinf(expected[0]) and np.isfinite(expected[2])
    assert np.array_equal(np.isfinite(hits.t), np.isfinite(expected)) and np.allclose(hits.t, expected, rtol=1e-12)


def test_a_tree_finds_what_a_list_finds_among_tilted_cylinders():
    rng = np.random.default_rng(3)
    ends = rng.normal(size=(300, 3))
    others = ends + 0.5 * rng.normal(size=(300, 3))
    radii = rng.uniform(0.02, 0.2, 300)
    cylinders = [Cylinder(tuple(a), tuple(b), float(r), 0) for a, b, r in zip(ends, others, radii, strict=True)]
    origins, directions = rays_around(4000)
    plain, tree = (tracer(*cylinders, accelerator=name).trace(origins, directions) for name in ("none", "bvh"))
    assert (plain.shape >= 0).mean() > 0.3
    assert np.array_equal(plain.t, tree.t) and np.array_equal(plain.shape, tree.shape)


@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_a_ray_that_leaves_a_cylinder_outwards_does_not_meet_it_and_inwards_meets_its_other_side(shift):
    moved = Cylinder(tuple(np.add(TILTED.p0, shift)), tuple(np.add(TILTED.p1, shift)), 0.4, 0)
    context = tracer(moved)._context
    rng = np.random.default_rng(4)
    middle = (np.array(moved.p0) + np.array(moved.p1)) / 2
    toward = rng.normal(size=(3, 2000))
    toward /= np.linalg.norm(toward, axis=0)
    origin, direction = middle[:, None] + 5.0 * toward, -toward + 0.02 * rng.normal(size=(3, 2000))
    direction /= np.linalg.norm(direction, axis=0)
    hits = context.closest(origin, direction)
    there = np.flatnonzero(hits.primitive_id == 0)
    at = context.surface(origin[:, there], direction[:, there], hits.take(there))
    outside = np.flatnonzero(at.front)
    assert outside.size > 500
    at, d = at.take(outside), direction[:, there][:, outside]
    leaving = d - 2.0 * (at.geometric * d).sum(axis=0) * at.geometric
    assert (context.closest(at.spawn(leaving), leaving, at.primitive_id).primitive_id < 0).all()
    inward = -at.geometric
    across = context.closest(at.spawn(inward), inward, at.primitive_id)
    assert (across.primitive_id == 0).all() and np.allclose(across.t, 0.8, rtol=1e-9)


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
def test_a_lying_cylinder_gives_the_integral_over_its_side(direct):
    """E = the integral of L cos cos / d^2 over what faces the point, by quadrature; half of the side looks away."""
    tube = Cylinder((-0.8, 1.5, 0.3), (0.9, 1.9, -0.2), 0.35, 1)
    held = scene([FLOOR, tube], [material(kd=0.8), LAMP], (), point_view((0.3, 0.4, 4.0), (0.0, 0.0, 0.0), 32))
    p0, way = np.array(tube.p0), np.subtract(tube.p1, tube.p0)
    axis = way / np.linalg.norm(way)
    one = np.cross(axis, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one)
    two, phi = np.cross(axis, one), 2 * np.pi * (np.arange(1024) + 0.5) / 1024
    out = np.cos(phi)[:, None] * one + np.sin(phi)[:, None] * two
    node, weight = np.polynomial.legendre.leggauss(64)
    place = p0 + (0.5 * (node + 1))[:, None, None] * way + 0.35 * out
    d2 = (place**2).sum(axis=-1)
    kernel = place[..., 1] * np.maximum(-(place * out).sum(axis=-1), 0.0) / d2**2
    area = 2 * np.pi * 0.35 * np.linalg.norm(way)
    irradiance = 3.0 * (kernel * weight[:, None]).sum() / 2 / 1024 * area
    seen = image(held, path_tracer(2, direct), spp=64, seed=2)
    assert abs(z_score(seen, 0.8 * irradiance / np.pi, 2e-2)) < 4.5


def test_a_cylinder_emits_outwards_and_on_both_sides_if_it_is_said_to():
    tube, inside = Cylinder((0.0, -3.0, 0.0), (0.0, 3.0, 0.0), 1.0, 0), (0.0, 0.2, 0.1)
    for two_sided in (False, True):
        for eye, lit in ((inside, two_sided), ((0.0, 0.2, 5.0), True)):
            view = Perspective(eye, (0.0, 0.2, -1.0), (0.0, 1.0, 0.0), 1.0, "y", (2, 2))
            seen = image(scene([tube], [material(emission=3.0, two_sided=two_sided)], (), view), path_tracer(1))
            assert np.array_equal(seen, np.full((2, 2), 3.0 * lit))


def test_points_on_a_cylinder_are_uniform_and_where_the_specification_puts_them():
    """p0 + u0 (p1 - p0) + r (cos t1 + sin t2) in the local frame of the axis, here (x, y) of (0, 0, 1)."""
    lamp = Cylinder((1.0, 2.0, 3.0), (1.0, 2.0, 5.0), 0.5, 1)
    held = scene([lamp], [material(kd=0.5), material(emission=1.0, two_sided=True)])
    lights = renderer(held)._context.lights
    u0, u1, _ = np.random.default_rng(5).random((3, 1000))
    point = np.zeros((3, 1000))
    found = lights.sample(np.zeros(1000, int), point, point, u0, u1, u0)
    cos, sin = np.cos(2 * np.pi * u1), np.sin(2 * np.pi * u1)
    assert np.allclose(found.wi * found.distance, [1 + 0.5 * cos, 2 + 0.5 * sin, 3 + 2 * u0], rtol=1e-13)
    cosine = np.abs(found.wi[0] * cos + found.wi[1] * sin)
    assert np.allclose(found.pdf, found.distance**2 / (cosine * 2 * np.pi * 0.5 * 2.0), rtol=1e-11)
    assert np.allclose(found.weight, 1.0 / found.pdf, rtol=1e-11)


def test_depth_map_sees_the_corner_of_a_tilted_cylinders_box():
    tilted = Cylinder((0.0, 0.0, 0.0), (3.0, 0.0, 4.0), 2.0, 0)
    context = renderer(scene([tilted]))._context
    assert np.allclose(context.geometry.upper_corner, [3 + 2 * 0.8, 2.0, 4 + 2 * 0.6], rtol=1e-15)
