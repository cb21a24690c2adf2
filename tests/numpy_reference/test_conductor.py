"""Conductors: Fresnel's equations, GGX by its definition, the local frame of each shape, and images that are known."""

import numpy as np
import pytest

from engines.numpy_reference.bsdf import ggx
from engines.numpy_reference.bsdf.fresnel import fresnel_conductor, fresnel_dielectric
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.vectors import Frame
from engines.scene import BLACK, DirectionalLight, Disk, EnvironmentLight, Plane, Sphere, Triangle
from tests.numpy_reference.bsdf_points import (
    EAST,
    GOLD,
    UP,
    WHITE,
    conductor,
    evaluated,
    even_directions,
    points,
    polar,
    quadrature,
)
from tests.numpy_reference.small_scenes import (
    GLASS,
    exact,
    image,
    material,
    mesh,
    path_tracer,
    point_view,
    renderer,
    scene,
    unit_sphere,
    whitted,
)

SKY = EnvironmentLight((1.0, 1.0, 1.0))
COSINES = np.cos(np.radians([0.0, 20.0, 45.0, 60.0, 75.0, 85.0, 89.9]))


@pytest.mark.parametrize(("eta", "k"), [(0.044, 2.42), (0.2, 3.44), (0.62, 2.57), (1.44, 5.23), (3.1, 3.3), (1.5, 0.0)])
def test_reflectance_follows_from_the_continuity_of_the_fields(eta, k):
    """The tangential E and H are continuous across the surface: 1 + r = t and c (1 - r) = a t, with a = w where E is
    perpendicular to the plane of incidence, and a = w / m^2 where H is; m = eta + ik, w = sqrt(m^2 - sin^2)."""
    square = complex(eta, k) ** 2
    w = np.sqrt(square - (1.0 - COSINES**2))
    one, reflectance = np.ones_like(w), np.zeros(len(COSINES))
    for a in (w, w / square):
        equations = np.array([[one, -one], [COSINES, a]]).transpose(2, 0, 1)
        r, _ = np.linalg.solve(equations, np.array([-one, COSINES]).T[:, :, None])[:, :, 0].T
        reflectance += np.abs(r) ** 2 / 2.0
    found = fresnel_conductor(COSINES, np.array([eta]), np.array([k]))
    assert np.allclose(found, reflectance, rtol=1e-11)


@pytest.mark.parametrize("eta", [0.4, 0.9, 1.5, 3.0])
def test_a_conductor_that_absorbs_nothing_is_a_dielectric(eta):
    """Total reflection beyond the critical angle included."""
    found = fresnel_conductor(COSINES, np.array([eta]), np.zeros(1))
    assert np.allclose(found, fresnel_dielectric(COSINES, np.array([eta]))[0], rtol=1e-12)


@pytest.mark.parametrize(("eta", "k"), [(0.2, 3.4), (1.4, 5.2), (2.9, 3.1), (0.0, 1.0), (4.0, 0.01)])
def test_reflectance_is_that_of_the_equations_in_real_numbers(eta, k):
    """The form without complex numbers, as docs/transport.md has it."""
    c, s2 = COSINES, 1.0 - COSINES**2
    g = eta**2 - k**2 - s2
    b = np.hypot(g, 2.0 * eta * k)
    a = np.sqrt(np.maximum((b + g) / 2.0, 0.0))
    rs = (b + c**2 - 2.0 * a * c) / (b + c**2 + 2.0 * a * c)
    rp = rs * (b * c**2 + s2**2 - 2.0 * a * c * s2) / (b * c**2 + s2**2 + 2.0 * a * c * s2)
    found = fresnel_conductor(c, np.array([eta]), np.array([k]))
    assert np.allclose(found, (rs + rp) / 2.0, rtol=1e-11)
    assert (found <= 1.0 + 1e-15).all()


@pytest.mark.parametrize("alpha", [(0.5, 0.5), (0.1, 0.4), (1.0, 0.2)])
def test_the_facets_cover_the_surface_once(alpha):
    """Their projected area is that of the surface; those seen from any side, masked, cover just what is seen of it."""
    m, weights = quadrature(400, 400)
    pair = np.array(alpha)[:, None]
    area = ggx.distribution(m, pair) * weights
    assert abs((area * m[2]).sum() - 1.0) < 1e-4
    for view in (polar(0.0), polar(50.0, 20.0), polar(85.0, 70.0)):
        seen = (np.maximum((view * m).sum(axis=0), 0.0) * area).sum() * ggx.masking(view, pair)
        assert abs(seen[0] - view[2, 0]) < 1e-4


