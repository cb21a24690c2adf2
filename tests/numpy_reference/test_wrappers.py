"""Wrappers of BSDFs: which leaf a draw leads to, that the walk has no bias, masks against closed forms, tilted frames."""

import numpy as np
import pytest

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.vectors import dot, unit
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Dielectric,
    DirectionalLight,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mixture,
    NormalMap,
    Plane,
    PointLight,
    Sides,
    Sphere,
)
from tests.numpy_reference.bsdf_points import even_directions, points, polar
from tests.numpy_reference.small_scenes import image, material, path_tracer, point_view, renderer, scene, whitted, z_score

RED, GREEN, BLUE = (Mixture(kd=tuple(0.5 * (i == j) for j in range(3))) for i in range(3))
MIRROR = Conductor((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
SKY = EnvironmentLight((1.0, 1.0, 1.0))
LENS = point_view((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 32)
FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0)


def of(bsdf, **more):
    return Material("m", bsdf=bsdf, **more)


def seen(wo, uv=(0.25, 0.25), **more):
    """Points with (u, v) and the tangents x and y, seen from `wo` (3, n)."""
    n = wo.shape[1]
    x, y = (np.repeat(np.eye(3)[:, [axis]], n, axis=1) for axis in (0, 1))
    return points(wo, **more)._replace(uv=np.tile(np.reshape(uv, (2, -1)), n)[:, :n], dp_du=x, dp_dv=y)


def walked(bsdf, u, front=True):
    """The walk of draws `u`: colours of the leaves (3, n), and the state."""
    table, u = Materials([of(bsdf)]), np.atleast_1d(u).astype(np.float64)
    at = seen(np.repeat(polar(30.0), u.size, axis=1))._replace(front=np.full(u.size, front))
    at, rest = table.walk(at, u)
    return (
        np.pi
        * table.evaluate(
            at._replace(wrapped=at.wrapped._replace(opacity=np.ones(u.size))), polar(50.0, 40.0).repeat(u.size, axis=1)
        ),
        at.wrapped,
        rest,
    )


def test_a_blend_takes_b_below_its_weight_and_keeps_the_rest_of_the_draw():
    colour, _, rest = walked(Blend(0.25, RED, GREEN), [0.0, 0.2, 0.25, 0.7])
    assert np.allclose(colour.T, [GREEN.kd, GREEN.kd, RED.kd, RED.kd])
    assert np.allclose(rest, [0.0, 0.8, 0.0, 0.6], rtol=1e-14)


def test_a_mask_lets_pass_above_its_opacity_and_goes_on_to_its_leaf():
    nested = Mask(0.5, Blend(0.5, RED, Mask(0.25, GREEN)))
    colour, state, rest = walked(nested, [0.02, 0.2, 0.3, 0.6, 0.9])
    assert np.allclose(colour.T, [GREEN.kd, GREEN.kd, RED.kd, GREEN.kd, RED.kd])
    assert np.allclose(state.opacity, [0.125, 0.125, 0.5, 0.125, 0.5])
    assert state.passing.tolist() == [False, True, False, True, True]
    assert np.allclose(rest, [0.08 / 0.25, (0.8 - 0.25) / 0.75, 0.2, 0.4, 0.6], rtol=1e-12)


def test_sides_are_those_of_the_geometry_and_a_side_without_a_bsdf_is_black():
    for front, expected in ((True, RED.kd), (False, GREEN.kd)):
        assert np.allclose(walked(Sides(RED, GREEN), 0.4, front)[0][:, 0], expected)
    assert np.allclose(walked(Sides(RED, None), 0.4, False)[0], 0.0)
    table = Materials([of(Sides(None, Mask(1.0, RED)))])
    at, u = table.walk(seen(polar(30.0)), np.zeros(1))
    assert not table.sample(at, u, u, u).weight.any() and not table.albedo(at).any()


def test_a_share_may_be_a_texture_and_a_part_may_stand_in_several_places():
    board = Checkerboard((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    shared = Blend(board, RED, GREEN)
    table = Materials([of(Mask(board, BLUE)), of(Blend(0.5, shared, shared)), of(RED)])
    at = seen(np.repeat(polar(30.0), 3, axis=1), ([0.25, 0.75, 0.25], [0.25, 0.25, 0.25]))
    for which, colours, opacity in ((0, [BLUE, BLUE, BLUE], [1, 0, 1]), (1, [GREEN, RED, GREEN], [1, 1, 1])):
        there, _ = table.walk(at._replace(material=np.full(3, which)), np.full(3, 0.5))
        assert np.array_equal(there.wrapped.opacity, opacity)
        assert np.allclose(table.albedo(there).T, [leaf.kd for leaf in colours])
    there, _ = table.walk(at._replace(material=np.array([0, 1, 2])), np.full(3, 0.5))
    assert np.allclose(table.albedo(there).T, [BLUE.kd, RED.kd, RED.kd])


@pytest.mark.parametrize("front", [True, False])
def test_the_mean_over_draws_is_the_weighted_sum(front):
    """Value, density and weight of nested wrappers, over 100,000 even draws."""
    rough = Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), (0.3, 0.3))
    nested = Sides(Blend(0.3, Mask(0.8, rough), Mask(0.4, Blend(0.25, RED, GREEN))), Mask(0.7, Mask(0.9, BLUE)))
    shares = {"front": [(0.7 * 0.8, rough), (0.3 * 0.4 * 0.75, RED), (0.3 * 0.4 * 0.25, GREEN)], "back": [(0.63, BLUE)]}
    n = 100_000
    wo, wi, u = polar(30.0), polar(20.0, 160.0), (np.arange(n) + 0.5) / n
    table = Materials([of(nested)])
    at, rest = table.walk(seen(np.repeat(wo, n, axis=1))._replace(front=np.full(n, front)), u)
    found = table.sample(at, rest, np.full(n, 0.3), np.full(n, 0.6))
    value, passing = np.zeros(3), 1.0
    for share, leaf in shares["front" if front else "back"]:
        value += share * Materials([of(leaf)]).evaluate(points(wo), wi)[:, 0]
        passing -= share
    assert np.allclose(table.evaluate(at, np.repeat(wi, n, axis=1)).mean(axis=1), value, rtol=1e-4)
    straight = np.isinf(found.pdf)
    assert abs(straight.mean() - passing) < 1e-4
    assert np.array_equal(found.wi[:, straight], at.wo[:, straight] * -1.0) and (found.weight[:, straight] == 1.0).all()
    scattered = ~straight
    assert np.allclose(found.pdf[scattered], table.pdf(at, found.wi)[scattered], rtol=1e-12)
    cosine = np.abs(dot(at.normal, found.wi))
    estimate = np.where(scattered, found.weight * found.pdf, 0.0)
    assert np.allclose(estimate, np.where(scattered, table.evaluate(at, found.wi) * cosine, 0.0), rtol=1e-10, atol=1e-15)


def behind(opacity, leaf, emission=3.0):
    """A masked plane before one that emits."""
    wall = Plane((0.0, 0.0, -2.0), (0.0, 0.0, 1.0), 1)
    return scene([FLOOR, wall], [of(Mask(opacity, leaf)), material(emission=emission)], (), LENS)


@pytest.mark.parametrize("direct", ["mis", "light", "bsdf"])
def test_a_black_mask_before_a_light_shows_a_share_of_it(direct):
    found = image(behind(0.3, Mixture()), path_tracer(3, direct), spp=16)
    assert abs(z_score(found.ravel(), 0.7 * 3.0, 0.02)) < 4
    assert np.isin(np.round(image(behind(0.3, Mixture()), path_tracer(3, direct)), 9), [0.0, 3.0]).all()


@pytest.mark.parametrize("direct", ["mis", "light", "bsdf"])
def test_a_white_mask_under_an_even_sky_vanishes(direct):
    """A share o is scattered and the rest passes: both find a radiance of 1. Shadow rays know no masks."""
    masked = scene([FLOOR], [of(Mask(0.4, Mixture(kd=(1.0, 1.0, 1.0))))], [SKY], LENS)
    found = image(masked, path_tracer(3, direct), spp=16)
    assert abs(z_score(found.ravel(), 1.0, 0.02)) < 4 and (found.std() > 1e-3) == (direct != "bsdf")


def test_a_mask_hides_what_lies_behind_it_from_shadow_rays_and_never_scales_emission():
    light = DirectionalLight((0.0, 0.0, -1.0), (2.0, 2.0, 2.0))
    shade = Plane((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 1)
    view = point_view((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), 4)
    shaded = scene([FLOOR, shade], [material(kd=1.0), of(Mask(0.01, Mixture()))], [light], view)
    assert not image(shaded, path_tracer(4), spp=2).any()
    glowing = scene([FLOOR], [of(Mask(0.01, Mixture()), emission=(2.0, 2.0, 2.0))], (), LENS)
    assert np.array_equal(image(glowing, path_tracer(1)), np.full((32, 32), 2.0))


def test_whitted_sees_both_the_mirror_and_what_lies_behind_a_mask():
    """Without noise: o of the mirror's wall, 1 - o of the wall behind; the ambient term and the light times o."""
    above = Plane((0.0, 0.0, 9.0), (0.0, 0.0, -1.0), 2)
    walls = [FLOOR, Plane((0.0, 0.0, -2.0), (0.0, 0.0, 1.0), 1), above]
    glow = [material(emission=3.0), material(emission=5.0)]
    masked = scene(walls, [of(Mask(0.25, Mixture(ks=(0.8, 0.8, 0.8)))), *glow], (), LENS)
    assert np.allclose(image(masked, whitted()), 0.75 * 3.0 + 0.25 * 0.8 * 5.0, rtol=1e-12)
    grey = scene(walls[:2], [of(Mask(0.25, Mixture(kd=(0.8, 0.8, 0.8)))), glow[0]], (), LENS)
    light = DirectionalLight((0.0, 0.0, -1.0), (2.0, 2.0, 2.0))
    for lights, added in (((), 0.0), ((light,), 0.25 * 0.8 / np.pi * 2.0), ((light, light), 0.5 * 0.8 / np.pi * 2.0)):
        lit = scene(grey.shapes, grey.materials, lights, LENS)
        assert np.allclose(image(lit, whitted(ambient=0.5)), 0.75 * 3.0 + 0.25 * 0.8 * 0.5 + added, rtol=1e-12)
        assert np.allclose(image(lit, {"name": "no_shadows", "ambient": 0.5}), 0.25 * 0.8 * 0.5 + added, rtol=1e-12)


def test_whitted_and_the_path_tracer_agree_on_blends_of_textures():
    board = Checkerboard((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.3, 0.0, 0.05, 0.0, 0.4, 0.1))
    red, other = Mixture(kd=Checkerboard((0.9, 0.1, 0.2), (0.2, 0.3, 0.4), board.to_uv)), Mixture(kd=(0.3, 0.3, 0.3))
    light = DirectionalLight(tuple(unit(np.array([[0.3], [0.2], [-1.0]]))[:, 0]), (2.0, 2.0, 2.0))
    view = point_view((1.0, 1.0, 5.0), (0.4, 0.8, 0.0), 24)
    made = scene([FLOOR], [of(Blend(0.5, red, Blend(board, red, other)))], [light], view)
    one, other = (image(made, chosen, spp=12, seed=seed) for chosen, seed in ((whitted(), 1), (path_tracer(2), 2)))
    assert one.std() > 0.0 and abs(one.mean() - other.mean()) < 0.02 * one.mean()


def test_albedo_shows_the_leaf_of_the_draw():
    blended = scene([FLOOR], [of(Mask(0.1, Blend(0.25, RED, GREEN)))], (), LENS)
    shown = renderer(blended, shader="albedo").render(64).mean().mean(axis=(0, 1))
    assert np.allclose(shown, 0.75 * np.array(RED.kd) + 0.25 * np.array(GREEN.kd), atol=0.01)


def ramp(slope_u, slope_v, size=8):
    """Heights with these slopes by u and v between the centres of texels."""
    v, u = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    return ImageTexture(((slope_u * u + slope_v * v) / size).astype(np.float32)[:, :, None], wrap="clamp")


@pytest.mark.parametrize("front", [True, False])
def test_a_bump_map_has_the_normal_of_its_height_field(front):
    """z = scale h(u, v) has a normal along (-dz/dx, -dz/dy, 1); on a plane u and v are x and y. From behind the surface is as
    high, towards the viewer."""
    table = Materials([of(Bump(ramp(0.5, -0.25), 2.0, RED))])
    side = 1.0 if front else -1.0
    context = renderer(scene([FLOOR], [of(Bump(ramp(0.5, -0.25), 2.0, RED))]))._context
    origin, direction = np.array([[0.4], [0.6], [side]]), np.array([[0.1], [0.2], [-side]]) / np.sqrt(1.05)
    at = context.surface(origin, direction, context.closest(origin, direction))
    at, _ = table.walk(at, np.zeros(1))
    assert np.allclose(at.normal[:, 0], np.array([-1.0, 0.5, side]) / 1.5, atol=1e-6)
    assert np.allclose(at.wrapped.outermost[:, 0], [0.0, 0.0, side])


def test_bumps_add_up_where_they_are_nested():
    """Two height fields one on the other, both shallow: the slopes add."""
    nested = Bump(ramp(1e-3, 0.0), 1.0, Bump(ramp(0.0, 2e-3), 1.0, RED))
    at, _ = Materials([of(nested)]).walk(seen(polar(20.0), (0.5, 0.5)), np.zeros(1))
    assert np.allclose(at.normal[:, 0], [-1e-3, -2e-3, 1.0], atol=5e-6)
    assert np.allclose(at.wrapped.innermost[:, 0], [-1e-3, 0.0, 1.0], atol=5e-6)


@pytest.mark.parametrize(
    "bump",
    [
        Bump(ramp(0.0, 0.0), 1.0, RED),
        Bump(ramp(1.0, 1.0), 0.0, RED),
        NormalMap(Checkerboard((0.5, 0.5, 1.0), (0.5, 0.5, 0.5)), RED),
    ],
)
def test_a_flat_map_changes_nothing(bump):
    wo, wi, draws = polar(35.0, 10.0), even_directions(200, 3), np.random.default_rng(3).random((3, 200))
    for uv in ((0.25, 0.25), (0.75, 0.25)):  # of the checkerboard also the vector 0
        table, plain = Materials([of(bump)]), Materials([of(RED)])
        at, u = table.walk(seen(np.repeat(wo, 200, axis=1), uv), draws[0])
        assert np.array_equal(u, draws[0])
        assert np.array_equal(table.evaluate(at, wi), plain.evaluate(at._replace(wrapped=None), wi))
        for mine, expected in zip(table.sample(at, *draws), plain.sample(at._replace(wrapped=None), *draws), strict=True):
            assert np.array_equal(mine, expected)


def test_a_normal_that_the_viewer_cannot_see_is_turned_around_the_one_before():
    sixty = np.radians(60.0)
    leaning = tuple(0.5 + 0.5 * np.array([np.sin(sixty), 0.0, np.cos(sixty)]))
    table = Materials([of(NormalMap(Checkerboard(leaning, leaning), RED))])
    for azimuth, expected in ((0.0, np.sin(sixty)), (180.0, -np.sin(sixty))):
        at, _ = table.walk(seen(polar(60.0, azimuth)), np.zeros(1))
        assert np.allclose(at.normal[:, 0], [expected, 0.0, 0.5], atol=1e-12)


def test_directions_between_the_two_horizons_are_none_and_the_rest_is_dimmed_towards_the_old_one():
    leaning = tuple(0.5 + 0.5 * polar(30.0)[:, 0])
    table, angles = (
        Materials([of(NormalMap(Checkerboard(leaning, leaning), RED))]),
        np.array([-89.0, -61.0, -59.0, 0.0, 89.0]),
    )
    at, _ = table.walk(seen(np.repeat(polar(10.0), 5, axis=1)), np.zeros(5))
    wi = polar(angles)
    strength = np.tan(np.radians(30.0)) ** 2 / 8.0
    factor = 2.0 / (1.0 + np.sqrt(1.0 + strength * np.tan(np.radians(angles)) ** 2)) * (angles > -60.0)
    assert np.allclose(np.pi * table.evaluate(at, wi)[0], 0.5 * factor, rtol=1e-10)
    assert np.allclose(np.pi * table.pdf(at, wi), np.cos(np.radians(angles - 30.0)) * (angles > -60.0), rtol=1e-10)


def test_a_tilted_mirror_shows_another_wall_in_both_shaders():
    """Tilted by 30 degrees about y, a mirror that is seen along its normal shows what lies at 60 degrees."""
    leaning = tuple(0.5 + 0.5 * polar(30.0)[:, 0])
    wall = Plane((8.0, 0.0, 0.0), (-1.0, 0.0, 0.0), 1)
    ceiling = Plane((0.0, 0.0, 20.0), (0.0, 0.0, -1.0), 2)
    mirror = of(NormalMap(Checkerboard(leaning, leaning), MIRROR))
    made = scene([FLOOR, wall, ceiling], [mirror, material(emission=3.0), material(emission=7.0)], (), LENS)
    dimmed = 2.0 / (1.0 + np.sqrt(1.0 + np.tan(np.radians(30.0)) ** 2 / 8.0 * np.tan(np.radians(60.0)) ** 2))
    for shader in (whitted(), path_tracer(3)):
        assert np.allclose(image(made, shader), 3.0 * dimmed, rtol=1e-3)


STRATEGIES = {
    "rough glass": Dielectric(1.5, (0.4, 0.4)),
    "masked metal": Mask(0.6, Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), (0.4, 0.4))),
    "bumped metal": Bump(ramp(0.4, 0.3), 1.0, Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), (0.4, 0.4))),
    "bumped rough glass": Bump(ramp(0.4, 0.3), 1.0, Dielectric(1.5, (0.4, 0.4))),
    "blend": Blend(0.4, Mixture(kd=(0.6, 0.6, 0.6)), Mask(0.5, Dielectric(1.5, (0.5, 0.3)))),
}


