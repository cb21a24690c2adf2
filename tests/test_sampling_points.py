"""The samplers' own points: the same in every engine, in every elementary interval, as even and as fast as they should be.

Slopes are those of log RMSE over log n, by a jackknife over 256 pixels, which are scramblings independent of each other;
an interval that keeps more than 0.15 from the slope expected fails. Seeds are fixed.
"""

import math
from functools import cache

import numpy as np
import pytest
from scipy.stats import qmc

import engines
from engines import Settings
from engines.choices import SAMPLERS, resolve
from engines.numpy_reference.sampler import Sampler, sobol_point
from engines.plugin import ScatterResult, Shader, Vec3, const, inline, select3
from engines.scene import Material, Perspective, Scene, Sphere
from harness.verify.checks.sampling import slope_of

CHOICES = [
    "random",
    "sobol",
    {"name": "sobol", "scramble": "none"},
    "halton",
    {"name": "halton", "scramble": "none"},
    {"name": "stratified", "strata": 16},
    {"name": "constant", "value": 0.3},
]
GRIDS = [{"name": "stratified", "strata": n} for n in (16, 64, 256, 1024)]
PIXELS = 256


@inline
def _draws(si, light, bsdf, draws, path, options):
    """The last vertex shows its draws; before it the path goes to and fro in a sphere."""
    zero, one = const(0.0, si.t), const(1.0, si.t)
    none, last = Vec3(zero, zero, zero), path.depth >= options[0]
    shown = Vec3(draws.lobe, draws.u0, draws.u1)
    return ScatterResult(
        select3(last, shown, none),
        none,
        path.depth < options[0],
        si.normal,
        False,
        Vec3(one, one, one),
        zero,
        False,
        none,
        none,
    )


def _numpy(context, origins, directions, pixels, sample):
    base = 2 + 8 * (int(context.options["depth"]) - 1)
    return np.stack([context.draw(pixels, sample, base + k) for k in (3, 4, 5)], -1)


def _shown(engine, sampler, depth, precision, seed=2**40 + 3, spp=5):
    """(16, 16, 3) sums over samples of the draws of dimensions 2 + 8 (depth - 1) + 3, 4 and 5."""
    view = Perspective((0.1, 0.0, 0.0), (0.0, 0.2, 1.0), (0.0, 1.0, 0.0), 60.0, "y", (16, 16))
    scene = Scene("room", view, (Material("wall"),), (Sphere((0, 0, 0), 1.0, 0),), (), "")
    settings = Settings(
        shader=Shader("draws", _draws, _numpy, {"depth": float(depth)}), sampler=sampler, seed=seed, precision=precision
    )
    renderer = engines.engine(engine).prepare(scene, settings)
    return [np.array(renderer.render(1).sums) for _ in range(spp)]


@pytest.mark.parametrize("sampler", CHOICES, ids=str)
def test_engines_draw_the_same_numbers_bit_for_bit(sampler):
    """At the first vertex and at the ninth, where no quasi-random point is left; float32 keeps the upper 24 bits."""
    for depth in (1, 5, 9):
        reference = _shown("numpy", sampler, depth, "float64")
        assert all(np.array_equal(a, b) for a, b in zip(reference, _shown("numba", sampler, depth, "float64"), strict=True))
    if sampler == "sobol":  # float32 makes kernels of its own; one sampler tells
        first = np.floor(_shown("numpy", sampler, 1, "float64", spp=1)[0] * 2**24) / 2**24
        assert np.array_equal(_shown("numba", sampler, 1, "float32", spp=1)[0], first)


def points(choice, count, dimensions, pixels=PIXELS, seed=3):
    """(count, dimensions, pixels)"""
    return np.stack([_column(str(choice), count, d, pixels, seed) for d in dimensions], axis=1)


@cache
def _column(choice, count, dimension, pixels, seed):
    chosen = next(given for given in (*CHOICES, *GRIDS) if str(given) == choice)
    draw, which = Sampler(resolve("sampler", chosen, SAMPLERS), seed).draw, np.arange(pixels)
    return np.stack([draw(which, s, dimension) for s in range(count)])


UNSCRAMBLED = [{"name": name, "scramble": "none"} for name in ("sobol", "halton")]


