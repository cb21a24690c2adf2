"""The lanes' arithmetic against NumPy, in both precisions."""

import numpy as np
import pytest
from numba import njit
from scipy import special
from scipy.stats import qmc

from engines.choices import Choice
from engines.kernels.compile.jit import inline
from engines.kernels.flatten.media import medium_rows
from engines.kernels.lane.elementary import arctan2, erfcx, exp, log
from engines.kernels.lane.fresnel import refract
from engines.kernels.lane.media import phase, sample_phase
from engines.kernels.lane.vector import Vec3, dot, sin_cos_turn, tangents
from engines.kernels.stages import sampler
from engines.scene import HomogeneousMedium
from tests.numpy_reference.small_scenes import GLASS_REFLECTANCE, henyey_greenstein

TYPES = [np.float32, np.float64]


@njit
def _sin_cos(u):
    s, c = np.empty_like(u), np.empty_like(u)
    for i in range(len(u)):
        s[i], c[i] = sin_cos_turn(u[i])
    return s, c


@pytest.mark.parametrize("real", TYPES)
def test_sine_and_cosine_of_a_turn_are_within_two_ulps_of_one(real):
    u = np.concatenate([np.linspace(0, 1, 4097)[:-1], [1 - 2.0**-24]]).astype(real)
    for got, want in zip(_sin_cos(u), (np.sin, np.cos), strict=True):
        exact = want(2 * np.pi * u.astype(np.float64))
        assert got.dtype == real
        assert np.abs(got - exact).max() < 4 * np.finfo(real).eps


@njit
def _angles(y, x):
    found = np.empty_like(y)
    for i in range(len(y)):
        found[i] = arctan2(y[i], x[i])
    return found


@pytest.mark.parametrize("real", TYPES)
def test_the_angle_of_a_point_in_the_plane_is_within_two_ulps_and_has_the_sign_of_ieee(real):
    x, y = np.random.default_rng(3).normal(size=(2, 20_000)).astype(real)
    x, y = np.concatenate([x, [0, 0, 1, 1e-20]]), np.concatenate([y, [1, -1, 0, -1]])
    zeros = np.array([[0.0, 0.0, -0.0, -0.0, -1, -1], [0.0, -0.0, 0.0, -0.0, 0.0, -0.0]])
    x, y = np.concatenate([x, zeros[0]]).astype(real), np.concatenate([y, zeros[1]]).astype(real)
    exact = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    got = _angles(y, x)
    assert got.dtype == real
    assert np.all(np.abs(got - exact) <= 2 * np.finfo(real).eps * np.abs(exact))
    assert np.array_equal(np.signbit(got), np.signbit(exact))


@njit
def _frame_defect(n):
    worst = 0.0
    for i in range(len(n)):
        normal = Vec3(n[i, 0], n[i, 1], n[i, 2])
        t, b = tangents(normal)
        for x in (dot(t, b), dot(t, normal), dot(b, normal), dot(t, t) - 1.0, dot(b, b) - 1.0):
            worst = max(worst, abs(x))
    return worst


def test_the_local_frame_is_orthonormal_for_every_normal():
    n = np.random.default_rng(1).normal(size=(20_000, 3))
    n = np.concatenate([n / np.linalg.norm(n, axis=1)[:, None], np.eye(3), -np.eye(3)])
    hard = [(0.00038527316, 0.00038460016, -0.99999988079), (-0.00019813581, -0.00008946839, -0.99999988079)]
    hard = np.array(hard) / np.linalg.norm(hard, axis=1)[:, None]
    assert _frame_defect(n) < 1e-14
    assert _frame_defect(hard) < 1e-10


@njit
def _reflectance(cos, eta):
    return refract(Vec3(np.sqrt(1.0 - cos * cos), 0.0, -cos), Vec3(0.0, 0.0, 1.0), eta).reflectance


@pytest.mark.parametrize(("degrees", "expected"), GLASS_REFLECTANCE)
def test_fresnel_reflectance_from_outside_glass(degrees, expected):
    assert _reflectance(np.cos(np.radians(degrees)), 1.5) == pytest.approx(expected, rel=1e-12)


def test_total_reflection_begins_at_the_critical_angle_and_is_never_nan():
    critical = np.degrees(np.arcsin(1 / 1.5))
    assert _reflectance(np.cos(np.radians(41.8)), 1 / 1.5) == pytest.approx(0.8907719215, rel=1e-8)
    assert all(_reflectance(np.cos(np.radians(a)), 1 / 1.5) == 1.0 for a in (critical + 1e-9, 60.0, 89.999, 90.0))
    assert np.isfinite([_reflectance(c, e) for c in (0.0, 1e-300, 1e-9, 1.0) for e in (1.0, 1.5, 1 / 1.5)]).all()