@pytest.mark.parametrize("name", STRATEGIES)
def test_all_strategies_have_the_same_mean(name):
    """A surface with a lamp above and one below, which all three ways to weight samples must find alike."""
    lamps = [Sphere((0.5, 1.5, 1.6), 0.6, 1), Sphere((0.4, 1.0, -1.7), 0.8, 1)]
    view = point_view((0.4, -1.0, 1.5), (0.5, 0.5, 0.0), 32, (0.0, 0.0, 1.0))
    made = scene([FLOOR, *lamps], [of(STRATEGIES[name]), material(emission=3.0)], (), view)
    found = [image(made, path_tracer(2, direct), spp=32, seed=seed) for seed, direct in enumerate(("light", "bsdf", "mis"))]
    assert found[2].mean() > 0.02
    for one, other in ((0, 1), (0, 2), (1, 2)):
        error = np.hypot(found[one].std(), found[other].std()) / 32.0
        assert abs(found[one].mean() - found[other].mean()) < 4.5 * error, (one, other)
        assert error < 0.05 * found[2].mean()


@pytest.mark.parametrize("shader", [whitted(), path_tracer(2)], ids=["whitted", "path_tracer"])
def test_a_light_behind_a_rough_interface_is_found_from_there(shader):
    """A point light in the middle of a frosted ball: the shadow ray starts inside, or the ball would be in its way."""
    frosted = of(Dielectric(1.5, (0.3, 0.3)))
    ball = scene([Sphere((0.0, 0.0, 0.0), 1.0, 0)], [frosted], [PointLight((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))], LENS)
    value = Materials([frosted]).evaluate(points(polar(0.0)), polar(180.0))[0, 0]
    assert np.allclose(image(ball, shader), 2.0 * value, rtol=1e-4) and value > 0.1


def test_walks_are_asked_for_where_there_are_wrappers():
    with pytest.raises(AssertionError, match="walked first"):
        Materials([of(Mask(0.5, RED))]).evaluate(seen(polar(30.0)), polar(20.0))
    assert isinstance(seen(polar(30.0)), SurfaceInteraction)


def test_a_textured_sphere_is_lit_as_its_texture_says():
    """Hemispheres of two colours under an even sky, seen from the side."""
    board = Checkerboard((0.8, 0.8, 0.8), (0.2, 0.2, 0.2), (1.0, 0.0, 0.0, 0.0, 0.0, 0.75))
    ball = Sphere((0.0, 0.0, 0.0), 1.0, 0)
    for eye, expected in (((0.0, 5.0, 0.0), 0.2), ((0.0, -5.0, 0.0), 0.8)):
        view = point_view(eye, (0.0, 0.0, 0.0), 4, (0.0, 0.0, 1.0))
        made = scene([ball], [of(Mixture(kd=board))], [SKY], view)
        assert np.allclose(image(made, path_tracer(2, "light")), expected, rtol=1e-9)
