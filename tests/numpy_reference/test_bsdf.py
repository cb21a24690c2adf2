"""What holds for every BSDF: value, density and samples belong together, and no energy is made.

Each model is taken from `bsdf_points.MODELS`; a new one belongs there. Chi-square tests hold p > 1e-5, seeds are fixed.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from engines.numpy_reference.bsdf import BSDFS, Lobes
from engines.numpy_reference.materials import Materials
from engines.scene import Checkerboard, Conductor, Dielectric, Diffuse, Mixture, Plastic, Principled
from tests.numpy_reference.bsdf_points import (
    DELTAS,
    GOLD,
    JELLY,
    MODELS,
    PAINT,
    UP,
    density,
    evaluated,
    even_directions,
    index_ratio,
    of,
    points,
    polar,
    quadrature,
    sampled,
    side,
    transmits,
)
from tests.numpy_reference.small_scenes import unit_rows

VIEWS = [0.0, 40.0, 75.0]
TILTED = unit_rows(np.array([[0.2, -0.3, 1.0]])).T
"""A shading normal that is not the geometric one."""


def each_model(test):
    return pytest.mark.parametrize("model", MODELS)(test)


def test_every_model_of_the_registry_is_tested():
    tested = [*MODELS.values(), *DELTAS.values()]
    assert {Mixture if material.bsdf is None else type(material.bsdf) for material in tested} == set(BSDFS)


@each_model
def test_light_may_go_either_way(model):
    """f(wo, wi) = f(wi, wo), and where it is refracted f(wo, wi) eta^2 = f(wi, wo), seen from the other side."""
    chosen, frame = MODELS[model], side(model)
    wo, wi = even_directions(2000, 1), even_directions(2000, 2, sphere=transmits(model))
    below = wi[2] < 0.0
    forth = evaluated(chosen, wo, wi, **frame) * np.where(below, index_ratio(model) ** 2, 1.0)
    back = evaluated(chosen, wi, wo, normal=np.where(below, -UP, UP), front=below ^ frame["front"])
    assert np.allclose(forth, back, rtol=1e-9, atol=1e-300)
    seen = (forth > 0.0).all(axis=0)
    assert seen[~below].mean() > 0.9 and (not transmits(model) or seen[below].mean() > 0.1)


@pytest.mark.parametrize("tilt", [{}, {"normal": TILTED, "geometric": UP}], ids=["flat", "tilted"])
@each_model
def test_the_weight_of_a_sample_is_value_times_cosine_over_density(model, tilt):
    chosen, draws, frame = MODELS[model], np.random.default_rng(3).random((3, 4000)), {**side(model), **tilt}
    wo = even_directions(4000, 4)
    wo = wo[:, (frame.get("normal", UP) * wo).sum(axis=0) > 0.0]
    found = sampled(chosen, wo, draws[:, : wo.shape[1]], **frame)
    kept = np.isfinite(found.pdf) & (found.weight > 0.0).any(axis=0)
    assert kept.mean() > 0.2
    wo, wi, weight = wo[:, kept], found.wi[:, kept], found.weight[:, kept]
    pdf = density(chosen, wo, wi, **frame)
    assert np.allclose(found.pdf[kept], pdf, rtol=1e-9)
    cosine = np.abs((frame.get("normal", UP) * wi).sum(axis=0))
    expected = evaluated(chosen, wo, wi, **frame) * cosine / pdf
    assert np.allclose(weight, expected, rtol=1e-5)


@pytest.mark.parametrize("view", VIEWS)
@each_model
def test_samples_are_distributed_as_the_density_says(model, view):
    """Chi-square over cells of equal solid angle, 12 x 24 on each side that light comes from; samples that are none, or of
    delta lobes, make one cell more."""
    chosen, wo, n, rows, columns, frame = MODELS[model], polar(view, 30.0), 60_000, 12, 24, side(model)
    found = sampled(chosen, wo, np.random.default_rng(5).random((3, n)), **frame)
    good = np.isfinite(found.pdf) & (found.weight > 0.0).any(axis=0)
    sides = (0, 1) if transmits(model) else (0,)
    x, y, z = found.wi[:, good]
    turn = (np.arctan2(y, x) / (2.0 * np.pi)) % 1.0
    ring = np.minimum((np.abs(z) * rows).astype(int), rows - 1) + rows * (z < 0.0)
    cell = ring * columns + np.minimum((turn * columns).astype(int), columns - 1)
    seen = np.append(np.bincount(cell, minlength=rows * columns * len(sides)), n - good.sum())
    # the same cells, each integrated over 16 x 16 points, Gauss-Legendre along both axes
    node, weight = np.polynomial.legendre.leggauss(16)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    height = ((np.arange(rows)[:, None] + node).reshape(-1, 1) / rows) * np.ones(16 * columns)
    phi = 2.0 * np.pi * ((np.arange(columns)[:, None] + node).reshape(1, -1) / columns) * np.ones((16 * rows, 1))
    ring = np.sqrt(1.0 - height * height)
    shares = []
    for below in sides:
        wi = np.stack([ring * np.cos(phi), ring * np.sin(phi), -height if below else height]).reshape(3, -1)
        pdf = density(chosen, wo, wi, **frame).reshape(rows, 16, columns, 16)
        shares.append(np.einsum("iajb,a,b->ij", pdf, weight, weight).reshape(-1) * 2.0 * np.pi / (rows * columns))
    share = np.concatenate(shares)
    expected = n * np.append(share, 1.0 - share.sum())
    assert np.isclose(expected[-1], seen[-1], atol=6.0 * np.sqrt(expected[-1] + 1.0) + 1e-3 * n)
    some = expected > 10.0
    statistic = ((seen[some] - expected[some]) ** 2 / expected[some]).sum()
    assert stats.chi2.sf(statistic, some.sum()) > 1e-5
    assert seen[~some].sum() < expected[~some].sum() + 6.0 * np.sqrt(expected[~some].sum()) + 6.0


@pytest.mark.parametrize("view", [*VIEWS, 88.0])
@each_model
def test_no_more_light_leaves_than_arrives(model, view):
    """The albedo by quadrature is that of the samples, and at most 1 as power: radiance is denser by eta^2 behind the surface.
    Disney's base and sheen are added to the rest, and may exceed it."""
    chosen, wo, frame = MODELS[model], polar(view, 30.0), side(model)
    up, weights = quadrature(192, 160, around=30.0 + 180.0)
    albedo = (evaluated(chosen, wo, up, **frame) * up[2] * weights).sum(axis=1)
    power = albedo
    if transmits(model):
        below = (evaluated(chosen, wo, -up * [[-1], [-1], [1]], **frame) * up[2] * weights).sum(axis=1)
        albedo, power = albedo + below, albedo + below * index_ratio(model) ** 2
    assert isinstance(chosen.bsdf, Principled) or (power <= 1.0 + 1e-6).all()
    found = sampled(chosen, wo, np.random.default_rng(6).random((3, 30_000)), **frame)
    weight = np.where(np.isfinite(found.pdf), found.weight, 0.0)
    error = weight.std(axis=1) / np.sqrt(weight.shape[1])
    assert (np.abs(weight.mean(axis=1) - albedo) < 5.0 * error + 2e-4).all()


