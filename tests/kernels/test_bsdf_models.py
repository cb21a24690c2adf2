"""The lane functions of every BSDF model, compiled over arrays: they say what the engine numpy says, whose code is another's,
and value, density and samples belong together. Chi-square tests hold p > 1e-5, seeds are fixed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from engines.kernels.flatten.materials import KINDS
from engines.numpy_reference.bsdf import Lobes
from engines.numpy_reference.materials import Materials
from engines.scene import Conductor, CustomBSDF, Dielectric, Material, Mixture, Plastic, Principled, Sheen
from tests.bsdf_parameter_sets import BY_MODEL
from tests.kernels.bsdf_lanes import Lanes
from tests.numpy_reference.bsdf_points import even_directions, points, polar, quadrature

GOLD = ((0.14304, 0.37531, 1.44205), (3.98300, 2.38556, 1.60336))
GLASS = Dielectric(1.5, (0.2, 0.4), (0.9, 0.8, 0.7), (0.5, 0.9, 0.8))
WAX = Plastic((0.3, 0.6, 0.9), 1.4, 0.4, True, (0.9, 0.8, 0.7))
PAINT = Principled(
    (0.7, 0.3, 0.2), 0.5, anisotropic=0.6, metallic=0.3, eta=1.6, spec_tint=0.4, sheen=0.5, sheen_tint=0.6, flatness=0.4
)


def beckmann(leaf):
    return replace(leaf, distribution="beckmann")


ROUGH = {
    "kd": Mixture((0.9, 0.5, 0.1)),
    "metal": Conductor(*GOLD, (0.35, 0.2)),
    "beckmann metal": Conductor(*GOLD, (0.35, 0.2), distribution="beckmann"),
    "glass": GLASS,
    "beckmann glass": beckmann(GLASS),
    "varnish": replace(WAX, alpha=0.0),
    "wax": WAX,
    "beckmann wax": beckmann(WAX),
    "paint": PAINT,
    "coated paint": replace(PAINT, clearcoat=0.8, clearcoat_gloss=0.2),
    "jelly": replace(PAINT, spec_trans=0.6),
    "velvet": Sheen((0.9, 0.5, 0.1)),
    "coated jelly": replace(PAINT, spec_trans=0.6, clearcoat=0.8),
}
"""A leaf of every variant of the code that has a value."""
EXACT = {"kd", "metal", "beckmann metal", "glass", "beckmann glass", "varnish", "wax", "beckmann wax", "velvet"}
"""Those that make no energy: Disney's may."""


def transmits(leaf):
    return isinstance(leaf, Dielectric) or (isinstance(leaf, Principled) and leaf.spec_trans != 0)


SIDES = [(name, front) for name, leaf in ROUGH.items() for front in (True, False) if front or transmits(leaf)]
each_side = pytest.mark.parametrize(("name", "front"), SIDES, ids=[f"{n}{'' if f else ' from inside'}" for n, f in SIDES])


def cosines(wi):
    return np.abs(wi[2])


@pytest.mark.parametrize("model", BY_MODEL)
def test_lanes_say_what_numpy_says(model):
    """Value, density and samples, from both sides, each lobe alone where there are delta lobes."""
    n, rng = 400, np.random.default_rng(1)
    wo, wi, draws = even_directions(n, 2), even_directions(n, 3, sphere=True), rng.random((3, n))
    for leaf in BY_MODEL[model]:
        for front in (True, False):
            lanes, numpy, at = Lanes(leaf, front), Materials([Material("m", bsdf=leaf)]), points(wo, front=front)
            found = numpy.sample(at, *draws)
            some = np.where((np.arange(n) % 2 == 0) & (found.weight > 0).any(axis=0), found.wi, wi)
            assert np.allclose(lanes.evaluate(wo, some), numpy.evaluate(at, some) * cosines(some), rtol=1e-8, atol=1e-12), leaf
            assert np.allclose(lanes.pdf(wo, some), numpy.pdf(at, some), rtol=1e-8, atol=1e-12), leaf
            for name, lobes in (
                ("all", Lobes.ALL),
                ("reflection", Lobes.SPECULAR_REFLECTION),
                ("transmission", Lobes.SPECULAR_TRANSMISSION),
            ):
                expected = numpy.sample(at, *draws, lobes)
                there = (expected.weight > 0).any(axis=0)
                got, weight, pdf, through = lanes.sample(wo, draws, name)
                assert np.allclose(weight, expected.weight, rtol=1e-8, atol=1e-12), (leaf, name)
                assert np.allclose(got[:, there], expected.wi[:, there], atol=1e-8), (leaf, name)
                assert np.allclose(pdf[there], expected.pdf[there], rtol=1e-7), (leaf, name)
                assert np.array_equal(through[there], got[2, there] < 0), (leaf, name)


def test_every_model_is_tested():
    assert {type(leaf) for leaves in BY_MODEL.values() for leaf in leaves} == set(KINDS) - {CustomBSDF}


@each_side
def test_the_weight_of_a_sample_is_value_over_density(name, front):
    lanes, wo = Lanes(ROUGH[name], front), even_directions(4000, 4)
    wi, weight, pdf, through = lanes.sample(wo, np.random.default_rng(5).random((3, 4000)))
    kept = np.isfinite(pdf) & (weight > 0).any(axis=0)
    assert kept.mean() > 0.2 and through[kept].any() == transmits(ROUGH[name])
    wo, wi, weight = wo[:, kept], wi[:, kept], weight[:, kept]
    assert np.allclose(pdf[kept], lanes.pdf(wo, wi), rtol=1e-10)
    assert np.allclose(weight, lanes.evaluate(wo, wi) / lanes.pdf(wo, wi), rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["beckmann glass", "wax"])
