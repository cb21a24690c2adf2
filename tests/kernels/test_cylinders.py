"""The lanes' cylinder against sixty digits, and its renderers against the reference."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

import engines
from engines.kernels.flatten.shapes import ANALYTIC
from engines.kernels.lane.lights import Light, sample_cylinder
from engines.kernels.lane.shapes import cylinder
from engines.kernels.lane.vector import Vec3
from engines.scene import Cylinder
from tests.cylinder_truth import TILTED, truth
from tests.test_engines_agree import _assert_equal

EPS = float(np.finfo(float).eps)


@njit
def _found(origins, directions, p):
    """(n, 10) of each ray: t, the point, the normal, the tangent."""
    result = np.empty((len(origins), 10))
    parameters = (p[0], p[1], p[2], p[3], p[4], p[5], p[6])
    for i in range(len(origins)):
        o, d = (Vec3(origins[i, 0], origins[i, 1], origins[i, 2]), Vec3(directions[i, 0], directions[i, 1], directions[i, 2]))
        hit = cylinder.intersection(o, d, parameters, np.float64)
        result[i, 0] = hit.t
        for k, v in enumerate((hit.point, hit.normal, hit.tangent)):
            result[i, 3 * k + 1], result[i, 3 * k + 2], result[i, 3 * k + 3] = v.x, v.y, v.z
    return result


@njit
def _coordinates(points, p):
    result = np.empty((len(points), 8))
    parameters = (p[0], p[1], p[2], p[3], p[4], p[5], p[6])
    for i in range(len(points)):
        at = cylinder.coordinates(Vec3(points[i, 0], points[i, 1], points[i, 2]), parameters)
        result[i, 0], result[i, 1] = at.u, at.v
        result[i, 2], result[i, 3], result[i, 4] = at.dp_du.x, at.dp_du.y, at.dp_du.z
        result[i, 5], result[i, 6], result[i, 7] = at.dp_dv.x, at.dp_dv.y, at.dp_dv.z
    return result


def parameters(shape):
    return np.array(ANALYTIC[Cylinder].parameters(shape, np.zeros(3)))


def rays(n, far, seed):
    """Towards and past TILTED from `far` away, or from inside it."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(-0.2, 1.2, (n, 1)) * np.subtract(TILTED.p1, TILTED.p0)
    target = np.array(TILTED.p0) + along + rng.uniform(-0.35, 0.35, (n, 3))
    away = rng.normal(size=(n, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return target + far * away, -away


@pytest.mark.parametrize("far", [0.0, 2.0, 1e3, 1e6])
def test_a_lane_hits_a_cylinder_where_sixty_digits_say(far):
    """From inside, from near and from far: across the side the error is that of the origin's coordinates."""
    origins, directions = rays(500, far, 1)
    expected, found = truth(TILTED, origins, directions), _found(origins, directions, parameters(TILTED))
    hit = np.isfinite(expected)
    assert hit.sum() > 100 and np.array_equal(np.isfinite(found[:, 0]), hit)
    normal, point = found[hit, 4:7], found[hit, 1:4]
    across = np.abs((normal * directions[hit]).sum(axis=1))
    assert (np.abs(found[hit, 0] - expected[hit]) * across).max() < 8 * max(far, 1.0) * EPS
    axis = np.subtract(TILTED.p1, TILTED.p0) / np.linalg.norm(np.subtract(TILTED.p1, TILTED.p0))
    from_end = point - np.array(TILTED.p0)
    out = from_end - (from_end @ axis)[:, None] * axis
    assert np.allclose(np.linalg.norm(out, axis=1), 0.4, rtol=1e-14) and np.allclose(out, 0.4 * normal, atol=1e-14)


def test_a_lane_that_grazes_a_cylinder_hits_or_misses_as_sixty_digits_say():
    rng = np.random.default_rng(2)
    n = 300
    phi, slope = rng.uniform(0, 2 * np.pi, n), rng.uniform(-0.3, 0.3, n)
    share = 1.0 + rng.choice([-1e-9, 1e-9, -1e-12, 1e-12], n)
    out = np.stack([np.cos(phi), np.sin(phi), np.zeros(n)], -1)
    along = np.stack([-np.sin(phi), np.cos(phi), slope], -1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    standing = Cylinder((0.0, 0.0, -2.0), (0.0, 0.0, 2.0), 0.7, 0)
    origins = 0.7 * share[:, None] * out - 3.0 * along
    expected, found = truth(standing, origins, along), _found(origins, along, parameters(standing))
    assert 100 < np.isfinite(expected).sum() < 200
    assert np.array_equal(np.isfinite(found[:, 0]), np.isfinite(expected)) and np.allclose(found[:, 0], expected, rtol=1e-9)


def test_a_lane_that_starts_on_a_thin_long_cylinder_meets_its_other_side_and_not_the_point_it_left():
    """A wire 500 times as long as it is thick, from points that are put back onto it."""
    wire = Cylinder((-3.0, 1.0, 2.0), (2.0, 3.0, 3.0), 0.01, 0)
    p, rng = parameters(wire), np.random.default_rng(3)
    target = p[:3] + rng.uniform(0.1, 0.9, (400, 1)) * p[3:6]
    toward = rng.normal(size=(400, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    first = _found(target + toward, -toward, p)
    normal = first[:, 4:7]
    assert np.isfinite(first[:, 0]).all()
    offset = 256 * EPS * np.abs(first[:, 1:4]).max(axis=1, keepdims=True)
    across = _found(first[:, 1:4] - offset * normal, -normal, p)
    assert np.allclose(across[:, 0], 0.02, rtol=1e-9)
    assert np.isinf(_found(first[:, 1:4] + offset * normal, normal, p)[:, 0]).all()


def test_coordinates_of_a_cylinder_and_their_derivatives_are_those_of_its_formula():
    """point(u, v) = p0 + v (p1 - p0) + r (cos t1 + sin t2); here t1 = x, t2 = y. The tangent of a hit is dp_du, too."""
    standing = Cylinder((1.0, 2.0, 3.0), (1.0, 2.0, 5.0), 0.5, 0)
    u, v = np.random.default_rng(4).random((2, 200))
    cos, sin = np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)
    found = _coordinates(np.stack([1 + 0.5 * cos, 2 + 0.5 * sin, 3 + 2 * v], -1), parameters(standing))
    assert np.allclose(found[:, 0], u, atol=1e-14) and np.allclose(found[:, 1], v, atol=1e-14)
    around = np.pi * np.stack([-sin, cos, 0 * u], -1)
    assert np.allclose(found[:, 2:5], around, atol=1e-13) and np.allclose(found[:, 5:], [0.0, 0.0, 2.0], atol=1e-15)
    out = np.stack([cos, sin, 0 * u], -1)
    hits = _found(np.array([1.0, 2.0, 0.0]) + out + np.outer(3 + 2 * v, [0, 0, 1]), -out, parameters(standing))
    assert np.allclose(hits[:, 7:], around, atol=1e-13)


@njit
def _sampled(p, point, u0, u1):
    result = np.empty((len(u0), 5))
    none = Vec3(0.0, 0.0, 0.0)
    lamp = Light((p[0], p[1], p[2], p[3], p[4], p[5], p[6], 0.0), Vec3(1.0, 1.0, 1.0), 1.0, none, none, none)
    for i in range(len(u0)):
        at = sample_cylinder(lamp, Vec3(point[0], point[1], point[2]), none, u0[i], u1[i])
        result[i, 0], result[i, 1], result[i, 2] = at.wi.x, at.wi.y, at.wi.z
        result[i, 3], result[i, 4] = at.distance, at.pdf
    return result


def test_a_lane_samples_a_cylinder_as_the_reference_does():
    from tests.numpy_reference.small_scenes import material, renderer, scene

    u0, u1 = np.random.default_rng(5).random((2, 500))
    point = np.array([2.0, -1.0, 3.0])
    held = scene([replace(TILTED, material=1)], [material(), material(emission=1.0, two_sided=True)])
    lights = renderer(held)._context.lights
    seen = np.repeat(point[:, None], 500, axis=1)
    expected = lights.sample(np.zeros(500, int), seen, seen, u0, u1, u0)
    found = _sampled(parameters(TILTED), point, u0, u1)
    assert np.allclose(found[:, :3], expected.wi.T, atol=1e-14)
    assert np.allclose(found[:, 3], expected.distance, rtol=1e-14) and np.allclose(found[:, 4], expected.pdf, rtol=1e-11)


def _tubes(two_sided=False):
    """Cylinders that emit, mirror, refract and scatter, one seen from inside, among other shapes."""
    held = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 1.2, 5], "target": [0, 0.9, 0], "fov": 50, "resolution": [24, 24]},
            "materials": {
                "white": {"kd": 0.7},
                "lamp": {"emission": [5, 4, 3], "two_sided": two_sided, "kd": 0.1},
                "mirror": {"ks": 0.9},
                "glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True},
                "brushed": {"conductor": {"metal": "Au", "alpha": [0.1, 0.4]}},
            },
            "shapes": [
                {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "white"},
                {"sphere": {"center": [1.6, 0.5, 0.4], "radius": 0.5}, "material": "white"},
                {"triangle": {"a": [-3, 0, -2], "b": [3, 0, -2], "c": [0, 4, -2]}, "material": "white"},
            ],
            "lights": [{"environment": {"radiance": [0.1, 0.15, 0.2]}}],
        }
    )
    index = {material.name: k for k, material in enumerate(held.materials)}
    tubes = (
        Cylinder((-1.5, 2.2, 0.0), (1.2, 2.5, 0.3), 0.15, index["lamp"]),
        Cylinder((-1.2, 0.0, 0.0), (-1.2, 1.1, 0.1), 0.45, index["brushed"]),
        Cylinder((0.2, 0.3, 1.2), (0.9, 0.5, 0.8), 0.25, index["glass"]),
        Cylinder((0.1, 0.7, -0.9), (0.5, 1.7, -0.6), 0.4, index["mirror"]),
        Cylinder((-0.6, 0.2, 1.0), (-0.5, 0.3, 1.9), 0.2, index["white"]),
    )
    return replace(held, shapes=(*held.shapes, *tubes))


@pytest.mark.parametrize("shader", ["path_tracer", "whitted"])
def test_numba_in_float64_equals_the_reference_among_cylinders(shader):
    _assert_equal(_tubes(), ["none", "bvh"], shader=shader, sampler="sobol", spp=3, width=24, height=24)


def test_light_leaves_both_sides_of_a_tube_in_both_engines():
    shader = {"name": "path_tracer", "max_depth": 3, "direct": "light"}
    _assert_equal(_tubes(two_sided=True), ["none"], shader=shader, spp=3, width=24, height=24)
