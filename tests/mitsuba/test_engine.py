"""The engine mitsuba as an engine: what it declines and in which words, its samplers, its seeds, and its imports."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

import engines
from engines import Settings, UnknownName
from engines.packages import install_extra
from engines.peers.mitsuba import Engine, library
from engines.peers.mitsuba.patterns import ROUNDED
from engines.peers.mitsuba.streams import seed_of
from tests.needs import needs
from tests.plain_scene import plain_scene

compiled = needs("mitsuba-llvm")


def test_nothing_of_mitsuba_is_imported_before_it_is_used():
    script = "import engines, sys; engines.engine('mitsuba').accelerators(); print({'mitsuba', 'drjit'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_what_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr(library.util, "find_spec", lambda name: None)
    reason = Engine().why_not(plain_scene(), Settings(sampler="random"))
    assert reason == f"Mitsuba 3 is not installed: {install_extra('mitsuba')}"


@compiled
@pytest.mark.parametrize(
    ("material", "words"),
    [
        ({"kt": 0.9, "ior": 1.9}, "Fresnel"),
        ({"kd": 0.2, "ks": 0.5, "fresnel": True, "ior": 1.5}, "Fresnel"),
        ({"kd": [0.9, 0, 0], "ks": [0, 0.9, 0]}, "more than 1"),
    ],
)
def test_materials_without_counterpart_are_declined(material, words):
    reason = Engine().why_not(plain_scene(**material), Settings(sampler="random"))
    assert reason is not None
    assert "'it'" in reason
    assert words in reason


@compiled
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"precision": "float64"}, "float32"),
        ({"sampler": "sobol"}, "sobol"),
        ({"shader": {"name": "path_tracer", "direct": "light"}}, "multiple importance"),
        ({"shader": {"name": "path_tracer", "light_sampler": "power"}}, "choose lights evenly"),
        ({"shader": {"name": "path_tracer", "light_candidates": 4}}, "resample no light samples"),
        ({"shader": {"name": "path_tracer", "guiding": "sd_tree"}}, "guide no paths"),
    ],
)
def test_settings_without_counterpart_are_declined(settings, words):
    assert words in str(Engine().why_not(plain_scene(), Settings(**{"sampler": "random", **settings})))


def test_unknown_samplers_are_refused_with_mitsubas_own_among_the_known():
    with pytest.raises(UnknownName, match="multijitter"):
        Engine().prepare(plain_scene(), Settings(sampler="multijiter"))


@compiled
def test_patterns_spread_their_samples():
    """A whole pattern of Mitsuba's stratified samplers has less variance than as many independent samples."""
    scene = engines.load_scene("two_spheres")

    def error(sampler):
        images = [
            Engine().prepare(scene, Settings(24, 16, shader="no_shadows", sampler=sampler, seed=seed)).render(16).mean()
            for seed in range(6)
        ]
        return np.var(images, axis=0).mean()

    independent = error("independent")
    for name, count in (("stratified", "strata"), ("multijitter", "sample_count"), ("ldsampler", "sample_count")):
        assert error({"name": name, count: 16}) < 0.7 * independent, name


@compiled
@pytest.mark.parametrize("lanes", [64, 1 << 22], ids=["bands", "whole"])
@pytest.mark.parametrize("sampler", ["random", "orthogonal", {"name": "multijitter", "sample_count": 4}])
def test_a_pattern_ends_and_another_begins_wherever_calls_are_split(sampler, lanes, monkeypatch):
    """Also where a launch takes some pixels only, or some samples."""
    films = []
    for split in ((25,), (1, 3, 21)):
        monkeypatch.setattr("engines.peers.mitsuba.wavefront.MOST_LANES", lanes)
        renderer = Engine().prepare(plain_scene(), Settings(6, 5, sampler=sampler, seed=3))
        for spp in split:
            renderer.render(spp)
        films.append(renderer.film)
    for name in ("sums", "squares", "even_sums", "counts"):
        assert np.array_equal(getattr(films[0], name), getattr(films[1], name)), name
    assert films[0].spp == 25


