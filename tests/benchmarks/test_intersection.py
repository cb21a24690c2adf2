"""What a ray costs, and what a tree: every accelerator on a ball of 80 and one of 81,920 triangles, 20,000 rays a round."""

from functools import cache

import numpy as np
import pytest

from engines.interface import Settings
from engines.registry import engine
from engines.scene import scene_from

RAYS = 20_000
SUBDIVISIONS = {"80": 1, "81920": 6}
CASES = [
    ("numpy", "bvh", "80"),
    ("numba", "none", "80"),
    *(("numba", name, size) for name in ("grid", "bvh") for size in SUBDIVISIONS),
    *(("embree", "embree", size) for size in SUBDIVISIONS),
]
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@cache
def ball(size):
    return scene_from({
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40,
                   "resolution": [8, 8]},
        "materials": {"white": {"kd": 0.5}},
        "shapes": [{"procedural": {"name": "tessellated_sphere", "subdivisions": SUBDIVISIONS[size]}, "material": "white"}],
        "lights": [{"environment": {"radiance": 1}}],
    })  # fmt: skip


@cache
def prepared(name, accelerator, size):
    renderer = engine(name).prepare(ball(size), Settings(accelerator=accelerator))
    renderer.warm_up()
    for query in (renderer.trace, renderer.occluded):
        query(*rays())
    return renderer


@cache
def rays():
    """From a sphere about the ball to points about it: two thirds hit."""
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(RAYS, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    return origins, rng.uniform(-1, 1, (RAYS, 3)) - origins


@pytest.mark.parametrize(("name", "accelerator", "size"), CASES)
def test_closest(benchmark, name, accelerator, size):
    renderer = prepared(name, accelerator, size)
    hits = benchmark(renderer.trace, *rays())
    benchmark.extra_info["rays_per_second"] = RAYS / benchmark.stats.stats.median
    assert 0.4 < np.isfinite(hits.t).mean() < 0.9


@pytest.mark.parametrize(("name", "accelerator", "size"), CASES)
def test_occluded(benchmark, name, accelerator, size):
    renderer = prepared(name, accelerator, size)
    hidden = benchmark(renderer.occluded, *rays())
    benchmark.extra_info["rays_per_second"] = RAYS / benchmark.stats.stats.median
    assert 0.4 < hidden.mean() < 0.9


@pytest.mark.parametrize(("name", "accelerator", "size"), [case for case in CASES if case[1] != "none"])
def test_build(benchmark, name, accelerator, size):
    """`prepare` whole: the tree is most of it on large scenes, the world's arrays on small ones."""
    prepared(name, accelerator, size)
    chosen = engine(name)
    renderer = benchmark.pedantic(
        chosen.prepare, (ball(size), Settings(accelerator=accelerator)), rounds=7, warmup_rounds=1
    )
    benchmark.extra_info["build_seconds"] = renderer.counters()["build_seconds"]
