"""What holds for every BSDF: value, density and samples belong together, and no energy is made.

Each model is taken from `bsdf_points.MODELS`; a new one belongs there. Chi-square tests hold p > 1e-5, seeds are fixed.
"""

import numpy as np
import pytest
from scipy import stats

from engines.numpy_reference.bsdf import BSDFS, Lobes
from engines.numpy_reference.materials import Materials
from engines.scene import Mixture
from tests.numpy_reference.bsdf_points import (
    MODELS,
    UP,
    density,
    evaluated,
    even_directions,
    points,
    polar,
    quadrature,
    sampled,
)
from tests.numpy_reference.small_scenes import unit_rows

VIEWS = [0.0, 40.0, 75.0]
TILTED = unit_rows(np.array([[0.2, -0.3, 1.0]])).T
"""A shading normal that is not the geometric one."""


def each_model(test):
    return pytest.mark.parametrize("model", MODELS)(test)


def test_every_model_of_the_registry_is_tested():
    assert {Mixture if material.bsdf is None else type(material.bsdf) for material in MODELS.values()} == set(BSDFS)


@each_model
def test_light_may_go_either_way(model):
    """f(wo, wi) = f(wi, wo)."""
    wo, wi = even_directions(2000, 1), even_directions(2000, 2)
    assert np.allclose(evaluated(MODELS[model], wo, wi), evaluated(MODELS[model], wi, wo), rtol=1e-11)


@pytest.mark.parametrize("frame", [{}, {"normal": TILTED, "geometric": UP}], ids=["flat", "tilted"])
@each_model
def test_the_weight_of_a_sample_is_value_times_cosine_over_density(model, frame):
    chosen, draws = MODELS[model], np.random.default_rng(3).random((3, 4000))
    wo = even_directions(4000, 4)
    wo = wo[:, (frame.get("normal", UP) * wo).sum(axis=0) > 0.0]
    found = sampled(chosen, wo, draws[:, : wo.shape[1]], **frame)
    diffuse = np.isfinite(found.pdf) & (found.weight > 0.0).any(axis=0)
    assert diffuse.mean() > 0.2
    wo, wi, weight = wo[:, diffuse], found.wi[:, diffuse], found.weight[:, diffuse]
    pdf = density(chosen, wo, wi, **frame)
    assert np.allclose(found.pdf[diffuse], pdf, rtol=1e-9)
    cosine = (frame.get("normal", UP) * wi).sum(axis=0)
    expected = evaluated(chosen, wo, wi, **frame) * cosine / pdf
    assert np.allclose(weight, expected, rtol=1e-5)


@pytest.mark.parametrize("view", VIEWS)
@each_model
def test_samples_are_distributed_as_the_density_says(model, view):
    """Chi-square over 12 x 24 cells of equal solid angle; samples below the horizon and of delta lobes make one cell more."""
    chosen, wo, n, rows, columns = MODELS[model], polar(view, 30.0), 100_000, 12, 24
    found = sampled(chosen, wo, np.random.default_rng(5).random((3, n)))
    good = np.isfinite(found.pdf) & (found.weight > 0.0).any(axis=0)
    x, y, z = found.wi[:, good]
    turn = (np.arctan2(y, x) / (2.0 * np.pi)) % 1.0
    cell = np.minimum((z * rows).astype(int), rows - 1) * columns + np.minimum(
        (turn * columns).astype(int), columns - 1
    )
    seen = np.append(np.bincount(cell, minlength=rows * columns), n - good.sum())
    # the same cells, each integrated over 16 x 16 points, Gauss-Legendre along both axes
    node, weight = np.polynomial.legendre.leggauss(16)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    z = ((np.arange(rows)[:, None] + node).reshape(-1, 1) / rows) * np.ones(16 * columns)
    phi = 2.0 * np.pi * ((np.arange(columns)[:, None] + node).reshape(1, -1) / columns) * np.ones((16 * rows, 1))
    ring = np.sqrt(1.0 - z * z)
    wi = np.stack([ring * np.cos(phi), ring * np.sin(phi), z]).reshape(3, -1)
    pdf = density(chosen, wo, wi).reshape(rows, 16, columns, 16)
    share = np.einsum("iajb,a,b->ij", pdf, weight, weight).reshape(-1) * 2.0 * np.pi / (rows * columns)
    expected = n * np.append(share, 1.0 - share.sum())
    assert np.isclose(expected[-1], seen[-1], atol=6.0 * np.sqrt(expected[-1] + 1.0) + 1e-3 * n)
    some = expected > 10.0
    statistic = ((seen[some] - expected[some]) ** 2 / expected[some]).sum()
    assert stats.chi2.sf(statistic, some.sum()) > 1e-5
    assert seen[~some].sum() < expected[~some].sum() + 6.0 * np.sqrt(expected[~some].sum()) + 6.0


