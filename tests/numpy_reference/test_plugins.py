"""Shaders, samplers and cameras that users bring."""

import numpy as np
import pytest

from engines.errors import Unsupported
from engines.interface import Settings
from engines.numpy_reference import Engine
from engines.numpy_reference.vectors import along, norm
from engines.scene import CustomCamera, CustomLight, EnvironmentLight, Orthographic, Plane, PointLight
from tests.numpy_reference.small_scenes import (
    AHEAD,
    image,
    material,
    path_tracer,
    point_view,
    renderer,
    scene,
    unit_sphere,
    z_score,
)

LIT = scene(
    [unit_sphere(), Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), 0)],
    [material(kd=0.5)],
    [PointLight((0.0, 4.0, 3.0), (9.0, 9.0, 9.0)), EnvironmentLight((0.3, 0.2, 0.1))],
)


class NoShadowsAgain:
    """`no_shadows` written with what a plugin is given."""

    name = "again"
    options = {"ambient": 0.1}  # noqa: RUF012

    @staticmethod
    def numpy(context, origins, directions, pixels, sample):
        seen = context.trace(origins, directions)
        glow = seen.emission + context.options["ambient"] * seen.kd
        light = np.where(seen.hit[:, None], glow, context.sky(directions))
        for j in range(context.light_count):
            u0, u1, uc = (context.draw(pixels, sample, 2 + 8 * j + k) for k in range(3))
            wi, _, arriving, _ = context.sample_light(j, seen.point, seen.normal, u0, u1, uc)
            cosine = (seen.normal * wi).sum(axis=1)
            lit = seen.hit & (cosine > 0) & ((seen.geometric * wi).sum(axis=1) > 0)
            light += np.where(lit[:, None], seen.kd / np.pi * arriving * cosine[:, None], 0.0)
        return light


class Shadow:
    """White where the first light is hidden."""

    name = "shadow"

    @staticmethod
    def numpy(context, origins, directions, pixels, sample):
        seen = context.trace(origins, directions)
        half = np.full(len(pixels), 0.5)
        wi, distance, _, pdf = context.sample_light(0, seen.outside, seen.normal, half, half, half)
        assert np.isinf(pdf).all()
        return (seen.hit & context.occluded(seen.outside, wi, distance))[:, None].astype(float)


def test_a_shader_plugin_can_do_what_ours_do():
    with np.errstate(divide="ignore", invalid="ignore"):
        mine = renderer(LIT, shader=NoShadowsAgain()).render(2).mean()
    assert np.allclose(mine, renderer(LIT, shader="no_shadows").render(2).mean(), rtol=1e-12, atol=1e-15)


def test_a_shader_plugin_can_ask_for_shadows():
    made = renderer(LIT, shader=Shadow(), width=64, height=64)
    share = made.render(1).mean().mean()
    assert 0.05 < share < 0.8 and set(np.unique(made.film.mean())) == {0.0, 1.0}
    assert made.settings.shader.describe() == {"name": "shadow"}
    assert made.counters()["rays"] == 2 * 64 * 64


def test_a_sampler_plugin_draws_for_every_dimension():
    class Middle:
        name = "middle"

        @staticmethod
        def numpy(pixel, sample, dimension, seed):
            assert pixel.dtype == np.uint32
            return np.full(pixel.size, 0.5)

    mine, ours = renderer(LIT, sampler=Middle()).render(2), renderer(LIT, sampler="constant").render(2)
    assert np.array_equal(mine.sums, ours.sums)


