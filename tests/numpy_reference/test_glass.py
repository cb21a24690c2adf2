"""Mirrors and glass: Fresnel's equations, Snell's law, and scenes whose images are known."""

import numpy as np
import pytest

from engines.numpy_reference.bsdf.fresnel import fresnel_dielectric
from engines.numpy_reference.bsdf.mixture import refracted
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.scene import EnvironmentLight, Mesh, Perspective, Plane, Sphere
from tests.numpy_reference.small_scenes import (
    AHEAD,
    GLASS,
    GLASS_REFLECTANCE,
    box_mesh,
    image,
    material,
    path_tracer,
    point_view,
    renderer,
    scene,
    sphere_mesh,
    unit_sphere,
    whitted,
)

SKY = EnvironmentLight((1.0, 1.0, 1.0))
LONG = path_tracer(max_depth=2000)


@pytest.mark.parametrize(("degrees", "expected"), [*GLASS_REFLECTANCE, (90, 1.0)])
def test_reflectance_from_outside(degrees, expected):
    reflectance, _ = fresnel_dielectric(np.array([np.cos(np.radians(degrees))]), np.array([1.5]))
    assert abs(reflectance[0] - expected) < 1e-14


@pytest.mark.parametrize(
    ("degrees", "expected", "tolerance"),
    [(41.8, 0.8907719215, 1e-10), (41.81031, 0.99746243474, 1e-7), (41.8104, 1, 0), (60, 1, 0), (90, 1, 0)],
)
def test_reflectance_from_inside(degrees, expected, tolerance):
    """Near the critical angle the reflectance follows the square root of the distance to it."""
    reflectance, c2 = fresnel_dielectric(np.array([np.cos(np.radians(degrees))]), np.array([1 / 1.5]))
    assert abs(reflectance[0] - expected) <= tolerance and not np.isnan(c2[0])


def floor_seen_along(direction):
    n = direction.shape[1]
    up, none = np.tile([[0.0], [0.0], [1.0]], n), np.zeros(n, np.int64)
    return SurfaceInteraction(np.zeros((3, n)), -direction, up, up, 0.0 * up, none == 0, none, none, np.zeros(n))


def test_the_refracted_ray_obeys_snell():
    """45 degrees go to 28.1255057020557, and everything stays unit and in the plane."""
    angle = np.radians([0.0, 45.0, 80.0])
    direction = np.stack([np.sin(angle), np.zeros(3), -np.cos(angle)])
    bent = refracted(floor_seen_along(direction), np.full(3, 1.5))
    out = np.degrees(np.arctan2(bent.wi[0], -bent.wi[2]))
    assert abs(out[1] - 28.1255057020557) < 1e-12
    assert np.allclose(np.linalg.norm(bent.wi, axis=0), 1.0, rtol=1e-15)
    assert np.allclose(np.sin(angle), 1.5 * bent.wi[0], rtol=1e-14) and not bent.wi[1].any()
    assert np.array_equal(bent.scale, np.full(3, 1 / 1.5**2)) and not bent.total.any()


def test_grazing_rays_are_finite_and_refracted_to_the_far_side():  # D6
    angle = np.radians(np.concatenate([np.linspace(89.9, 90, 200)[:-1], 90 - 10.0 ** -np.arange(3, 10)]))
    direction = np.stack([np.sin(angle), np.zeros(angle.size), -np.cos(angle)])
    bent = refracted(floor_seen_along(direction), np.full(angle.size, 1.5))
    assert np.isfinite(bent.wi).all() and (bent.wi[2] < 0).all()


def test_glass_of_index_one_changes_nothing():  # D1
    rng = np.random.default_rng(1)
    sky = EnvironmentLight((1.0, 0.8, 0.6), rng.random((8, 16, 3)))
    clear = material(ks=1, kt=1, ior=1.0, fresnel=True)
    with_it = scene([unit_sphere(), box_mesh((-2, -2, -4), (2, 2, -2))], [clear], [sky])
    for shader in (whitted(), path_tracer(8)):
        seen, expected = image(with_it, shader, seed=3), image(scene([], [clear], [sky]), shader, seed=3)
        assert np.abs(seen - expected).max() < 1e-9


def test_light_that_is_totally_reflected_for_ever_is_black_and_ends():  # D2
    inside = Perspective((0.9, 0.0, 0.0), (0.9, 1.0, 0.0), (0.0, 0.0, 1.0), 10.0, "y", (4, 4))
    caught = scene([unit_sphere()], [GLASS], [SKY], inside)
    assert not image(caught, LONG).any()
    assert not image(caught, whitted(max_depth=32)).any()