def test_a_conductor_turned_by_a_quarter_has_its_roughnesses_exchanged():
    wo, wi = even_directions(500, 1), even_directions(500, 2)
    turned = evaluated(conductor((0.1, 0.4)), wo, wi, dp_du=np.cross(UP, EAST, axis=0))
    assert np.allclose(turned, evaluated(conductor((0.4, 0.1)), wo, wi), rtol=1e-12)
    assert not np.allclose(turned, evaluated(conductor((0.1, 0.4)), wo, wi), rtol=0.1)


def test_a_frame_is_right_handed_and_along_what_it_can_be():
    """x along the part of u across n; where u is 0 or along n, that of the normal alone."""
    n = even_directions(3, 3)
    u = np.stack([3e-9 * np.array([1.0, 2.0, -1.0]), np.zeros(3), -4.0 * n[:, 2]], axis=1)
    frame = Frame.along(n, u)
    basis = np.stack(frame)
    assert np.allclose(np.einsum("ikn,jkn->ijn", basis, basis), np.eye(3)[:, :, None], atol=1e-12)
    assert np.allclose(np.linalg.det(basis.transpose(2, 0, 1)), 1.0, rtol=1e-12)
    assert frame.x[:, 0] @ u[:, 0] > 0.0 and abs(frame.y[:, 0] @ u[:, 0]) < 1e-20
    sign = np.where(n[2] < -0.7, -1.0, 1.0)
    a = -1.0 / (sign + n[2])
    duff = np.stack([1.0 + sign * n[0] ** 2 * a, sign * n[0] * n[1] * a, -sign * n[0]])
    assert np.allclose(frame.x[:, 1:], duff[:, 1:], rtol=1e-12)
    v = even_directions(3, 4)
    assert np.allclose(frame.to_world(frame.to_local(v)), v, rtol=1e-12)


TRIANGLE = Triangle((-1.0, -1.0, 0.0), (2.0, 0.5, 0.0), (-1.0, 2.0, 0.0), 0)
WHERE = np.array([[0.2], [0.3], [5.0]])


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (TRIANGLE, (3.0, 1.5, 0.0)),
        (mesh([TRIANGLE.a, TRIANGLE.b, TRIANGLE.c], [[2, 0, 1]], normals=np.tile([0.0, 0.6, 0.8], (3, 1))), (0, -3, 0)),
        (Sphere((0.0, 0.0, 0.0), 1.0, 0), (-0.3, 0.2, 0.0)),
        (Disk((0.1, -0.1, 0.0), (0.0, 0.0, 1.0), 2.0, 0), (0.1, 0.4, 0.0)),
        (Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0), (0.0, 0.0, 0.0)),
    ],
    ids=["triangle", "face", "sphere", "disk", "plane"],
)
def test_the_first_coordinate_of_every_shape_runs_where_the_specification_says(shape, expected):
    context = renderer(scene([shape]))._context
    direction = np.array([[0.0], [0.0], [-1.0]])
    for origin, along in ((WHERE, direction), (WHERE * [[1.0], [1.0], [-1.0]], -direction)):  # from either side
        at = context.surface(origin, along, context.closest(origin, along))
        assert np.allclose(at.dp_du[:, 0], expected, rtol=1e-12, atol=1e-15)
        assert np.array_equal(at.wo, -along)