@pytest.mark.parametrize("choice", UNSCRAMBLED, ids=str)
def test_every_elementary_interval_holds_its_share(choice):
    """Of base 2 in both dimensions for Sobol, of 2 and 3 for Halton; any block of that many points in turn."""
    bases = (2, 2) if choice["name"] == "sobol" else (2, 3)
    for a, b in ((0, 3), (1, 2), (2, 2), (3, 1), (5, 0), (0, 4)):
        rows, columns = bases[0] ** a, bases[1] ** b
        seen = points(choice, 3 * rows * columns, (0, 1), pixels=1)[:, :, 0] + 2.0**-32  # 1/3 is cut to 32 bits
        for block in np.split(seen, 3):
            cells = np.floor(block[:, 0] * rows) * columns + np.floor(block[:, 1] * columns)
            assert len(np.unique(cells)) == rows * columns


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        (UNSCRAMBLED[0], {64: 0.01286985, 256: 0.00330747, 1024: 0.00086793}),
        (UNSCRAMBLED[1], {64: 0.01640944, 256: 0.00530637, 1024: 0.00164550}),
    ],
    ids=["sobol", "halton"],
)
def test_points_are_as_even_as_published(choice, expected):
    """L2-star discrepancy in two dimensions, by scipy."""
    seen = points(choice, 1024, (0, 1), pixels=1)[:, :, 0]
    for count, discrepancy in expected.items():
        assert abs(qmc.discrepancy(seen[:count], method="L2-star") - discrepancy) < 1e-8


def additive(x):
    return (x**2).sum(axis=1), x.shape[1] / 3


def product(x):
    return np.prod(0.5 + x, axis=1), 1.0


def edge(x):
    return (x[:, 0] + 0.7 * x[:, 1] < 0.8).astype(float), 0.45


CASES = [
    ("random", (0, 1), product, -0.5),
    ("random", (0, 1, 2, 3, 4), product, -0.5),
    ("random", (0, 1), edge, -0.5),
    ("halton", (0, 1), product, -0.9),
    ("halton", (2, 3), product, -0.9),
    ("halton", (0, 1, 2, 3, 4), product, -0.9),
    ("sobol", (0, 1), additive, -1.6),
    ("sobol", (0, 1), product, -1.6),
    ("sobol", (2, 3), additive, -1.6),
    ("sobol", (0, 1, 2, 3, 4), product, -1.25),
    ("sobol", (0, 1), edge, -0.72),
    ("sobol", (2, 3), edge, -0.72),
]


@pytest.mark.parametrize(
    ("name", "dimensions", "integrand", "expected"), CASES, ids=lambda value: getattr(value, "__name__", str(value))
)
def test_errors_fall_as_fast_as_they_should(name, dimensions, integrand, expected):
    counts = [16, 64, 256, 1024]
    values, truth = integrand(points(name, counts[-1], dimensions))
    squares = np.stack([(values[:n].mean(axis=0) - truth) ** 2 for n in counts])
    slope, error = slope_of(counts, squares)
    assert max(abs(slope - expected) - 2.95 * error, 0.0) < 0.15, f"{slope:.3f} +- {2.95 * error:.3f}"


def test_jittered_errors_fall_as_one_over_n():
    counts = [grid["strata"] for grid in GRIDS]
    squares = []
    for grid, n in zip(GRIDS, counts, strict=True):
        values, truth = product(points(grid, n, (0, 1)))
        squares.append((values.mean(axis=0) - truth) ** 2)
    slope, error = slope_of(counts, np.stack(squares))
    assert max(abs(slope + 1.0) - 2.95 * error, 0.0) < 0.15


def nested_uniform(count, dimension, keys):
    """(count, keys) Sobol points scrambled as Owen (1995) defines it: a random bit for every node of the binary tree."""
    x = np.array([sobol_point(s, dimension) for s in range(count)], np.uint64)[:, None]
    result = np.zeros((count, len(keys)), np.uint64)
    for bit in range(32):
        node = _hash(_hash((x >> np.uint64(32 - bit)) + np.uint64(bit << 40)) ^ keys)
        result = (result << np.uint64(1)) | ((x >> np.uint64(31 - bit) ^ node) & np.uint64(1))
    return result * 2.0**-32


def _hash(x):
    """SplitMix64's finaliser."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@pytest.mark.parametrize("dimensions", [(0, 1), (2, 3)])
def test_hashed_scrambling_is_as_good_as_exact_nested_scrambling(dimensions):
    """RMSE over 256 scramblings: its ratio has a spread of 7 %, and 1.4 lies 5 of them away."""
    ours = points("sobol", 256, dimensions)
    rng = np.random.default_rng(5)
    exact = np.stack([nested_uniform(256, d, rng.integers(0, 2**63, PIXELS, np.uint64)) for d in dimensions], axis=1)
    for integrand in (additive, product, edge):
        for n in (16, 64, 256):
            rmse = [
                math.sqrt(np.mean((values[:n].mean(axis=0) - truth) ** 2))
                for values, truth in (integrand(ours), integrand(exact))
            ]
            assert 1 / 1.4 < rmse[0] / rmse[1] < 1.4, (integrand.__name__, n, rmse)