def test_radiance_inside_glass_is_greater_by_the_square_of_its_index():  # D3
    inside = Perspective((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 60.0, "y", (8, 8))
    assert np.abs(image(scene([unit_sphere()], [GLASS], [SKY], inside), LONG) - 2.25).max() < 1e-12


@pytest.mark.parametrize(
    "shapes",
    [[unit_sphere()], [box_mesh()], [sphere_mesh(8)], [Sphere((0.0, 0.0, 0.0), 1.5, 0), Sphere((0.3, 0.2, 0.0), 0.7, 0)]],
    ids=["sphere", "box", "mesh", "nested"],
)
def test_lossless_glass_of_any_shape_vanishes_in_a_uniform_sky(shapes):  # b, D4
    assert np.abs(image(scene(shapes, [GLASS], [SKY]), LONG, spp=4) - 1.0).max() < 1e-11


@pytest.mark.parametrize(("events", "expected"), [(0, 0.9616), (1, 0.998464), (2, 0.99993856)])
def test_whitted_sees_through_a_ball_what_its_depth_allows(events, expected):  # D9
    central = scene([unit_sphere()], [GLASS], [SKY], point_view((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)))
    assert abs(image(central, whitted(max_depth=3 + events))[0, 0] - expected) < 1e-7  # a pixel is not quite a point


@pytest.mark.parametrize(("degrees", "expected"), [(30, 0.729), (60, 0.387420489)])
@pytest.mark.parametrize("shader", ["whitted", "path_tracer"])
def test_a_corridor_of_mirrors_dims_with_each_bounce(degrees, expected, shader):  # k
    angle = np.radians(degrees)
    walls = [Plane((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0), Plane((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), 0)]
    end = Plane((0.0, 0.0, 10.0), (0.0, 0.0, -1.0), 1)
    view = point_view((0.0, 0.0, 0.0), (float(np.sin(angle)), 0.0, float(np.cos(angle))))
    corridor = scene([*walls, end], [material(ks=0.9), material(emission=1)], (), view)
    chosen = whitted(max_depth=32) if shader == "whitted" else path_tracer(32)
    assert abs(image(corridor, chosen)[0, 0] - expected) < 1e-12


def test_whitted_follows_mirror_and_refraction_of_one_hit():
    """A pane without Fresnel: half of the emitter behind, a quarter of the one in front, seen through no other."""
    pane = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0)
    behind, before = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), 1), Plane((0.0, 0.0, 9.0), (0.0, 0.0, -1.0), 2)
    materials = [material(ks=0.25, kt=0.5), material(emission=1), material(emission=3)]
    seen = image(scene([pane, behind, before], materials), whitted())
    assert np.abs(seen - (0.5 * 1 + 0.25 * 3)).max() < 1e-12
    noisy = image(scene([pane, behind, before], materials), path_tracer(4), spp=64)
    assert abs(noisy.mean() - 1.25) < 0.1


def test_total_reflection_without_fresnel_keeps_the_weight_and_takes_the_mirror_direction():
    """From inside glass at 60 degrees only the mirror remains, for ks and for kt: they show the same emitter."""
    glass = material(ks=0.25, kt=0.5, ior=1.5)
    surface = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0)
    emitter = Plane((0.0, 0.0, -7.0), (0.0, 0.0, 1.0), 1)
    view = point_view((0.0, 0.0, -1.0), (float(np.sqrt(3.0)), 0.0, 0.0))
    within = scene([surface, emitter], [glass, material(emission=1)], (), view)
    for shader in (whitted(), path_tracer(3)):
        assert np.abs(image(within, shader, spp=1) - 0.75).max() < 1e-12


def test_a_smooth_mesh_bends_its_mirror_but_never_through_the_surface():
    rounded = sphere_mesh(8, smooth=True)
    seen = image(scene([rounded], [material(ks=1)], [SKY], AHEAD), path_tracer(64))
    assert set(np.unique(np.round(seen, 12))) <= {0.0, 1.0}  # a path that ends on the wrong side is black
    assert (seen > 0).mean() > 0.9
    flat = Mesh(rounded.vertices, rounded.faces, rounded.materials)
    where = np.array([[0.1, 0.2, 5.0]]), np.array([[0.0, 0.0, -1.0]])
    smooth_context, flat_context = (renderer(scene([m], [material(ks=1)]))._context for m in (rounded, flat))
    normals = []
    for context in (smooth_context, flat_context):
        o, d = where[0].T.copy(), where[1].T.copy()
        surface = context.surface(o, d, context.closest(o, d))
        normals.append(surface.normal[:, 0])
        point = surface.point[:, 0]
    assert np.allclose(normals[0], point / np.linalg.norm(point), atol=0.02)
    assert not np.allclose(normals[1], normals[0], atol=0.02)