@pytest.mark.parametrize("shader", [path_tracer(2), whitted(2)], ids=["path_tracer", "whitted"])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["front", "back"])
def test_a_smooth_conductor_is_a_mirror_of_fresnels_reflectance_on_both_sides(shader, side):
    eye = (float(side * np.sin(np.radians(60.0))), 0.0, float(side * 0.5))
    floor = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0)
    held = scene([floor], [conductor(0.0, GOLD, (0.5, 0.6, 0.7))], [SKY], point_view(eye, (0.0, 0.0, 0.0), up=(0, 1, 0)))
    seen = exact(held, shader)
    expected = fresnel_conductor(np.array([0.5]), *(np.array(part) for part in GOLD)) * [0.5, 0.6, 0.7]
    assert np.allclose(seen, expected, rtol=1e-12)


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
def test_a_rough_conductor_under_a_directional_light_shows_its_value(direct):
    """Delta lights are sampled by every strategy, without noise: L = f cos E; whitted and no_shadows as well."""
    metal, towards = conductor((0.2, 0.5), GOLD), polar(35.0, 140.0)
    light = DirectionalLight(tuple((-towards[:, 0]).tolist()), (2.0, 2.0, 2.0))
    floor = Triangle((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 9.0, 0.0), 0)
    wo = polar(30.0, 40.0)
    held = scene([floor], [metal], [light], point_view(tuple((5.0 * wo[:, 0]).tolist()), (0.0, 0.0, 0.0)))
    expected = evaluated(metal, wo, towards)[:, 0] * towards[2, 0] * 2.0
    for shader in (path_tracer(2, direct), whitted(), {"name": "no_shadows"}):
        assert np.allclose(exact(held, shader), expected, rtol=1e-9), shader


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
@pytest.mark.parametrize("alpha", [0.15, (0.1, 0.6)], ids=["isotropic", "anisotropic"])
def test_a_furnace_shows_the_albedo_of_a_rough_conductor(alpha, direct):
    """Under a uniform sky a convex metal is as bright as its albedo by quadrature, which is below 1; |z| < 4.5."""
    wo = polar(50.0, 25.0)
    plane = Triangle((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 9.0, 0.0), 0)
    view = point_view(tuple((5.0 * wo[:, 0]).tolist()), (0.0, 0.0, 0.0), 48)
    seen = image(scene([plane], [conductor(alpha)], [SKY], view), path_tracer(2, direct), spp=16, seed=2)
    wi, weights = quadrature(400, 200, around=205.0)
    albedo = (evaluated(conductor(alpha), wo, wi)[0] * wi[2] * weights).sum()
    error = max(seen.std(ddof=1) / np.sqrt(seen.size), 1e-9)
    assert 0.5 < albedo < 1.0 and abs(seen.mean() - albedo) < 4.5 * error


@pytest.mark.parametrize("roughness", [0.0, 0.05, 1.0])
def test_a_metal_ball_in_a_furnace_is_never_brighter_than_the_sky(roughness):
    """Its samples have no weight above 1; smooth and white it cannot be seen."""
    seen = image(scene([unit_sphere()], [conductor(roughness)], [SKY]), path_tracer(8, "bsdf"), spp=4)
    assert seen.max() <= 1.0 + 1e-12
    if roughness == 0.0:
        assert np.abs(seen - 1.0).max() < 1e-12


def test_an_anisotropic_highlight_is_long_along_the_rougher_tangent():
    """Seen along the normal, with a light beside it: brighter where the facets lean further."""
    metal = conductor((0.4, 0.05))
    beside, above = polar(40.0, 0.0), polar(40.0, 90.0)
    assert evaluated(metal, UP, beside)[0, 0] > 10.0 * evaluated(metal, UP, above)[0, 0]


def test_albedo_shows_the_reflectance_at_normal_incidence():
    held = [conductor(alpha, GOLD, (1.0, 0.5, 0.25)) for alpha in (0.0, 0.3)]
    held += [conductor(0.3, WHITE, BLACK), material(emission=2.0), GLASS]
    expected = [((e - 1) ** 2 + k**2) / ((e + 1) ** 2 + k**2) for e, k in zip(*GOLD, strict=True)]
    shown = Materials(held).albedo(points(np.repeat(UP, 5, axis=1))._replace(material=np.arange(5)))
    assert np.allclose(shown[:, :2].T, np.array(expected) * [1.0, 0.5, 0.25], rtol=1e-12)
    assert not shown[:, 2].any() and np.array_equal(shown[:, 3], [2, 2, 2]) and np.array_equal(shown[:, 4], [1, 1, 1])


def test_extreme_roughness_and_grazing_views_stay_finite():
    """The least roughness that a scene may have, and directions a hair above the surface."""
    angles = np.array([0.0, 45.0, 89.0, 89.9999, 90.0 - 1e-10])
    wo, draws = np.repeat(polar(angles, 10.0), 400, axis=1), np.random.default_rng(5).random((3, 2000))
    for alpha in (1e-4, (1e-4, 1.0), 1.0):
        table = Materials([conductor(alpha)])
        found = table.sample(points(wo), *draws)
        assert np.isfinite(found.weight).all() and found.weight.max() <= 1.0 + 1e-12
        value, pdf = table.evaluate(points(wo), found.wi), table.pdf(points(wo), found.wi)
        assert np.isfinite(value).all() and np.isfinite(pdf).all() and value.min() >= 0.0
