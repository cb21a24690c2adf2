"""The exact answers and the closed forms against mpmath, printed numbers and quadrature."""

import math

import mpmath
import numpy as np
import pytest

from harness.trace import oracle
from harness.verify import closed_forms
from harness.verify.checks.glass import fresnel
from harness.verify.checks.sampling import slope_of
from tests.numpy_reference.small_scenes import GLASS_REFLECTANCE


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


@pytest.mark.parametrize(("degrees", "expected"), GLASS_REFLECTANCE)
def test_fresnel_has_its_printed_values(degrees, expected):
    assert abs(fresnel(math.sin(math.radians(degrees)), 1.5) - expected) < 1e-13


def test_polygons_have_their_printed_values():
    corners = np.array([(-0.5, 1, -0.5), (0.5, 1, -0.5), (0.5, 1, 0.5), (-0.5, 1, 0.5)])
    assert abs(closed_forms.polygon(corners, (0, 1, 0)) - 0.7522746884541074) < 1e-14
    assert abs(closed_forms.polygon(corners - (0.5, 0, 0.5), (0, 1, 0)) - 0.4352098756835515) < 1e-14


@pytest.mark.parametrize(
    ("radius", "distance", "beta"),
    [(1.0, 2.0, 90.0), (1.0, 2.0, 75.0), (1.0, 1.3, 60.0), (0.5, 3.0, 45.0), (3.0, 4.0, 100.0), (1.0, 1.02, 20.0)],
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


def test_form_factors_have_their_printed_values():
    assert abs(closed_forms.parallel_rectangles(1.0, 1.0) - 0.19982489569838746) < 1e-14
    assert abs(closed_forms.perpendicular_rectangles(1.0, 1.0) - 0.20004377607540316) < 1e-14
    assert abs(closed_forms.coaxial_discs(1.0, 1.0) - 0.3819660112501051) < 1e-14


@pytest.mark.parametrize(("x", "y"), [(0.5, 2.0), (3.0, 0.4)])
def test_form_factors_of_rectangles_agree_with_quadrature(x, y):
    """Gauss and Legendre's rule in the distances; cubed nodes, because two at a right angle meet in a singular edge."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    n = (nodes + 1) / 2
    t, w = n**3, 3 * n**2 * weights / 2
    a, b, s = np.meshgrid(t, t, t, indexing="ij")
    weight = np.einsum("i,j,k->ijk", w, w, w)
    facing = 4 * (1 - a) * (1 - b) * x * y / (np.pi * ((x * a) ** 2 + (y * b) ** 2 + 1) ** 2)
    assert abs((weight * facing).sum() - closed_forms.parallel_rectangles(x, y)) < 1e-9
    height, wide = x * a, y * b  # a wall on the edge of a floor
    corner = 2 * (1 - s) * x * height * wide / (np.pi * (height**2 + wide**2 + s**2) ** 2)
    assert abs((weight * corner).sum() - closed_forms.perpendicular_rectangles(x, y)) < 1e-5


def test_second_moments_of_roulette_are_those_of_simulated_paths():
    """|z| < 4.5 over 200,000 paths: a false alarm has probability 7e-6 a case."""
    rng = np.random.default_rng(3)
    for rho, survival in ((0.5, 0.5), (0.5, 0.8), (0.3, 0.2)):
        segments = rng.geometric(1 - survival, 200_000)
        seen = 0.7 * (1 - (rho / survival) ** segments) / (1 - rho / survival) if rho != survival else 0.7 * segments
        error = (seen**2).std() / math.sqrt(seen.size)
        assert abs((seen**2).mean() - closed_forms.roulette_second_moment(0.7, rho, survival)) < 4.5 * error


def test_the_printed_deviation_of_a_ball_lens_follows_from_snell():
    assert abs(math.degrees(2 * (math.asin(0.5) - math.asin(0.5 / 1.5))) - 21.057558731018624) < 1e-13


def test_a_slope_and_its_error_are_those_of_made_up_errors():
    """Of 64 made-up series of slope -3/4 some 99 % of intervals hold it; fewer than 60 have a chance of 3e-4."""
    rng, counts = np.random.default_rng(4), [4, 16, 64, 256, 1024]
    held = 0
    for _ in range(64):
        errors = rng.normal(size=(5, 256)) * np.array(counts)[:, None] ** -0.75
        slope, error = slope_of(counts, errors**2)
        held += abs(slope + 0.75) < 2.95 * error
    assert held >= 60
