"""Paths per second of every engine, and what becomes of samples on their way to disk."""

from functools import cache

import numpy as np
import pytest

from engines.film import Film
from engines.interface import Settings
from engines.registry import engine
from engines.scene import load_scene
from harness.config import paths
from harness.metrics import Reference, measure

SCENE = "cornell_box"
SIZES = {"numpy": (24, 1), "numba": (64, 4), "embree": (64, 4)}
"""Pixels along a side, samples per pixel a round."""
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@cache
def scene():
    return load_scene(paths.find("scenes", SCENE))


@pytest.mark.parametrize(
    ("name", "precision"), [("numpy", "float64"), ("numba", "float64"), ("numba", "float32"), ("embree", "float32")]
)
def test_paths(benchmark, name, precision):
    side, spp = SIZES[name]
    settings = Settings(width=side, height=side, shader={"name": "path_tracer", "max_depth": 6}, precision=precision)
    renderer = engine(name).prepare(scene(), settings)
    renderer.warm_up()
    renderer.render(spp)
    film = benchmark(renderer.render, spp)
    benchmark.extra_info["paths_per_second"] = side * side * spp / benchmark.stats.stats.median
    assert np.isfinite(film.mean()).all()


@cache
def image():
    return np.random.default_rng(1).random((256, 256, 3))


def test_film_commit(benchmark):
    """A sample of every pixel enters a film of 256 x 256."""
    film = Film(256, 256)
    benchmark(film.add, image())


def test_film_to_exr(benchmark, tmp_path):
    film = Film(256, 256)
    for _ in range(2):
        film.add(image())
    benchmark(film.save, tmp_path / "a.exr")


def test_all_metrics(benchmark):
    """What the harness computes at a checkpoint, off the clock, at 256 x 256."""
    reference = Reference(image(), image(), image(), np.full_like(image(), 1e-6), 1024)
    benchmark(measure, image() * 1.01, reference, 0.01)
