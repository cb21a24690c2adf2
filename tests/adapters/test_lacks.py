"""What renderers lack in the same words, and how the lobes of a mixture are blended."""

import numpy as np
import pytest

from engines.peers.adapters.colors import largest, least, mirror_share, scaled
from engines.peers.adapters.lacks import mixture_lacks, out_of_range
from engines.scene import WHITE, Bump, Checkerboard, Diffuse, ImageTexture, Mixture


def image(*values):
    return ImageTexture(np.array(values, np.float32).reshape(1, -1, 1))


@pytest.mark.parametrize(
    ("mixture", "words"),
    [
        (Mixture(kd=(0.5, 0.2, 0.1), ks=(0.1, 0.2, 0.5)), None),
        (Mixture(ks=WHITE, kt=WHITE, ior=1.5, fresnel=True), None),
        (Mixture(kt=(0.5, 0.5, 0.5)), "refraction without Fresnel"),
        (Mixture(kd=(0.1, 0.1, 0.1), kt=(0.5, 0.5, 0.5), fresnel=True), "beside a diffuse lobe"),
        (Mixture(ks=WHITE, fresnel=True), "without refraction"),
        (Mixture(kd=(0.9, 0.0, 0.0), ks=(0.0, 0.9, 0.0)), "more than 1"),
    ],
)
def test_mixtures_without_a_counterpart_are_said(mixture, words):
    found = mixture_lacks(mixture)
    assert found is None if words is None else words in str(found)


def test_the_lobes_of_a_blend_have_no_component_above_1():
    mixture = Mixture(kd=(0.6, 0.2, 0.1), ks=(0.1, 0.2, 0.4))
    share = mirror_share(mixture)
    assert share == pytest.approx(0.4)
    np.testing.assert_allclose(np.add(np.multiply(1 - share, scaled(mixture.kd, 1 / (1 - share))), mixture.ks), (0.7, 0.4, 0.5))
    assert max(scaled(mixture.kd, 1 / (1 - share))) <= 1 and max(scaled(mixture.ks, 1 / share)) <= 1 + 1e-12
    assert mirror_share(Mixture()) == mirror_share(Mixture(kd=WHITE)) == 0 and mirror_share(Mixture(ks=WHITE)) == 1


@pytest.mark.parametrize(("texture", "leaves_it"), [(image(0, 1), False), (image(-0.1, 1), True), (image(0, 1.1), True)])
def test_textures_out_of_range_are_found_but_heights(texture, leaves_it):
    assert out_of_range(Diffuse(texture)) == leaves_it
    assert not out_of_range(Bump(texture, 1.0, Diffuse()))


def test_a_texture_that_is_not_a_number_is_out_of_range():
    assert out_of_range(Diffuse(image(0.5, np.nan)))


def test_extremes_are_those_of_all_components():
    assert (least(Checkerboard((0.1, 0.2, 0.3), (0.9, 0.05, 0.4))), largest(Checkerboard())) == (0.05, 0.4)
    assert (least(0.3), largest((0.1, 0.7, 0.2))) == (0.3, 0.7)