@pytest.mark.parametrize("view", [*VIEWS, 88.0])
@each_model
def test_no_more_light_leaves_than_arrives(model, view):
    """The albedo by quadrature is that of the samples, and at most 1."""
    chosen, wo = MODELS[model], polar(view, 30.0)
    wi, weights = quadrature(256, 200, around=30.0 + 180.0)
    albedo = (evaluated(chosen, wo, wi) * wi[2] * weights).sum(axis=1)
    assert (albedo <= 1.0 + 1e-9).all()
    found = sampled(chosen, wo, np.random.default_rng(6).random((3, 40_000)))
    weight = np.where(np.isfinite(found.pdf), found.weight, 0.0)
    error = weight.std(axis=1) / np.sqrt(weight.shape[1])
    assert (np.abs(weight.mean(axis=1) - albedo) < 5.0 * error + 1e-4).all()


@each_model
def test_nothing_is_reflected_below_the_surface_by_either_normal(model):
    """The shading normal leans by 20 degrees: some directions lie above it and below the geometric one, or the reverse."""
    chosen, normal = MODELS[model], polar(20.0)
    wo, wi = (
        polar(60.0, 90.0),
        even_directions(3000, 7) * np.where(np.random.default_rng(8).random(3000) < 0.5, -1.0, 1.0),
    )
    frame = {"normal": normal, "geometric": UP}
    above = ((normal * wi).sum(axis=0) > 0.0) & (wi[2] > 0.0)
    assert 0.2 < above.mean() < 0.8
    for found in (evaluated(chosen, wo, wi, **frame).max(axis=0), density(chosen, wo, wi, **frame)):
        assert (found[above] > 0.0).all() and not found[~above].any()
    found = sampled(chosen, wo, np.random.default_rng(9).random((3, 4000)), **frame)
    kept = np.isfinite(found.pdf) & (found.weight > 0.0).any(axis=0)
    assert ((found.wi[2, kept] > 0.0) & ((normal * found.wi[:, kept]).sum(axis=0) > 0.0)).all()


def test_one_lobe_may_be_asked_for_alone():
    """As if there were no other: no share of the others in weight or pdf, and nothing where the lobe is missing."""
    wo, draws = polar(50.0), np.random.default_rng(10).random((3, 500))
    at, both = points(np.repeat(wo, 500, axis=1)), Materials([MODELS["kd ks kt"]])
    weights = [
        both.sample(at, *draws, lobe).weight for lobe in (Lobes.SPECULAR_REFLECTION, Lobes.SPECULAR_TRANSMISSION)
    ]
    reflectance = weights[0][0, 0] / 0.4
    assert np.allclose(weights[0], 0.4 * reflectance, rtol=1e-12)
    assert np.allclose(weights[1], 0.3 * (1.0 - reflectance) / 1.5**2, rtol=1e-12)
    diffuse = both.sample(at, *draws, Lobes.DIFFUSE_REFLECTION)
    assert np.allclose(diffuse.weight, 0.3, rtol=1e-12) and np.allclose(diffuse.pdf, diffuse.wi[2] / np.pi, rtol=1e-12)
    for model, lobe in (
        ("kd", Lobes.SPECULAR_REFLECTION),
        ("rough", Lobes.SPECULAR_REFLECTION),
        ("rough", Lobes.DIFFUSE_REFLECTION),
    ):
        assert not Materials([MODELS[model]]).sample(at, *draws, lobe).weight.any()


def test_many_materials_answer_as_each_does_alone():
    """All models in one scene, their points in any order: the verbs find the material of each point."""
    names = [*MODELS, *MODELS]
    materials, n = [MODELS[name] for name in names], 600
    rng = np.random.default_rng(11)
    which, draws, wo, wi = (
        rng.integers(len(names), size=n),
        rng.random((3, n)),
        even_directions(n, 12),
        even_directions(n, 13),
    )
    table, at = Materials(materials), points(wo)._replace(material=which)
    value, pdf, found = table.evaluate(at, wi), table.pdf(at, wi), table.sample(at, *draws)
    for number, chosen in enumerate(materials):
        lanes = np.flatnonzero(which == number)
        alone, here = Materials([chosen]), points(wo[:, lanes])
        assert np.array_equal(value[:, lanes], alone.evaluate(here, wi[:, lanes]))
        assert np.array_equal(pdf[lanes], alone.pdf(here, wi[:, lanes]))
        for mine, theirs in zip(found, alone.sample(here, *draws[:, lanes]), strict=True):
            assert np.array_equal(mine[..., lanes], theirs)
