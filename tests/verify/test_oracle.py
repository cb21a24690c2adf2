"""The exact answers and the closed forms against mpmath, printed numbers and quadrature."""

import math

import mpmath
import numpy as np
import pytest

from harness.verify import closed_forms, oracle
from harness.verify.glass import fresnel


def test_sphere_roots_agree_with_mpmath():
    rng = np.random.default_rng(1)
    origins, directions = rng.normal(size=(20, 3)) * 1e4, rng.normal(size=(20, 3))
    directions = np.where(rng.random((20, 1)) < 0.7, -origins + 0.5 * directions, directions)
    near, far = oracle.sphere_roots((0.1, 0.2, 0.3), 1.7, origins, directions)
    with mpmath.workdps(60):
        for i in range(20):
            f = [mpmath.mpf(a) - mpmath.mpf(c) for a, c in zip(origins[i], (0.1, 0.2, 0.3), strict=True)]
            d = [mpmath.mpf(x) for x in directions[i]]
            a, b = sum(x * x for x in d), sum(x * y for x, y in zip(f, d, strict=True))
            root = b * b - a * (sum(x * x for x in f) - mpmath.mpf(1.7) ** 2)
            if root < 0:
                assert not near[i].is_finite() and not far[i].is_finite()
                continue
            for found, sign in ((near[i], -1), (far[i], 1)):
                exact = (-b + sign * mpmath.sqrt(root)) / a
                assert abs(mpmath.mpf(str(found)) / exact - 1) < 1e-40


def test_crossings_reproduce_the_point():
    rng = np.random.default_rng(2)
    a, b, c, o, d = rng.normal(size=(5, 30, 3))
    t, u, v = (np.asarray(part, float)[:, None] for part in oracle.triangle(a, b, c, o, d))
    assert np.allclose(o + t * d, (1 - u - v) * a + u * b + v * c, rtol=1e-9, atol=1e-9)


def test_errors_are_counted_in_units_of_the_last_place():
    exact = oracle.lift([1.0, 3.0])
    found = np.nextafter([1.0, 3.0], 9.0)
    assert oracle.ulps(found, exact, np.float64).tolist() == [1.0, 1.0]
    assert oracle.relative([1.0, np.inf], oracle.lift([1.0, 2.0])).tolist() == [0.0, np.inf]
    assert oracle.relative([np.nan], oracle.lift([1.0])).tolist() == [np.inf]


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [(0, 0.04), (30, 0.04152262597582152), (45, 0.05023991101223595), (60, 0.08918671280221274),
     (75, 0.2530605629903197), (80, 0.3877043546914725), (89, 0.9041849497801886)],
)  # fmt: skip
def test_fresnel_has_its_printed_values(degrees, expected):
    assert abs(fresnel(math.sin(math.radians(degrees)), 1.5) - expected) < 1e-13


def test_polygons_have_their_printed_values():
    corners = np.array([(-0.5, 1, -0.5), (0.5, 1, -0.5), (0.5, 1, 0.5), (-0.5, 1, 0.5)])
    assert abs(closed_forms.polygon(corners, (0, 1, 0)) - 0.7522746884541074) < 1e-14
    assert abs(closed_forms.polygon(corners - (0.5, 0, 0.5), (0, 1, 0)) - 0.4352098756835515) < 1e-14


@pytest.mark.parametrize(
    ("radius", "distance", "beta"), [(1.0, 2.0, 90.0), (1.0, 2.0, 75.0), (1.0, 1.3, 60.0), (0.5, 3.0, 45.0)]
)
def test_sphere_lights_agree_with_quadrature(radius, distance, beta):
    """E = integral of max(cos, 0) over the cone of directions that meet the sphere."""
    beta, half = math.radians(beta), math.asin(radius / distance)
    theta = (np.arange(2000) + 0.5) / 2000 * half
    phi = (np.arange(2000) + 0.5) / 2000 * 2 * math.pi
    t, p = np.meshgrid(theta, phi, indexing="ij")
    cosine = np.cos(t) * math.cos(beta) + np.sin(t) * np.cos(p) * math.sin(beta)
    total = (np.maximum(cosine, 0) * np.sin(t)).sum() * (half / 2000) * (2 * math.pi / 2000)
    assert abs(closed_forms.sphere(radius, distance, beta) - total) < 1e-5
    assert abs(closed_forms.sphere(1.0, 2.0, math.pi / 2) - 0.09058607370607963) < 1e-15


def test_the_second_moment_of_roulette_is_that_of_the_formula():
    """With q = rho^k from the first segment on, beta is 1 after every one: L is E times a geometric count of segments."""
    assert abs(closed_forms.roulette_second_moment(0.5, 0.5) - 0.25 * (1 + 0.5) / 0.5**2) < 1e-12
