"""Triangles: exact where that can be computed, watertight where they meet, silent where they have no area."""

import warnings
from fractions import Fraction

import numpy as np
import pytest

from engines.scene import Triangle
from tests.numpy_reference.small_scenes import EPS, box_mesh, mesh, sphere_mesh, tracer, unit_rows

UNIT = Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)


def test_distance_weights_and_place_are_right_to_the_last_digits():  # T1
    """The exact answer comes from the same floats, as fractions; coordinates are at most 2."""
    rng = np.random.default_rng(1)
    flat = rng.random((300, 2))
    flat = np.where(flat.sum(axis=1, keepdims=True) > 1, 1 - flat, flat)
    origins = np.concatenate([rng.uniform(-1, 1, (300, 2)), rng.choice([-1, 1], 300)[:, None] * 2.0], axis=1)
    directions = np.concatenate([flat, np.zeros((300, 1))], axis=1) - origins
    hits = tracer(UNIT).trace(origins, directions)
    assert (hits.shape == 0).all()
    for i in range(300):
        o, d = ([Fraction(float(x)) for x in v] for v in (origins[i], directions[i]))
        t = -o[2] / d[2]
        u, v = o[0] + t * d[0], o[1] + t * d[1]
        for found, expected in ((hits.t[i], t), (hits.u[i], u), (hits.v[i], v)):
            assert abs(Fraction(float(found)) - expected) <= 16 * Fraction(EPS)
        place = origins[i] + hits.t[i] * directions[i]
        assert np.abs(place - [float(u), float(v), 0.0]).max() <= 16 * EPS


def test_a_small_sphere_far_away_has_no_holes():  # T2
    center = np.array([148376.0, 1234.0, -223423.0])
    rng = np.random.default_rng(2)
    origins = center + unit_rows(rng.normal(size=(20_000, 3))) * rng.random((20_000, 1))
    hits = tracer(sphere_mesh(200, center, 2.0), accelerator="bvh").trace(origins, rng.normal(size=(20_000, 3)))
    assert np.isfinite(hits.t).all()


def test_nothing_passes_between_triangles_at_shared_vertices_and_edges():  # T4
    """53 of 15,000 such rays pass with Moeller and Trumbore's test in float64."""
    hull = sphere_mesh(12)
    rng = np.random.default_rng(4)
    corners = hull.vertices[hull.faces[rng.integers(len(hull.faces), size=15_000)]]
    along = rng.random((15_000, 1)) * (rng.random((15_000, 1)) < 0.5)  # half of them at vertices
    targets = corners[:, 0] * (1 - along) + corners[:, 1] * along
    origins = 0.5 * rng.random((15_000, 1)) * unit_rows(rng.normal(size=(15_000, 3)))
    for scale in (1.0, 1e-6, 1e6):
        for accelerator in ("none", "bvh"):
            scaled = mesh(hull.vertices * scale, hull.faces)
            hits = tracer(scaled, accelerator=accelerator).trace(origins * scale, (targets - origins) * scale)
            assert np.isfinite(hits.t).all()


def test_the_diagonal_of_a_quad_is_closed_from_every_side():  # T5
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    axis = np.ones(3) / np.sqrt(3.0)
    turned = np.cross(axis, corners) + np.outer(corners @ axis, axis)  # by 90 degrees about (1, 1, 1)
    rng = np.random.default_rng(5)
    targets = turned[0] + rng.uniform(0.01, 0.99, (1024, 1)) * (turned[2] - turned[0])
    origins = 5.0 * unit_rows(rng.normal(size=(1024, 3)))
    hits = tracer(mesh(turned, [[0, 1, 2], [0, 2, 3]])).trace(origins, targets - origins)
    assert np.isfinite(hits.t).all()


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_a_triangle_without_area_is_never_hit(accelerator):  # T6, T10
    x, z = -1113.45459, -56.2431908
    line = Triangle((x, -79.049614, z), (x, -87.0922699, z), (x, -79.2090149, z), 0)
    ray = [(-1081.47925, 99.9999542, 87.7701111)], [(-32.1072998, -183.355865, -144.607635)]
    assert np.isinf(tracer(line, accelerator=accelerator).trace(*ray, t_max=0.9999).t[0])
    point = Triangle((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0)
    good = mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1], [0, 1, 2], [2, 0, 2]])
    hits = tracer(point, line, good, accelerator=accelerator).trace([(0.2, 0.2, 1.0)], [(0.0, 0.0, -1.0)])
    assert (hits.shape[0], hits.primitive[0], hits.t[0]) == (2, 2, 1.0)


