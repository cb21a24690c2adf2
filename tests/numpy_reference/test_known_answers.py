"""Images whose radiance is known. Where the estimator has no variance the answer must be exact to rounding.

Statistical tests take the pixels of a very narrow view as independent replicates, with the sampler `random`, and hold
|z| < 4.5: with 256 or more replicates a false alarm has probability 7e-6 a test. Seeds are fixed.
"""

import numpy as np
import pytest

from engines.scene import DirectionalLight, EnvironmentLight, Plane, PointLight, Sphere, Triangle
from tests.numpy_reference.small_scenes import (
    box_mesh,
    image,
    material,
    path_tracer,
    point_view,
    scene,
    sphere_mesh,
    unit_sphere,
    whitted,
    z_score,
)

FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)
SKY = EnvironmentLight((1.0, 1.0, 1.0))
STRATEGIES = ("light", "bsdf", "mis")


def floor_view(x=0.0, side=32):
    """Looks at (x, 0, 0) from above and aside; 'up' is never along the view."""
    return point_view((x + 0.3, 1.5, 4.0), (x, 0.0, 0.0), side)


def quad(corners, index):
    a, b, c, d = (tuple(map(float, corner)) for corner in corners)
    return [Triangle(a, b, c, index), Triangle(a, c, d, index)]


@pytest.mark.parametrize("depth", [1, 2, 3, 4, 20])
@pytest.mark.parametrize("shape", ["box", "mesh", "sphere"])
def test_a_closed_furnace_is_uniform(depth, shape):  # a
    hollow = {"box": box_mesh(), "mesh": sphere_mesh(8), "sphere": unit_sphere()}[shape]
    warm = material(kd=0.5, emission=0.5, two_sided=True)
    furnace = scene([hollow], [warm], (), point_view((0.2, 0.1, 0.3), (0.9, -0.2, 0.1), 4))
    expected = 0.5 * (1 - 0.5**depth) / (1 - 0.5)
    assert np.abs(image(furnace, path_tracer(depth, "bsdf")) - expected).max() < 1e-12
    if depth == 3:  # sampling the lights alone has no bounded variance in a corner
        furnace = scene([hollow], [warm], (), point_view((0.2, 0.1, 0.3), (0.9, -0.2, 0.1), 32))
        assert abs(z_score(image(furnace, path_tracer(depth, "mis"), spp=32, seed=5), expected)) < 4.5


def test_roulette_leaves_the_furnace_as_bright_as_it_is():
    """Mean E / (1 - rho) for any survival, here min(beta, 0.95) = beta = 0.5^k."""
    furnace = scene(
        [box_mesh()], [material(kd=0.5, emission=0.5, two_sided=True)], (), point_view((0.2, 0.1, 0.3), (0.9, -0.2, 0.1), 64)
    )
    for rr_depth in (1, 2):
        seen = image(furnace, path_tracer(10_000, "bsdf", rr_depth), spp=32)
        assert abs(z_score(seen, 1.0)) < 4.5


@pytest.mark.parametrize("direct", STRATEGIES)
def test_a_uniform_sky_makes_a_convex_surface_as_bright_as_its_albedo(direct):  # c
    for shape in (unit_sphere(), box_mesh(), sphere_mesh(8)):
        seen = image(
            scene([shape], [material(kd=0.7)], [SKY], point_view((0.5, 3.0, 2.0), (0.0, 0.0, 0.0), 8)), path_tracer(2, direct)
        )
        assert np.abs(seen - 0.7).max() < 1e-12


@pytest.mark.parametrize("direct", STRATEGIES)
def test_a_sky_that_brightens_upwards_lights_a_floor_by_its_cosine_mean(direct):  # c
    """a + b cos(theta) gives rho (a + 2 b / 3); the image has the exact value at the centres of 512 rows."""
    cosine = np.cos(np.pi * (np.arange(512) + 0.5) / 512)
    rows = 0.5 + 1.5 * np.maximum(cosine, 0.0)
    sky = EnvironmentLight((1.0, 1.0, 1.0), np.repeat(rows, 3 * 8).reshape(512, 8, 3))
    seen = image(
        scene([FLOOR], [material(kd=0.8)], [sky], floor_view()), path_tracer(2, direct), spp=300 if direct == "light" else 50
    )  # half of the light's samples go below the horizon
    assert abs(z_score(seen, 0.8 * (0.5 + 2 * 1.5 / 3))) < 4.5