def test_in_float32_the_weight_of_a_sample_is_value_over_density_to_its_digits(name):
    """Away from grazing directions and from nearly straight refraction, where half vectors have few digits."""
    leaf, wo = ROUGH[name], even_directions(4000, 4)
    wo = wo[:, wo[2] > 0.1]
    draws = np.random.default_rng(5).random((3, wo.shape[1]))
    single, double = Lanes(leaf, real=np.float32), Lanes(leaf)
    wi, weight, pdf, _ = single.sample(wo, draws)
    clear = np.isfinite(pdf) & (weight > 0).any(axis=0) & (cosines(wi) > 0.1)
    assert clear.mean() > 0.4 and weight.dtype == np.float32
    wo, wi = wo.astype(np.float32)[:, clear], wi[:, clear]
    error = np.abs(weight[:, clear] / (single.evaluate(wo, wi) / single.pdf(wo, wi)) - 1)
    assert np.quantile(error, 0.99) < 1e-5 and error.max() < 1e-3
    error = np.abs(single.evaluate(wo, wi) / double.evaluate(wo, wi) - 1)
    assert np.quantile(error, 0.99) < 1e-4


@each_side
def test_light_may_go_either_way(name, front):
    """f(wo, wi) = f(wi, wo), and where it is refracted f(wo, wi) eta^2 = f(wi, wo), seen from the other side."""
    leaf = ROUGH[name]
    wo, wi = even_directions(3000, 6), even_directions(3000, 7)
    above = Lanes(leaf, front)
    forth, back = above.evaluate(wo, wi) / cosines(wi), above.evaluate(wi, wo) / cosines(wo)
    assert np.allclose(forth, back, rtol=1e-9) and (forth.max(axis=0) > 0).mean() > 0.8
    if transmits(leaf):
        # from below the surface stands on its head: half a turn about the tangent, along which anisotropy is the same
        index = leaf.ior if isinstance(leaf, Dielectric) else leaf.eta
        turn, below = np.array([[1.0], [-1.0], [-1.0]]), Lanes(leaf, not front)
        forth = above.evaluate(wo, -wi) / cosines(wi) * (index if front else 1 / index) ** 2
        back = below.evaluate(-wi * turn, wo * turn) / cosines(wo)
        assert np.allclose(forth, back, rtol=1e-9) and (forth.max(axis=0) > 0).mean() > 0.1


@each_side
def test_samples_are_distributed_as_the_density_says(name, front):
    """Chi-square over cells of equal solid angle, 10 x 20 a side; samples that are none, or delta, are one cell more."""
    leaf, n, rows, columns = ROUGH[name], 60_000, 10, 20
    lanes, wo = Lanes(leaf, front), polar(55.0, 30.0)
    wi, weight, pdf, _ = lanes.sample(wo, np.random.default_rng(8).random((3, n)))
    good = np.isfinite(pdf) & (weight > 0).any(axis=0)
    x, y, z = wi[:, good]
    ring = np.minimum((np.abs(z) * rows).astype(int), rows - 1) + rows * (z < 0)
    cell = ring * columns + ((np.arctan2(y, x) / (2 * np.pi)) % 1 * columns).astype(int) % columns
    seen = np.append(np.bincount(cell, minlength=2 * rows * columns), n - good.sum())
    node, share = np.polynomial.legendre.leggauss(16)
    node, share = (node + 1) / 2, share / 2
    height, turn = (((np.arange(k)[:, None] + node) / k).reshape(-1) for k in (rows, columns))
    height, turn = (a.reshape(-1) for a in np.meshgrid(height, turn, indexing="ij"))
    ring = np.sqrt(1 - height * height)
    expected = []
    for side in (1.0, -1.0):
        at = np.stack([ring * np.cos(2 * np.pi * turn), ring * np.sin(2 * np.pi * turn), side * height])
        density = lanes.pdf(wo, at).reshape(rows, 16, columns, 16)
        expected.append(np.einsum("iajb,a,b->ij", density, share, share).reshape(-1) * 2 * np.pi / (rows * columns))
    expected = n * np.concatenate(expected)
    expected = np.append(expected, n - expected.sum())
    some = expected > 10
    statistic = ((seen[some] - expected[some]) ** 2 / expected[some]).sum()
    assert some.sum() > 20 and stats.chi2.sf(statistic, some.sum()) > 1e-5
    assert seen[~some].sum() < max(expected[~some].sum(), 0) + 6 * np.sqrt(max(expected[~some].sum(), 0)) + 6


@pytest.mark.parametrize("view", [0.0, 60.0, 86.0])
@each_side
def test_no_more_light_leaves_than_arrives(name, front, view):
    """The albedo by quadrature is the mean weight of samples, and at most 1 as power."""
    leaf, wo = ROUGH[name], polar(view, 30.0)
    lanes, (up, weights) = Lanes(leaf, front), quadrature(192, 160, around=30.0 + 180.0)
    above = (lanes.evaluate(wo, up) * weights).sum(axis=1)
    below = (lanes.evaluate(wo, -up * [[-1], [-1], [1]]) * weights).sum(axis=1)
    index = getattr(leaf, "ior", None) or getattr(leaf, "eta", 1.0)
    ratio = (index if front else 1 / index) ** 2 if transmits(leaf) else 1.0
    if name in EXACT:
        assert (above + ratio * below <= 1 + 1e-6).all()
    _, weight, pdf, _ = lanes.sample(wo, np.random.default_rng(9).random((3, 40_000)))
    weight = np.where(np.isfinite(pdf), weight, 0.0)
    error = weight.std(axis=1) / np.sqrt(weight.shape[1])
    assert (np.abs(weight.mean(axis=1) - above - below) < 5 * error + 3e-4).all()