@pytest.mark.parametrize("height", [1e-2, 1e-8, 1e-16, 1e-30, 1e-44])
def test_slivers_are_hit_on_their_axis_and_give_no_nan(height):  # T8
    sliver = tracer(Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, height, 0.0), 0))
    hits = sliver.trace([(0.5, height / 3, 1.0)], [(0.0, 0.0, -1.0)])
    assert hits.t[0] == 1.0 and np.array_equal(hits.normal[0], [0.0, 0.0, 1.0])
    rng = np.random.default_rng(8)
    origins = rng.uniform(-1, 1, (2000, 3))
    targets = np.stack([rng.random(2000), height * rng.random(2000), np.zeros(2000)], -1)
    many = sliver.trace(origins, targets - origins)
    found = np.isfinite(many.t)
    assert not np.isnan(many.t).any() and not np.isnan(many.normal).any()
    assert ((many.u >= 0) & (many.v >= 0) & (many.u + many.v <= 1 + EPS))[found].all()


def test_weights_are_numbers_where_all_edge_functions_round_to_zero():
    """Corners on a line through the ray, but for the rounding of one coordinate: exact edge functions decide, and weigh."""
    rng, hits = np.random.default_rng(6), 0
    for _ in range(300):
        x = rng.uniform(0.5, 1.0, 3) * (1.0, -1.0, rng.choice([-1.0, 1.0]))
        corners = np.stack([x, x / 3.0, rng.uniform(-0.1, 0.1, 3)], -1)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = tracer(Triangle(*map(tuple, corners), 0)).trace([(0.0, 0.0, 1.0)], [(0.0, 0.0, -1.0)])
        hits += int(np.isfinite(found.t[0]))
        assert np.isfinite([found.u[0], found.v[0]]).all() and found.u[0] >= 0.0 and found.v[0] >= 0.0
        assert found.u[0] + found.v[0] <= 1.0 + EPS
    assert hits > 3


def test_a_ray_that_leaves_a_triangle_does_not_meet_it_again():  # T7
    rng = np.random.default_rng(7)
    for _ in range(300):
        corners = rng.choice([-1, 1], (3, 3)) * 10.0 ** rng.uniform(-8, 8, (3, 3))
        context = tracer(Triangle(*map(tuple, corners), 0))._context
        weights = rng.dirichlet(np.ones(3))
        origin = (rng.choice([-1, 1], 3) * 10.0 ** rng.uniform(-8, 8, 3))[:, None]
        aim = unit_rows(weights @ corners - origin[:, 0])[:, None]
        hits = context.closest(origin, aim)
        if hits.primitive_id[0] < 0:
            continue
        surface = context.surface(origin, aim, hits)
        out = unit_rows(rng.normal(size=(20, 3))).T
        out = np.where((out * surface.geometric).sum(axis=0) < 0, -out, out)
        again = context.closest(np.repeat(surface.leave(), 20, axis=1), out)
        assert (again.primitive_id < 0).all()


def test_both_sides_are_hit_and_the_normal_faces_the_ray():  # T14
    rng = np.random.default_rng(14)
    origins = np.stack([rng.uniform(-1, 1, 200), rng.uniform(-1, 1, 200), rng.choice([-1.0, 1.0], 200)], -1)
    directions = np.array([0.3, 0.3, 0.0]) - origins
    hits = tracer(UNIT).trace(origins, directions)
    assert (hits.shape == 0).all()
    assert np.array_equal(hits.normal[:, 2], np.sign(origins[:, 2])) and not hits.normal[:, :2].any()
    assert ((hits.normal * directions).sum(axis=1) < 0).all()


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
@pytest.mark.parametrize("scale", [1e-20, 1e-10, 1.0, 1e10, 1e18])
def test_a_cube_is_closed_at_every_scale(scale, accelerator):  # T15
    rng = np.random.default_rng(15)
    origins, directions = rng.uniform(-0.9, 0.9, (500, 3)) * scale, rng.normal(size=(500, 3))
    cube = tracer(box_mesh((-scale,) * 3, (scale,) * 3), accelerator=accelerator)
    hits = cube.trace(origins, directions)
    places = origins + hits.t[:, None] * directions
    assert np.allclose(np.abs(places).max(axis=1), scale, rtol=1e-14, atol=0)


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_each_step_of_the_stairs_is_found_at_its_depth(accelerator):  # T17
    n = 64
    quads = [
        [(-1.0, k / n, k / n), (1.0, k / n, k / n), (1.0, (k + 1) / n, k / n), (-1.0, (k + 1) / n, k / n)] for k in range(n)
    ]
    faces = [face for k in range(n) for face in ((4 * k, 4 * k + 1, 4 * k + 2), (4 * k, 4 * k + 2, 4 * k + 3))]
    stairs = tracer(mesh(np.array(quads).reshape(-1, 3), faces), accelerator=accelerator)
    y = (np.arange(1000) + 0.5) / 1000
    hits = stairs.trace(np.stack([np.zeros(1000), y, np.full(1000, 2.0)], -1), np.tile([0.0, 0.0, -1.0], (1000, 1)))
    assert np.abs(hits.t - (2.0 - np.floor(y * n) / n)).max() <= 4 * EPS
