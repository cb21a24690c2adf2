"""What a ray costs, and what a tree: every accelerator on spheres of 80 to 327,680 triangles, and how a ray's cost grows."""

from functools import cache

import numpy as np
import pytest

from engines.interface import Settings
from engines.registry import engine
from engines.scene import scene_from

RAYS = 20_000
MANY = 500_000
SUBDIVISIONS = {"80": 1, "20480": 5, "81920": 6, "327680": 7, "1310720": 8}
CASES = [
    ("numpy", "bvh", "80"),
    ("numba", "none", "80"),
    ("numpy", "bvh", "20480"),
    *(("numba", name, size) for name in ("grid", "bvh") for size in ("80", "81920")),
    *(("embree", "embree", size) for size in ("80", "81920")),
]
LARGE = [(name, size) for name in ("numba", "embree") for size in ("20480", "327680", "1310720")]
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@cache
def sphere_mesh(size):
    return scene_from(
        {
            "raybench_scene": 1,
            "camera": {
                "type": "perspective",
                "eye": [0, 0, 4],
                "target": [0, 0, 0],
                "up": [0, 1, 0],
                "fov": 40,
                "resolution": [8, 8],
            },
            "materials": {"white": {"kd": 0.5}},
            "shapes": [{"procedural": {"name": "tessellated_sphere", "subdivisions": SUBDIVISIONS[size]}, "material": "white"}],
            "lights": [{"environment": {"radiance": 1}}],
        }
    )


@cache
def prepared(name, accelerator, size, precision=None, threads=None):
    renderer = engine(name).prepare(sphere_mesh(size), settings(name, accelerator, precision, threads))
    renderer.warm_up()
    for query in (renderer.trace, renderer.occluded):
        query(*rays())
    return renderer


def settings(name, accelerator, precision, threads):
    chosen = {"precision": precision if name == "numba" else None, "threads": threads}
    return Settings(accelerator=accelerator, **{key: value for key, value in chosen.items() if value})


@cache
def rays(n=RAYS):
    """From a sphere around the mesh to points near it: two thirds hit."""
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(n, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    return origins, rng.uniform(-1, 1, (n, 3)) - origins


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


@pytest.mark.parametrize(("name", "size"), LARGE)
def test_closest_of_many_incoherent_rays(benchmark, name, size):
    """float32 and two threads, in both engines; what 1,310,720 triangles take over 20,480 is how the cost grows."""
    renderer = prepared(name, "auto", size, "float32", 2)
    hits = benchmark.pedantic(renderer.trace, rays(MANY), rounds=5, warmup_rounds=1)
    benchmark.extra_info["rays_per_second"] = MANY / benchmark.stats.stats.median
    assert 0.4 < np.isfinite(hits.t).mean() < 0.9


@pytest.mark.parametrize("name", ["numba", "embree"])
@pytest.mark.parametrize("size", ["327680", "1310720"])
def test_build_of_a_large_tree(benchmark, name, size):
    """Two threads. The benchmark is `prepare`, with flattening the scene; `build_seconds` is there as extra information."""
    chosen, wanted = engine(name), settings(name, "auto", "float32", 2)
    renderer = benchmark.pedantic(chosen.prepare, (sphere_mesh(size), wanted), rounds=5, warmup_rounds=1)
    benchmark.extra_info["build_seconds"] = renderer.counters()["build_seconds"]
    benchmark.extra_info["accelerator_bytes"] = renderer.counters()["accelerator_bytes"]


@pytest.mark.parametrize(("name", "accelerator", "size"), [case for case in CASES if case[1] != "none"])
def test_build(benchmark, name, accelerator, size):
    """`prepare` whole: the tree is most of it on large scenes, flattening on small ones."""
    prepared(name, accelerator, size)
    chosen = engine(name)
    renderer = benchmark.pedantic(
        chosen.prepare, (sphere_mesh(size), Settings(accelerator=accelerator)), rounds=7, warmup_rounds=1
    )
    benchmark.extra_info["build_seconds"] = renderer.counters()["build_seconds"]