def test_a_camera_plugin_makes_the_rays():
    class Parallel:
        name = "parallel"

        @staticmethod
        def numpy(px, py, width, height, options):
            x, y = (2 * px / width - 1) * options["half"], (1 - 2 * py / height) * options["half"]
            directions = np.tile([0.0, 0.0, -7.0], (px.size, 1))
            return np.stack([x, y, np.full(px.size, 5.0)], -1), directions

    own = scene(LIT.shapes, LIT.materials, LIT.lights, CustomCamera(Parallel(), {"half": 1.5}, (8, 8)))
    ours = scene(LIT.shapes, LIT.materials, LIT.lights, Orthographic(AHEAD.eye, AHEAD.target, AHEAD.up, 3.0, (8, 8)))
    assert np.allclose(renderer(own).render(2).mean(), renderer(ours).render(2).mean(), rtol=1e-12)


class Bulb:
    """A point light, and a sphere of that intensity that is not seen: sampled by solid angle, with a finite pdf."""

    name = "bulb"
    options = {"position": (0.0, 4.0, 3.0), "color": (9.0, 9.0, 9.0), "radius": 0.0}  # noqa: RUF012

    @staticmethod
    def numpy(options, p, normal, u0, u1):
        to = np.reshape(options["position"], (3, 1)) - p
        distance = norm(to)
        wi, pdf = to / distance, np.ones(u0.size)
        radiance = np.reshape(options["color"], (3, 1)) / distance**2
        if options["radius"] > 0.0:
            cut = 1.0 - np.sqrt(1.0 - (options["radius"] / distance) ** 2)  # 1 - cos of the half angle
            z, phi = 1.0 - u0 * cut, 2.0 * np.pi * u1
            ring = np.sqrt(1.0 - z * z)
            wi, pdf = along(ring * np.cos(phi), ring * np.sin(phi), z, wi), 1.0 / (2.0 * np.pi * cut)
            radiance = np.reshape(options["color"], (3, 1)) / (np.pi * options["radius"] ** 2) / pdf
        return wi, distance, radiance, pdf


@pytest.mark.parametrize("shader", [path_tracer(), path_tracer(direct="bsdf"), path_tracer(direct="light"), "whitted"])
def test_a_light_plugin_that_is_a_point_light_gives_its_image(shader):
    """Also where light is sought by scattering alone: a light that no ray can meet is always sampled."""
    own, ours = CustomLight(Bulb()), PointLight((0.0, 4.0, 3.0), (9.0, 9.0, 9.0))
    images = [
        renderer(scene(LIT.shapes, LIT.materials, (light, *LIT.lights[1:])), shader=shader).render(2).mean()
        for light in (own, ours)
    ]
    assert np.allclose(*images, rtol=1e-12) and images[0].max() > 0.1


def test_a_light_plugin_may_have_a_density_of_its_own():
    """A sphere seen from its outside, of radiance I / (pi r^2), sheds the light of a point of intensity I on what faces it."""
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), 0)
    lights = [CustomLight(Bulb(), {"radius": radius, "position": (0.0, 2.0, 0.0)}) for radius in (0.0, 0.5)]
    point, sphere = (
        image(scene([floor], lights=[light], camera=point_view((0, 1, 0.5), (0, -1, 0), 16)), path_tracer(), spp=4)
        for light in lights
    )
    assert point[0, 0] == pytest.approx(0.5 / np.pi * 9.0 / 9.0, rel=1e-3)
    assert abs(z_score(sphere.reshape(-1), point.mean())) < 5


@pytest.mark.parametrize("kind", ["shader", "sampler", "accelerator", "camera"])
def test_what_has_no_numpy_function_is_declined_in_one_sentence(kind):
    class Bare:
        name = "bare"

    given, settings = LIT, Settings()
    if kind == "camera":
        given = scene(LIT.shapes, LIT.materials, LIT.lights, CustomCamera(Bare(), {}, (8, 8)))
    else:
        settings = Settings(**{kind: Bare()})
    sentence = Engine().why_not(given, settings)
    assert kind in sentence and "\n" not in sentence
    with pytest.raises(Unsupported, match=kind):
        Engine().prepare(given, settings)
    if kind == "camera":
        with pytest.raises(Unsupported, match="camera"):
            renderer(LIT).update(camera=given.camera)