@pytest.mark.parametrize("reflections", [1, 2, 5, 12])
def test_a_point_light_at_the_centre_of_a_sphere(reflections):  # d
    light = PointLight((0.0, 0.0, 0.0), (float(np.pi),) * 3)
    room = scene([unit_sphere()], [material(kd=0.5)], [light], point_view((0.3, 0.0, 0.1), (0.5, 0.7, 0.2), 4))
    for direct in STRATEGIES:
        seen = image(room, path_tracer(reflections + 1, direct))
        assert np.abs(seen - (1 - 0.5**reflections)).max() < 1e-12


def test_a_point_light_off_the_centre_of_a_sphere():  # d
    light, eye, rho = np.array([0.0, 0.5, 0.0]), (0.3, 0.0, 0.1), 0.5
    room = scene(
        [unit_sphere()], [material(kd=rho)], [PointLight(tuple(light), (1.0, 1.0, 1.0))], point_view(eye, (0.3, 0.0, -1.0), 32)
    )
    point = np.array([0.3, 0.0, -np.sqrt(1 - 0.09)])
    to_light = light - point
    distance = np.linalg.norm(to_light)
    expected = rho / np.pi * ((to_light @ -point) / distance**3 + rho / (1 - rho))
    assert abs(z_score(image(room, path_tracer(60), spp=8), expected)) < 4.5


@pytest.mark.parametrize("direct", STRATEGIES)
@pytest.mark.parametrize(("x", "expected"), [(0.0, 0.7522746884541074), (0.5, 0.4352098756835515)])
def test_a_square_light_obeys_lambert(x, expected, direct):  # e
    """As two triangles in a mesh-like list, each a light; and below a corner (x = z = 0.5)."""
    light = quad([(-0.5, 1, -0.5), (0.5, 1, -0.5), (0.5, 1, 0.5), (-0.5, 1, 0.5)], 1)
    view = point_view((x + 0.3, 1.5, 4.0), (x, 0.0, x), 32)
    lit = scene([FLOOR, *light], [material(kd=1.0), material(emission=1.0)], (), view)
    spp = 64 if direct == "bsdf" else 16
    assert abs(z_score(image(lit, path_tracer(2, direct), spp=spp), expected / np.pi)) < 4.5


@pytest.mark.parametrize("direct", STRATEGIES)
def test_a_spherical_light_lights_what_faces_it_and_what_it_grazes(direct):  # f
    """Facing: pi s^2 with s = R/d. At 90 degrees half of the sphere is below the horizon."""
    materials = [material(kd=1.0), material(emission=1.0)]
    origin = (0.0, 0.0, 0.0)
    above = scene([FLOOR, Sphere((0.0, 2.0, 0.0), 1.0, 1)], materials, (), point_view((4.0, 1.0, 0.5), origin, 32))
    aside = scene([FLOOR, Sphere((2.0, 0.0, 0.0), 1.0, 1)], materials, (), point_view((-3.0, 2.0, 1.0), origin, 32))
    for lit, irradiance in ((above, np.pi / 4), (aside, 0.09058607370607963)):
        seen = image(lit, path_tracer(2, direct), spp=64)
        assert abs(z_score(seen, irradiance / np.pi)) < 4.5


@pytest.mark.parametrize("direct", STRATEGIES)
def test_a_spherical_light_lights_its_own_inside(direct):
    """A two-sided lamp around everything is a furnace of one segment more: kd E."""
    lamp = material(emission=1.0, two_sided=True)
    inner = Sphere((0.0, 0.0, 0.0), 0.2, 0)
    room = scene([inner, unit_sphere(1)], [material(kd=0.6), lamp], (), point_view((0.7, 0.3, 0.0), (0.0, 0.0, 0.0), 32))
    assert abs(z_score(image(room, path_tracer(2, direct), spp=64), 0.6, 4e-3)) < 4.5


@pytest.mark.parametrize("direct", STRATEGIES)
def test_a_black_sphere_shades_the_sky_from_the_floor(direct):  # g
    black = Sphere((0.0, 1.0, 0.0), 1.0, 1)
    view = point_view((4.0, 1.5, 0.5), (1.0, 0.0, 0.0), 32)
    shaded = scene([FLOOR, black], [material(kd=1.0), material()], [SKY], view)
    assert abs(z_score(image(shaded, path_tracer(2, direct), spp=64), 0.6464466094067263)) < 4.5