@each_model
def test_nothing_is_scattered_between_the_horizons_of_both_normals(model):
    """The shading normal leans by 20 degrees: some directions lie above it and below the geometric one, or the reverse. Only
    what transmits shows light from below both."""
    chosen, normal = MODELS[model], polar(20.0)
    wo, wi = polar(60.0, 90.0), even_directions(3000, 7, sphere=True)
    frame = {**side(model), "normal": normal, "geometric": UP}
    cosine = (normal * wi).sum(axis=0)
    above, below = (cosine > 0.0) & (wi[2] > 0.0), (cosine < 0.0) & (wi[2] < 0.0)
    assert 0.2 < above.mean() < 0.8 and 0.2 < below.mean() < 0.8
    for found in (evaluated(chosen, wo, wi, **frame).max(axis=0), density(chosen, wo, wi, **frame)):
        assert (found[above] > 0.0).mean() > 0.9 and not found[~above & ~below].any()
        assert found[below].any() == transmits(model)
    found = sampled(chosen, wo, np.random.default_rng(9).random((3, 4000)), **frame)
    kept = np.isfinite(found.pdf) & (found.weight > 0.0).any(axis=0)
    one, other = found.wi[2, kept], (normal * found.wi[:, kept]).sum(axis=0)
    assert ((one > 0.0) == (other > 0.0)).all() and (transmits(model) or (one > 0.0).all())


def test_one_lobe_may_be_asked_for_alone():
    """As if there were no other: no share of the others in weight or pdf, and nothing where the lobe is missing."""
    wo, draws = polar(50.0), np.random.default_rng(10).random((3, 500))
    at, both = points(np.repeat(wo, 500, axis=1)), Materials([MODELS["kd ks kt"]])
    weights = [both.sample(at, *draws, lobe).weight for lobe in (Lobes.SPECULAR_REFLECTION, Lobes.SPECULAR_TRANSMISSION)]
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


