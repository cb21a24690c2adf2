"""The Beckmann distribution by its definition, and how its visible normals are found."""

import numpy as np
import pytest

from engines.numpy_reference.bsdf import beckmann
from tests.numpy_reference.bsdf_points import even_directions, polar, quadrature

VIEWS = [polar(0.0), polar(50.0, 20.0), polar(85.0, 70.0)]


@pytest.mark.parametrize("alpha", [(0.3, 0.3), (0.5, 0.2), (1.0, 0.6)])
def test_facets_cover_the_surface_and_the_seen_ones_what_is_seen_of_it(alpha):
    """The definitions of D and of the exact G1 (Heitz 2014): projected areas of facets."""
    m, weights = quadrature(400, 400)
    pair = np.array(alpha)[:, None]
    area = beckmann.distribution(m, pair) * weights
    assert abs((area * m[2]).sum() - 1.0) < 1e-4
    for view in VIEWS:
        seen = (np.maximum((view * m).sum(axis=0), 0.0) * area).sum() * beckmann.exact_masking(view, pair)
        assert abs(seen[0] - view[2, 0]) < 1e-4


def test_rational_masking_is_the_exact_one_to_four_thousandths():
    v = polar(np.linspace(0.0, 89.9, 500))
    for alpha in (0.05, 0.4, 1.0):
        pair = np.full((2, 500), alpha)
        ratio = beckmann.masking(v, pair) / beckmann.exact_masking(v, pair)
        assert np.abs(ratio - 1.0).max() < 4e-3
        assert np.array_equal(beckmann.masking(v, pair), beckmann.masking(-v, pair))


def test_visible_slopes_invert_their_distribution_to_machine_precision():
    """From grazing views to normal ones, and at the ends of the draws."""
    theta = np.concatenate([[0.0, 1e-9, 1e-4], np.linspace(0.01, np.pi / 2 - 1e-9, 60)])
    draws = np.array([0.0, 2.0**-32, 2.0**-25, 1e-3, 0.3, 0.5, 0.9, 0.999, 1.0 - 2.0**-32])
    theta, u = (axis.reshape(-1) for axis in np.meshgrid(theta, draws))
    wo = np.stack([np.sin(theta), np.zeros(theta.size), np.cos(theta)])
    m = beckmann.sample_visible_normals(wo, np.ones((2, theta.size)), u, np.full(theta.size, 0.5))
    slope, c, s = -m[0] / m[2], wo[2], wo[0]
    with np.errstate(divide="ignore"):
        end = np.minimum(c / s, 10.0)
    assert (slope <= end + 1e-12).all()
    held = np.clip(u, 2.0**-25, 1.0 - 2.0**-25)
    share = beckmann._visible_below(slope, c, s) / beckmann._visible_below(end, c, s)
    assert np.abs(share / held - 1.0).max() < 1e-12
    assert np.abs(m[1]).max() < 1e-15


def test_each_visible_normal_is_found_whatever_others_are_sought_with_it():
    wo, draws = even_directions(300, 1), np.random.default_rng(2).random((2, 300))
    alpha = np.full((2, 300), 0.3)
    together = beckmann.sample_visible_normals(wo, alpha, *draws)
    for lane in range(0, 300, 37):
        one = [array[..., lane : lane + 1] for array in (wo, alpha, *draws)]
        assert np.array_equal(beckmann.sample_visible_normals(*one)[:, 0], together[:, lane])
