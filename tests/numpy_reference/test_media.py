"""Phase functions and flights of the NumPy engine, by their definitions (docs/transport.md, "Media")."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.light_samplers.hierarchy import HierarchicalLightSampler
from engines.numpy_reference.lights.environment import ConstantEnvironment
from engines.numpy_reference.media import Media, MediumInteraction
from engines.numpy_reference.vectors import dot
from engines.scene import CustomBSDF, EnvironmentLight, HomogeneousMedium, Material, Perspective, Plane, PointLight, Scene
from engines.scene.light_hierarchy import light_hierarchy
from tests.numpy_reference.bsdf_points import LommelSeeliger
from tests.numpy_reference.small_scenes import AHEAD, henyey_greenstein

GS = (0.0, 1e-9, 0.3, -0.7, 0.95)
PEAKS = tuple(side * (1.0 - least) for side in (1.0, -1.0) for least in (1e-4, 1e-10, 2.0**-53))
"""Such that all light goes on in nearly one direction."""


def media(*rows):
    """Media of these (sigma_t, albedo, g)."""
    return Media([HomogeneousMedium("m", *row) for row in rows], (), Geometry(()))


def scattering(g, n=1, wo=(0.0, 0.0, -1.0)):
    """A medium of this g, and n points at which it scatters light that goes along -wo."""
    point = np.zeros((3, n))
    at = MediumInteraction(point, np.repeat(np.array(wo)[:, None], n, axis=1), np.zeros(n, np.int64), np.zeros(n))
    return media(((1.0,) * 3, (1.0,) * 3, g)), at


@pytest.mark.parametrize("g", GS)
def test_the_phase_function_is_a_density_whose_mean_cosine_is_g(g):
    nodes = (2.0 * np.arange(400_000) + 1.0) / 400_000 - 1.0
    medium, at = scattering(g, nodes.size)
    wi = np.stack([np.sqrt(1.0 - nodes**2), 0.0 * nodes, nodes])
    density = medium.pdf(at, wi) * 4.0 * math.pi / nodes.size
    assert density.sum() == pytest.approx(1.0, abs=1e-6)
    assert (density * nodes).sum() == pytest.approx(g, abs=1e-6)
    assert np.array_equal(medium.evaluate(at, wi), np.stack([medium.pdf(at, wi)] * 3))


@pytest.mark.parametrize("g", [0.3, -0.7, 0.95, *PEAKS])
def test_directions_are_those_of_henyey_and_greensteins_inversion_and_have_its_density(g):
    u = np.arange(1, 1024, 11) / 1024
    medium, at = scattering(g, u.size)
    wi, pdf = medium.sample(at, u, np.zeros(u.size))
    cosine, sine, density = henyey_greenstein(g, u)
    assert wi[2] == pytest.approx(cosine, abs=1e-12)
    assert wi[0] / sine == pytest.approx(1.0, rel=1e-12)
    assert pdf / density == pytest.approx(1.0, rel=1e-12)
    assert medium.pdf(at, wi) / density == pytest.approx(1.0, rel=1e-12 + 1e-15 / (1.0 - abs(g)))


@pytest.mark.parametrize("wo", [(0.0, 0.0, -1.0), (0.6, 0.0, 0.8), (0.48, -0.64, 0.6)])
def test_directions_are_scattered_about_the_one_that_light_goes(wo):
    rng, g, n = np.random.default_rng(4), 0.8, 20_000
    medium, at = scattering(g, n, wo)
    wi, pdf = medium.sample(at, rng.random(n), rng.random(n))
    assert np.sqrt(dot(wi, wi)) == pytest.approx(1.0, abs=1e-12)
    assert pdf == pytest.approx(medium.pdf(at, wi), rel=1e-9)
    assert wi.mean(axis=1) == pytest.approx(-g * np.array(wo), abs=0.02)


def fly(sigma_t, throughput, distance, n=20_000, seed=1):
    u = np.random.default_rng(seed).random(n)
    throughput = np.repeat(np.array(throughput, np.float64)[:, None], n, axis=1)
    flight, weight = media((sigma_t, (1.0,) * 3)).fly(np.zeros(n, np.int64), throughput, u, np.full(n, distance))
    return flight, throughput * weight, throughput


@pytest.mark.parametrize("sigma_t", [(1.0, 1.0, 1.0), (0.5, 2.0, 8.0), (0.0, 0.5, 1.0), (0.0, 0.0, 3.0)])
@pytest.mark.parametrize("throughput", [(1.0, 1.0, 1.0), (0.2, 0.5, 0.0), (0.0, 0.0, 0.7), (1e-9, 1.0, 1e-200)])
def test_what_reaches_a_surface_and_what_is_scattered_before_have_the_right_means(sigma_t, throughput):
    flight, after, before = fly(sigma_t, throughput, 0.8)
    arrived = flight >= 0.8
    truth = before[:, 0] * np.exp(-0.8 * np.array(sigma_t))
    for chosen, mean in ((arrived, truth), (~arrived, before[:, 0] - truth)):
        found = np.where(chosen, after, 0.0)
        error = found.std(axis=1) / math.sqrt(found.shape[1])
        assert (np.abs(found.mean(axis=1) - mean) <= 4.5 * error + 1e-12).all(), (found.mean(axis=1), mean)


def test_the_sum_of_channels_never_grows():
    for distance in (0.1, 1.0, 30.0, math.inf):
        _, after, before = fly((0.01, 2.0, 50.0), (0.3, 1.0, 2.0), distance)
        assert np.isfinite(after).all()
        assert (after.sum(axis=0) <= before.sum(axis=0) * (1.0 + 1e-12)).all()


def test_where_channels_are_equal_weights_are_1_to_the_last_bit():
    flight, after, before = fly((0.7,) * 3, (0.3, 1.0, 2.0), 1.0)
    assert np.array_equal(after, before)
    assert flight.mean() == pytest.approx(1.0 / 0.7, rel=0.03)


def test_bad_paths_fly_without_a_warning():
    with np.errstate(invalid="raise"):
        flight, after, _ = fly((1.0, 2.0, 3.0), (math.inf, 1.0, 1.0), 1.0, 10)
    assert np.isnan(flight).all() and np.isnan(after).any(axis=0).all()


def test_in_vacuum_rays_fly_for_ever():
    empty = media(((1.0,) * 3, (1.0,) * 3))
    vacuum, beta = np.full(3, -1), np.ones((3, 3))
    flight, weight = empty.fly(vacuum, beta, np.array([0.0, 0.5, 1.0 - 2.0**-53]), np.array([1.0, 2.0, np.inf]))
    assert np.isinf(flight).all()
    assert np.array_equal(weight, beta)
    assert np.array_equal(empty.transmittance(vacuum, np.array([1.0, 2.0, np.inf])), beta)


def test_infinite_ways_pass_channels_without_extinction_alone():
    passed = media(((0.0, 1e-9, 1.0), (1.0,) * 3)).transmittance(np.zeros(2, np.int64), np.array([np.inf, 0.0]))
    assert np.array_equal(passed, [[1.0, 1.0], [0.0, 1.0], [0.0, 1.0]])


def test_where_there_is_no_normal_a_constant_environment_is_sampled_uniformly():
    rng, sky = np.random.default_rng(2), ConstantEnvironment(EnvironmentLight((1.0,) * 3))
    normal = np.repeat([[0.0], [0.0], [0.0]], 10_000, axis=1)
    wi, pdf = sky.sample(normal, rng.random(10_000), rng.random(10_000))
    assert np.array_equal(pdf, np.full(10_000, 0.25 / math.pi))
    assert np.sqrt(dot(wi, wi)) == pytest.approx(1.0)
    assert wi.mean(axis=1) == pytest.approx(0.0, abs=0.03)
    assert np.square(wi).mean(axis=1) == pytest.approx(1 / 3, abs=0.02)


def test_vertices_without_a_normal_choose_lights_in_every_octant():
    places = list(itertools.product((-1.0, 1.0), repeat=3))
    lights = tuple(PointLight(place, (1.0,) * 3) for place in places)
    fog = HomogeneousMedium("fog", (1.0,) * 3, (1.0,) * 3)
    camera = replace(AHEAD, medium=0)
    sampler = HierarchicalLightSampler(light_hierarchy(Scene("fog", camera, (), (), lights, "", media=(fog,))))
    nowhere = np.zeros((3, 8))
    assert sampler.inverse_pmf(np.arange(8), nowhere, nowhere) == pytest.approx(8.0)


def foggy(floor, ceiling, sigma_t):
    """A film of two parallel planes of these materials, in fog that scatters light of every colour."""
    planes = [Plane((0.0, z, 0.0), (0.0, -z, 0.0), k, exterior=0) for k, z in enumerate((-1.0, 1.0))]
    camera = Perspective((0.0, 0.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0), 60.0, "y", (8, 8), medium=0)
    fog, lamp = HomogeneousMedium("fog", sigma_t, (1.0,) * 3), PointLight((0.0, 0.0, 0.0), (1.0,) * 3)
    made = Scene("fog", camera, (floor, ceiling), tuple(planes), (lamp,), "", media=(fog,))
    settings = Settings(shader={"name": "volumetric_path_tracer", "max_depth": 20, "rr_depth": 100}, sampler="random", seed=1)
    return engines.engine("numpy").prepare(made, settings).render(4)


def test_paths_that_have_lost_every_colour_end():
    """Red surfaces leave nothing of the light of green ones, and no flight can be drawn of it."""
    with np.errstate(invalid="raise"):
        film = foggy(Material("red", kd=(0.9, 0.0, 0.0)), Material("green", kd=(0.0, 0.9, 0.0)), (0.0, 0.1, 0.2))
    assert film.bad_samples == 0
    assert film.mean().max() > 0.0


def test_samples_with_a_bad_weight_in_media_are_counted():
    class Broken(LommelSeeliger):
        def sample(self, options, at, uc, u0, u1, lobes):
            wi, weight, pdf = super().sample(options, at, uc, u0, u1, lobes)
            return wi, np.full_like(weight, np.nan), pdf

    broken = Material("broken", bsdf=CustomBSDF(Broken(), {"albedo": (0.9, 0.6, 0.3)}))
    assert foggy(broken, broken, (0.1, 0.2, 0.3)).bad_samples > 0