@compiled
@pytest.mark.parametrize("name", sorted(ROUNDED))
def test_a_whole_pattern_is_the_image_that_mitsuba_renders(name):
    """Of the same seed, in one call of exactly as many samples: what is timed is the peer's own work."""
    pattern = Engine().full_pattern({"name": name}, 10)
    settings = Settings(24, 16, sampler=dict(pattern.sampler), seed=3, threads=2)
    renderer = Engine().prepare(engines.load_scene("two_spheres"), settings)
    stage = renderer._stage
    integrator = stage.mi.load_dict({"type": "path", "max_depth": 16, "rr_depth": 5})
    seed = seed_of(3, 0)
    theirs = np.array(stage.mi.render(stage.loaded, integrator=integrator, spp=pattern.spp, seed=seed))
    assert np.allclose(renderer.render(pattern.spp).mean(), theirs, rtol=1e-4, atol=1e-5)


@compiled
@pytest.mark.parametrize("name", sorted(ROUNDED))
def test_full_patterns_are_as_large_as_mitsuba_makes_them(name):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    before = 0
    for spp in (*range(1, 70), 100, 122, 257, 1000, 1025, 4096):
        pattern = Engine().full_pattern({"name": name}, spp)
        option = pattern.sampler["strata" if name == "stratified" else "sample_count"]
        assert mi.load_dict({"type": name, "sample_count": option}).sample_count() == pattern.spp
        assert Engine().full_pattern(pattern.sampler, spp) == pattern
        assert pattern.spp >= max(spp, before)
        before = pattern.spp


def test_a_chosen_pattern_is_repeated_and_the_largest_too():
    def spp(sampler, wanted):
        return Engine().full_pattern(sampler, wanted).spp

    assert [spp({"name": "orthogonal", "sample_count": 20}, n) for n in (1, 25, 26)] == [25, 25, 50]
    assert spp({"name": "multijitter", "sample_count": None}, 5) == 6
    assert spp({"name": "stratified", "strata": 64}, 5) == 16
    assert spp({"name": "stratified"}, 4097) == 8192
    assert Engine().full_pattern({"name": "random"}, 5) is None


@compiled
def test_a_pattern_that_stop_ends_is_dropped_whole(monkeypatch):
    monkeypatch.setattr("engines.peers.mitsuba.wavefront.MOST_LANES", 64)
    renderer = Engine().prepare(plain_scene(), Settings(6, 5, sampler={"name": "multijitter", "sample_count": 16}))
    renderer.render(16)
    sums, passes = renderer.film.sums.copy(), renderer._passes
    launch = passes._launch

    def stopping(*given):
        renderer.stop()
        return launch(*given)

    monkeypatch.setattr(passes, "_launch", stopping)
    assert renderer.render(16).spp == 16
    assert np.array_equal(renderer.film.sums, sums)
    monkeypatch.undo()
    assert renderer.render(16).spp == 32


@compiled
def test_every_sample_of_every_pixel_has_a_stream_of_its_own():
    import drjit as dr

    from engines.peers.mitsuba.streams import stream_sampler

    mi, _ = library.activate(library.LLVM, 2)
    lane = dr.arange(mi.UInt32, 1 << 16)
    draws = np.array([stream_sampler(mi, dr, seed, lane & 255, lane >> 8).next_2d() for seed in (0, 1, 2**40)])
    draws = draws.reshape(6, 256, 256).astype(float)
    assert abs(draws.mean() - 0.5) < 5 / np.sqrt(12 * draws.size)
    flat = draws.reshape(6, -1)
    of_a_pixel = draws[0].T.ravel()
    beside = (flat[0, 1:], flat[0, :-1]), (of_a_pixel[1:], of_a_pixel[:-1])
    for one, other in (*pairwise(flat), *beside):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5 / 256


@compiled
@pytest.mark.parametrize("size", [(1, 1), (9, 7), (5, 8), (2, 65)])
def test_independent_samples_are_launched_in_strips_that_hold_every_pixel(size):
    passes = Engine().prepare(plain_scene(), Settings(*size, sampler="random"))._passes
    mi, dr = passes._stage.mi, passes._stage.dr
    x, y = (np.array(of, int) for of in passes._from_strips(dr.arange(mi.UInt32, size[0] * size[1])))
    assert sorted(y * size[0] + x) == list(range(size[0] * size[1]))
    assert np.array_equal(passes._in_strips(mi.UInt32(y * size[0] + x)), np.arange(len(x)))
    assert x[:16].max() <= 3  # a vector's lanes stay together


def test_every_seed_and_pass_has_a_seed_of_its_own():
    seeds = {seed_of(seed, part) for seed in (0, 1, 2, 2**32, 2**40 + 1) for part in range(200)}
    assert len(seeds) == 1000
