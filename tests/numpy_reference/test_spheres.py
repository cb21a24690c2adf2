"""Spheres against the exact answer, computed from the same floats with 60 digits."""

import mpmath
import numpy as np
import pytest

from engines.scene import Sphere, SphereSet
from tests.numpy_reference.small_scenes import EPS, rays_around, tracer, unit_rows


def exact_roots(center, radius, origin, direction):
    """Both t, in units of the direction's length, or None."""
    with mpmath.workdps(60):
        f = [mpmath.mpf(o) - mpmath.mpf(c) for o, c in zip(origin, center, strict=True)]
        d = [mpmath.mpf(x) for x in direction]
        a, b = sum(x * x for x in d), sum(x * y for x, y in zip(f, d, strict=True))
        disc = b * b - a * (sum(x * x for x in f) - mpmath.mpf(radius) ** 2)
        if disc < 0:
            return None
        return [(-b - mpmath.sqrt(disc)) / a, (-b + mpmath.sqrt(disc)) / a]


def hit(center, radius, origin, direction):
    return float(tracer(Sphere(center, radius, 0)).trace([origin], [direction]).t[0])


@pytest.mark.parametrize("distance", [1e2, 1e3, 1e4, 1e5, 1e6, 1e7])
def test_a_distant_unit_sphere_is_hit_to_the_last_digits(distance):  # S1
    rng = np.random.default_rng(3)
    for _ in range(20):
        impact, angle = 0.95 * np.sqrt(rng.random()), 2 * np.pi * rng.random()
        origin = (impact * np.cos(angle), impact * np.sin(angle), distance)
        expected = exact_roots((0, 0, 0), 1, origin, (0, 0, -1))[0]
        found = hit((0.0, 0.0, 0.0), 1.0, origin, (0.0, 0.0, -1.0))
        assert abs(found - expected) <= 4e-15 * expected


@pytest.mark.parametrize(("radius", "tolerance"), [(1e3, 1e-12), (1e4, 1e-11), (1e5, 1e-10), (1e6, 1e-9)])
def test_a_huge_sphere_is_a_good_floor(radius, tolerance):  # S3
    origin, direction = (0.0, 1.5, 0.0), (0.3, -0.5, -0.8)
    expected = exact_roots((0, -radius, 0), radius, origin, direction)[0]
    assert abs(hit((0.0, -radius, 0.0), radius, origin, direction) - expected) <= tolerance * expected


def test_from_inside_the_far_side_is_hit():  # S4
    rng = np.random.default_rng(4)
    for _ in range(50):
        origin = tuple(0.9 * rng.random() * unit_rows(rng.normal(size=3)))
        direction = tuple(rng.normal(size=3))
        expected = exact_roots((0, 0, 0), 1, origin, direction)[1]
        assert abs(hit((0.0, 0.0, 0.0), 1.0, origin, direction) - expected) <= 1e-13 * expected


def test_from_the_surface_inwards_the_far_side_is_hit():  # S5
    rng = np.random.default_rng(5)
    for _ in range(200):
        origin, direction = unit_rows(rng.normal(size=3)), unit_rows(rng.normal(size=3))
        cosine = abs(origin @ direction)
        direction = direction if origin @ direction < 0 else -direction
        if cosine < 1e-3:
            continue
        found = hit((0.0, 0.0, 0.0), 1.0, tuple(origin), tuple(direction))
        # an origin that is an ulp off the surface moves the far root by 1 / cosine ulps
        assert abs(found - 2 * cosine) <= 8 * EPS / cosine
        assert not np.isfinite(hit((0.0, 0.0, 0.0), 1.0, tuple(origin), tuple(-direction)))


def test_tangent_rays_hit_or_miss_but_give_no_nan():  # S6
    angles = np.linspace(0, 2 * np.pi, 1000)
    origins = np.stack([np.cos(angles), np.sin(angles), np.full(1000, 5.0)], -1)
    hits = tracer(Sphere((0.0, 0.0, 0.0), 1.0, 0)).trace(origins, np.tile([0.0, 0.0, -1.0], (1000, 1)))
    assert not np.isnan(hits.t).any() and not np.isnan(hits.normal).any()
    assert np.allclose(hits.t[np.isfinite(hits.t)], 5.0, atol=1e-7)