@pytest.mark.parametrize("front", [True, False], ids=["outside", "inside"])
@pytest.mark.parametrize("rough", [Dielectric(1.5, (1e-4, 1e-4)), Dielectric(1.5, (1e-4, 1e-4), distribution="beckmann")])
def test_glass_that_is_hardly_rough_is_smooth_glass(rough, front):
    """With the same draws: the same lobe, nearly the same direction and weight, total reflection included."""
    wo, draws = even_directions(2000, 14), np.random.default_rng(15).random((3, 2000))
    wo = wo[:, wo[2] > 0.1]
    smooth = sampled(of(Dielectric(1.5)), wo, draws[:, : wo.shape[1]], front=front)
    found = sampled(of(rough), wo, draws[:, : wo.shape[1]], front=front)
    same = np.abs(found.wi - smooth.wi).max(axis=0) < 0.02
    assert same.mean() > 0.99  # where uc is next to F the lobes may differ
    assert np.allclose(found.weight[:, same], smooth.weight[:, same], rtol=5e-3)
    assert np.isinf(smooth.pdf).all() and np.median(found.pdf[same]) > 1e4


def test_plastic_that_is_hardly_rough_is_smooth_plastic():
    """But for the share that is reflected inside, where the smooth one has a fit; and for linear interpolation."""
    wo, wi = polar(np.linspace(0.0, 70.0, 50), 0.0), polar(np.linspace(60.0, 5.0, 50), 90.0)
    for index in (1.3, 1.5, 1.9):
        smooth, rough = (evaluated(of(Plastic((0.5, 0.5, 0.5), index, alpha)), wo, wi) for alpha in (0.0, 1e-3))
        ratio = rough / smooth
        assert np.ptp(ratio) < 1e-3 and abs(ratio.mean() - 1.0) < 0.05


def test_principled_glass_and_metal_are_those_of_the_models_of_their_own():
    """spec_trans 1 in white: a dielectric; metallic 1 in white: a mirror of microfacets. Both with alpha = roughness^2."""
    wo, wi = even_directions(2000, 16), even_directions(2000, 17, sphere=True)
    white = (1.0, 1.0, 1.0)
    for front in (True, False):
        pair = (of(Principled(white, 0.5, eta=1.4, spec_trans=1.0)), of(Dielectric(1.4, (0.25, 0.25))))
        for ask in (evaluated, density):
            assert np.allclose(*(ask(one, wo, wi, front=front) for one in pair), rtol=1e-9)
    metal = of(Principled(white, 0.5, metallic=1.0)), of(Conductor((0.0,) * 3, white, (0.25, 0.25)))
    assert np.allclose(*(evaluated(one, wo, wi) for one in metal), rtol=1e-9)


def test_principled_surfaces_without_contrast_reflect_nothing_unless_they_transmit():
    """As Mitsuba has it: an index of 1 leaves the base alone, and is 1.001 where spec_trans is not 0."""
    wo, wi = even_directions(500, 28), even_directions(500, 29, sphere=True)
    assert not evaluated(of(Principled(eta=1.0, metallic=1.0)), wo, wi).any()
    one, other = (evaluated(of(replace(JELLY, eta=eta)), wo, wi) for eta in (1.0, 1.001))
    assert np.array_equal(one, other) and (one > 0.0).any()


def test_opaque_models_are_the_same_on_both_sides():
    wo, wi, draws = even_directions(500, 18), even_directions(500, 19), np.random.default_rng(20).random((3, 500))
    for model in ("worn", "varnish", "wax", "paint"):
        chosen = MODELS[model]
        assert np.array_equal(evaluated(chosen, wo, wi), evaluated(chosen, wo, wi, front=False))
        for mine, theirs in zip(sampled(chosen, wo, draws), sampled(chosen, wo, draws, front=False), strict=True):
            assert np.array_equal(mine, theirs)


@pytest.mark.parametrize("front", [True, False], ids=["outside", "inside"])
def test_glass_and_panes_divide_the_light_by_fresnels_equations(front):
    """R and T of glass are F and (1 - F)/eta^2; of a pane 2F/(1 + F) and the rest, straight on and from either side."""
    wo, draws = polar(30.0), np.random.default_rng(21).random((3, 4000))
    white = {"reflectance": (1.0, 1.0, 1.0), "transmittance": (1.0, 1.0, 1.0)}
    eta = 1.5 if front else 1.0 / 1.5
    c1, c2 = np.cos(np.radians(30.0)), np.sqrt(1.0 - 0.25 / eta**2)
    s, p = (c1 - eta * c2) / (c1 + eta * c2), (eta * c1 - c2) / (eta * c1 + c2)
    fresnel = (s * s + p * p) / 2.0
    found = sampled(of(Dielectric(1.5)), wo, draws, front=front)
    up = found.wi[2] > 0.0
    assert abs(up.mean() - fresnel) < 5.0 * np.sqrt(fresnel / 4000)
    assert np.allclose(found.weight, np.where(up, 1.0, 1.0 / eta**2), rtol=1e-12)
    assert np.allclose(found.wi[:, ~up], [[-wo[0, 0] / eta], [0.0], [-c2]], rtol=1e-12)
    pane = of(replace(DELTAS["pane"].bsdf, **white))
    once = (
        0.5 * (((c1 - 1.5 * k) / (c1 + 1.5 * k)) ** 2 + ((1.5 * c1 - k) / (1.5 * c1 + k)) ** 2)
        if (k := np.sqrt(1.0 - 0.25 / 1.5**2))
        else 0.0
    )
    found = sampled(pane, wo, draws, front=front)
    up = found.wi[2] > 0.0
    assert abs(up.mean() - 2.0 * once / (1.0 + once)) < 5.0 * np.sqrt(once / 2000)
    assert np.array_equal(found.wi[:, ~up], np.repeat(-wo, (~up).sum(), axis=1)) and (found.weight == 1.0).all()