@pytest.mark.parametrize(
    "shader",
    [whitted(), path_tracer(2, "light"), path_tracer(2, "bsdf"), path_tracer(2, "mis"), {"name": "no_shadows", "ambient": 0.0}],
    ids=str,
)
def test_lights_without_size_light_a_floor_exactly(shader):  # i
    """All pixels are one point but for the width of the view: 1e-4 of it moves the radiance by less than 1e-4."""
    h, x, rho = 1.5, 0.7, 0.5
    view = point_view((x, 5.0, 0.0), (x, 0.0, 0.0), 1, up=(0.0, 0.0, 1.0))
    settings = {"sampler": "constant"}  # the middle of the pixel
    for lights, expected in (
        ([PointLight((0.0, h, 0.0), (2.0,) * 3)], rho / np.pi * 2 * h / (h * h + x * x) ** 1.5),
        ([PointLight((0.0, h, 0.0), (2.0,) * 3, falloff=False)], rho / np.pi * 2 * h / (h * h + x * x) ** 0.5),
        ([DirectionalLight((0.6, -0.8, 0.0), (3.0,) * 3)], rho / np.pi * 3 * 0.8),
        ([DirectionalLight((0.6, 0.8, 0.0), (3.0,) * 3)], 0.0),
    ):
        seen = image(scene([FLOOR], [material(kd=rho)], lights, view), shader, **settings)
        assert abs(seen[0, 0] - expected) <= 1e-12
    for blocker in (Sphere((0.35, 0.75, 0.0), 0.2, 1), box_mesh((0.25, 0.65, -0.1), (0.45, 0.85, 0.1))):
        blocked = scene([FLOOR, blocker], [material(kd=rho), material()], [PointLight((0.0, h, 0.0), (2.0,) * 3)], view)
        seen = image(blocked, shader, **settings)
        assert (seen[0, 0] > 0) == (shader["name"] == "no_shadows")


def test_two_infinite_planes_share_their_light():  # j
    """1e-9: rays that graze run 65,000 times the distance of the planes."""
    ceiling, floor = Plane((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), 0), Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1)
    materials = [material(kd=0.8, emission=1.0), material(kd=0.5)]
    for target, expected in (((0.0, 1.0, 0.5), 1 / 0.6), ((0.0, 0.0, 0.5), 0.5 / 0.6)):
        room = scene([ceiling, floor], materials, (), point_view((0.0, 0.5, 0.0), target, 8))
        for direct in STRATEGIES:  # planes are in no list: only scattered rays find them
            assert np.abs(image(room, path_tracer(100, direct)) - expected).max() < 1e-9


def test_whitted_and_no_shadows_add_the_ambient_term():
    for name in ("whitted", "no_shadows"):
        seen = image(scene([FLOOR], [material(kd=0.5)], [], floor_view(side=2)), {"name": name, "ambient": 0.3})
        assert np.abs(seen - 0.15).max() < 1e-15
        assert np.abs(image(scene([FLOOR], [material(kd=0.5)], [], floor_view(side=2)), name) - 0.05).max() < 1e-15


def test_depth_is_grey_by_distance_and_albedo_shows_the_first_colour():
    view = point_view((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 1)
    held = scene([unit_sphere()], [material(kt=0.3, emission=2.0)], [SKY], view)
    reach = 1.1 * np.sqrt(1 + 1 + 16)
    assert abs(image(held, "depth_map", sampler="constant")[0, 0] - (reach - 4) / reach) < 1e-12
    for point, expected in ((4.0, 0.0), (-3.0, (8.8 - 4) / 8.8), (5.0, 0.0)):
        seen = image(held, {"name": "depth_map", "max_point": [0, 0, point]}, sampler="constant")
        assert abs(seen[0, 0] - expected) < 1e-12
    assert abs(image(held, "albedo")[0, 0] - 0.3) == 0.0
    for shader in ("depth_map", "albedo"):
        assert not image(scene([], [material(kd=1)], [SKY]), shader).any()
    planes = scene([FLOOR], [material(kd=0.4)], [SKY], floor_view(side=2))
    assert not image(planes, "depth_map").any() and (image(planes, "albedo") == 0.4).all()
    cases = [({"ks": 0.2, "kt": 0.3}, 0.2), ({"kd": 0.1, "ks": 0.2}, 0.1), ({"emission": 5.0}, 5.0), ({}, 0.0)]
    for given, shown in cases:
        assert (image(scene([FLOOR], [material(**given)], [], floor_view(side=2)), "albedo") == shown).all()