def test_tabulated_halton_points_start_as_they_must():
    table = sampler.points(Choice("halton", {"scramble": "none"}), 0, 5) / 2.0**32
    expected = [(0, 0), (1 / 2, 1 / 3), (1 / 4, 2 / 3), (3 / 4, 1 / 9), (1 / 8, 4 / 9)]
    assert np.allclose(table[:, :2], expected, atol=2.0**-31)


def test_tabulated_sobol_points_equal_scipys():
    theirs = qmc.Sobol(8, scramble=False, bits=32).random(64)
    ours = sampler.points(Choice("sobol", {"scramble": "none"}), 0, 64)[:, :8] / 2.0**32
    assert sorted(map(tuple, ours)) == sorted(map(tuple, theirs))


def test_a_function_of_one_lane_can_be_called_from_python_before_and_after_compiled_code_has():
    @inline
    def double(x):
        return 2 * x

    @njit
    def compiled(x):
        return double(x)

    assert (double(4), compiled(4), double(4), double(0.25), compiled(0.25), double(x=0.25)) == (8, 8, 8, 0.5, 0.5, 0.5)


@njit
def _transcendental(x, small):
    e, logarithm, scaled = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    for i in range(len(x)):
        e[i], logarithm[i], scaled[i] = exp(-x[i]), log(x[i]), erfcx(small[i])
    return e, logarithm, scaled


@pytest.mark.parametrize("real", TYPES)
def test_exponential_logarithm_and_error_function_are_within_a_few_ulps(real):
    x = np.concatenate([np.logspace(-30, 1.9, 2000), np.linspace(0.5, 2, 2001)]).astype(real)
    small = np.resize(np.linspace(0, 5, 501), x.size).astype(real)
    found = _transcendental(x, small)
    wide, tail = x.astype(np.float64), small.astype(np.float64)
    expected = np.exp(-wide), np.log(wide), special.erfcx(tail)
    for got, want, ulps in zip(found, expected, (2, 2, 5), strict=True):
        assert got.dtype == real
        assert (np.abs(got - want) <= ulps * np.finfo(real).eps * np.abs(want)).all()


@njit
def _scattered(g, direction, u):
    wi, pdf, again = np.empty((3, len(u)), u.dtype), np.empty_like(u), np.empty_like(u)
    d = Vec3(direction[0], direction[1], direction[2])
    for i in range(len(u)):
        found, pdf[i] = sample_phase(g, d, u[i], direction[0])
        wi[0, i], wi[1, i], wi[2, i] = found.x, found.y, found.z
        again[i] = phase(g, d, found)
    return wi, pdf, again


@pytest.mark.parametrize("real", TYPES)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("least", [0.3, 1e-3, 1e-6, None])
def test_phase_functions_are_precise_however_narrow_their_peak_is(real, side, least):
    eps, u = np.finfo(real).eps, (np.arange(1, 1024, 11) / 1024).astype(real)
    g = real(side) * real(1.0 - (eps / 2 if least is None else least))
    wi, pdf, again = _scattered(g, np.array([0, 0, 1], real), u)
    cosine, sine, density = henyey_greenstein(g, u)
    assert wi.dtype == pdf.dtype == again.dtype == real
    assert np.abs(wi[2] - cosine).max() <= 4 * eps
    assert np.abs(wi[0] / sine - 1.0).max() <= 400 * eps
    assert np.abs(pdf / density - 1.0).max() <= 40 * eps
    assert (again > 0.0).all()
    assert np.abs(again / density - 1.0).max() <= 40 * eps / (1.0 - abs(g))


@pytest.mark.parametrize("real", TYPES)
def test_no_precision_rounds_a_phase_function_to_a_single_direction(real):
    gs = [1.0 - 2.0**-k for k in (20, 30, 53)]
    rows = medium_rows([HomogeneousMedium("m", (1.0,) * 3, (1.0,) * 3, side * g) for side in (1, -1) for g in gs], real)
    assert rows.dtype == real
    assert (np.abs(rows[:, -1]) < 1.0).all()
    assert rows[:3, -1] == pytest.approx(gs, rel=float(np.finfo(real).eps))