@pytest.mark.parametrize("model", DELTAS)
def test_delta_lobes_have_no_value_and_can_be_asked_for_alone(model):
    """Alone they need no draw, and their weights sum up to the mean of what is sampled."""
    chosen, wo, draws = DELTAS[model], polar(50.0, 20.0), np.random.default_rng(22).random((3, 20_000))
    assert not evaluated(chosen, wo, even_directions(100, 23, sphere=True)).any()
    assert not density(chosen, wo, even_directions(100, 23, sphere=True)).any()
    found, at = sampled(chosen, wo, draws), points(wo)
    assert np.isinf(found.pdf).all()
    alone = [
        Materials([chosen]).sample(at, np.zeros(1), np.zeros(1), np.zeros(1), lobe).weight[:, 0]
        for lobe in (Lobes.SPECULAR_REFLECTION, Lobes.SPECULAR_TRANSMISSION)
    ]
    error = found.weight.std(axis=1) / np.sqrt(20_000)
    assert (np.abs(found.weight.mean(axis=1) - sum(alone)) < 5.0 * error + 1e-12).all()


def test_a_textured_leaf_is_at_each_point_the_leaf_with_the_values_there():
    """A checkerboard of two grey levels in the place of each parameter, at points of either square."""
    board = Checkerboard((0.3, 0.3, 0.3), (0.8, 0.8, 0.8))
    grey = [(level,) * 3 for level in (0.3, 0.8)]
    alphas = [(level, level) for level in (0.3, 0.8)]
    colours = {
        Diffuse: ("reflectance",),
        Conductor: ("reflectance",),
        Dielectric: ("reflectance", "transmittance"),
        Plastic: ("diffuse",),
        Mixture: ("kd",),
        Principled: ("base_color",),
    }
    numbers = {Principled: tuple(name for name in Principled.__slots__ if name not in ("base_color", "eta"))}
    made = {
        Conductor: Conductor(*GOLD, (0.2, 0.2)),
        Dielectric: Dielectric(1.5, (0.2, 0.2)),
        Principled: JELLY,
        Plastic: Plastic(alpha=0.2, reflectance=(0.0, 0.0, 0.0)),
    }
    n = 400
    wo, wi = even_directions(n, 24), even_directions(n, 25, sphere=True)
    uv = np.where(np.arange(n) % 2 == 0, [[0.25], [0.25]], [[0.75], [0.25]])
    cases = [(kind, name, board, grey) for kind, names in colours.items() for name in names]
    cases += [(kind, name, board, (0.3, 0.8)) for kind, names in numbers.items() for name in names]
    cases += [(kind, "alpha", (board, board), alphas) for kind in (Conductor, Dielectric)]
    for kind, name, textured, values in cases:
        leaf = made[kind] if kind in made else kind()
        found = [of(replace(leaf, **{name: value})) for value in (textured, *values)]
        for ask in (evaluated, density):
            mixed, one, two = (ask(chosen, wo, wi, uv=uv) for chosen in found)
            assert np.allclose(mixed, np.where(np.arange(n) % 2 == 0, one, two), rtol=1e-12), (kind, name)
        assert not np.allclose(one, two, rtol=1e-3) or ask is density


def test_principled_parameters_all_count():
    """Each of them changes the value somewhere."""
    wo, wi = even_directions(50, 26), even_directions(50, 27, sphere=True)
    paint = replace(PAINT, spec_trans=0.3)
    before = evaluated(of(paint), wo, wi)
    for name in Principled.__slots__:
        value = (0.1, 0.9, 0.4) if name == "base_color" else 1.3 if name == "eta" else 0.95
        after = evaluated(of(replace(paint, **{name: value})), wo, wi)
        assert np.abs(after / np.where(before > 0.0, before, 1.0) - (before > 0.0)).max() > 1e-3, name