@pytest.mark.parametrize("length", [1e-30, 1e-10, 1e10, 1e30])
def test_the_length_of_the_direction_scales_t_alone(length):  # S7
    origins, directions = rays_around(500, 1.5)
    sphere = tracer(Sphere((0.1, 0.2, 0.3), 1.1, 0))
    once, scaled = sphere.trace(origins, directions), sphere.trace(origins, directions * length)
    assert np.array_equal(once.shape, scaled.shape)
    found = once.shape == 0
    assert found.sum() > 50
    assert np.allclose(once.t[found], scaled.t[found] * length, rtol=1e-12, atol=0)
    assert np.allclose(once.normal, scaled.normal, atol=1e-10)


def test_far_from_the_origin_of_space_the_sphere_is_the_same():  # S8
    origins, directions = rays_around(500, 3.0)
    origins, directions = np.round(origins * 1024) / 1024, np.round(directions * 1024) / 1024  # exact after the shift
    near = tracer(Sphere((0.0, 0.0, 0.0), 1.0, 0)).trace(origins, directions)
    far = tracer(Sphere((1e6, 1e6, 1e6), 1.0, 0)).trace(origins + 1e6, directions)
    assert np.array_equal(near.t, far.t)


def test_a_ray_that_leaves_a_sphere_does_not_meet_it_again():  # S9
    """Random spheres over eight decades of size and sixteen of distance; rays leave as the shaders let them leave."""
    rng = np.random.default_rng(9)
    for _ in range(300):
        radius, distance = 10.0 ** rng.uniform(-4, 4), 10.0 ** rng.uniform(-8, 8)
        center = distance * unit_rows(rng.normal(size=3))
        origin = np.zeros(3)
        inside = np.linalg.norm(center) < radius
        target = center + radius * rng.random() * unit_rows(rng.normal(size=3))
        context = tracer(Sphere(tuple(center), radius, 0))._context
        aim = unit_rows(target - origin)[:, None] if not inside else unit_rows(rng.normal(size=3))[:, None]
        hits = context.closest(origin[:, None], aim)
        if hits.primitive_id[0] < 0:
            continue
        surface = context.surface(origin[:, None], aim, hits)
        outward = surface.geometric if surface.front[0] else -surface.geometric
        out = unit_rows(rng.normal(size=(20, 3))).T
        out = np.where((out * outward).sum(axis=0) < 0, -out, out)
        out = out[:, (out * outward).sum(axis=0) > 1e-3]
        start = surface.leave(inwards=bool(~surface.front[0]))
        again = context.closest(np.repeat(start, out.shape[1], axis=1), out)
        assert (again.primitive_id < 0).all()


def test_overlapping_spheres_met_almost_at_a_tangent_come_in_the_right_order():  # S10, Embree issue 676
    spheres = (Sphere((9.66870880, -16.3965702, 3.93995930), 9.0, 0), Sphere((10.0441875, -9.69345284, 3.94893074), 9.0, 0))
    hits = tracer(*spheres).trace([(14.8001127, -9.01768494, 3.47012758)], [(-0.989340246, -0.0190101117, -0.144376263)])
    assert hits.shape[0] == 0
    assert abs(hits.t[0] - 10.2983) < 1e-4


def test_the_spheres_of_a_set_are_its_primitives():
    centers = np.array([[0.0, 0.0, -4.0], [0.0, 0.0, 4.0], [9.0, 0.0, 0.0]])
    spheres = tracer(Sphere((0.0, 9.0, 0.0), 1.0, 0), SphereSet(centers, np.array([1.0, 2.0, 3.0]), 0))
    hits = spheres.trace(np.zeros((3, 3)), [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert hits.t.tolist() == [2.0, 6.0, 8.0]
    assert hits.shape.tolist() == [1, 1, 0] and hits.primitive.tolist() == [1, 2, 0]
    assert hits.normal.tolist() == [[0, 0, -1], [-1, 0, 0], [0, -1, 0]]
    assert not hits.u.any() and not hits.v.any()
