"""Lookups of textures against values by hand: filters, wraps, transforms, gradients, and parameters that may be textures."""

import numpy as np
import pytest

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.textures import ColorParameter, NumberParameter, color, gradient, number
from engines.scene import Checkerboard, ImageTexture

ROW = np.array([[[1.0], [2.0], [4.0]]], np.float32)
"""One row of three texels, which lie at u = 1/6, 1/2 and 5/6."""
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


def row(u, **more):
    return number(ImageTexture(ROW, **more), np.array([np.ravel(u), np.full(np.size(u), 0.5)]))


def points(uv):
    uv = np.asarray(uv, np.float64)
    n = uv.shape[1]
    none, nowhere = np.zeros(n, np.int64), np.zeros((3, n))
    return SurfaceInteraction(nowhere, nowhere, nowhere, nowhere, nowhere, none == 0, none, none, np.zeros(n), uv)


def test_texels_are_met_at_their_centres_and_lines_run_between():
    assert np.allclose(row([1 / 6, 1 / 2, 5 / 6, 1 / 3, 2 / 3, 0.25]), [1, 2, 4, 1.5, 3, 1.25], rtol=1e-14)


@pytest.mark.parametrize(
    ("wrap", "expected"), [("repeat", [2.5, 4.0, 1.0, 2.5]), ("clamp", [1.0, 1.0, 4.0, 4.0]), ("mirror", [1.0, 1.0, 4.0, 4.0])]
)
def test_outside_of_the_image_a_line_goes_on_as_the_wrap_says(wrap, expected):
    """At the left edge, a texel to the left of it, a texel to the right of the right edge, and at that edge."""
    assert np.allclose(row([0.0, -1 / 6, 7 / 6, 1.0], wrap=wrap), expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [
        ("repeat", [1, 2, 4] * 4),
        ("clamp", [1, 1, 1, 1, 1, 1, 1, 2, 4, 4, 4, 4]),
        ("mirror", [1, 2, 4, 4, 2, 1, 1, 2, 4, 4, 2, 1]),
    ],
)
def test_nearest_texels_of_four_periods(wrap, expected):
    u = (np.arange(-6, 6) + 0.5) / 3.0
    assert np.array_equal(row(u, wrap=wrap, filter="nearest"), expected)
    assert np.allclose(row(u, wrap=wrap), expected, rtol=1e-14)  # bilinear, at the centres


def test_the_first_row_is_at_v_zero_and_both_directions_are_weighted():
    square = ImageTexture(np.array([[[0.0], [1.0]], [[2.0], [5.0]]], np.float32), wrap="clamp")
    uv = np.array([[0.25, 0.75, 0.25, 0.75, 0.5, 0.375], [0.25, 0.25, 0.75, 0.75, 0.5, 0.625]])
    assert np.allclose(number(square, uv), [0, 1, 2, 5, 2.0, 0.75 * (0.25 * 0 + 0.75 * 2) + 0.25 * (0.25 * 1 + 0.75 * 5)])


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("filter", ["bilinear", "nearest"])
def test_one_texel_is_everywhere(wrap, filter):
    texture = ImageTexture(np.full((1, 1, 3), [[[0.25, 0.5, 0.75]]], np.float32), filter, wrap)
    uv = np.random.default_rng(1).uniform(-1e6, 1e6, (2, 50))
    assert np.allclose(color(texture, uv).T, [0.25, 0.5, 0.75], rtol=1e-14)
    assert not np.any(gradient(texture, uv))


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("filter", ["bilinear", "nearest"])
def test_coordinates_that_are_not_finite_read_the_first_texel_and_huge_ones_some_texel(wrap, filter):
    texture = ImageTexture(np.arange(12, dtype=np.float32).reshape(3, 4, 1) + 5.0, filter, wrap)
    bad = np.array([[np.nan, np.inf, -np.inf, 0.5, 1e308], [0.5, 0.5, 0.5, np.nan, 0.5]])
    assert np.array_equal(number(texture, bad), np.full(5, 5.0))  # the last one overflows times the width
    huge = number(texture, np.array([[1e300, -1e300, 1e19], [-1e300, 1e300, 1e17]]))
    assert ((huge >= 5.0) & (huge <= 16.0)).all()


def test_to_uv_scales_turns_and_shifts():
    m = (0.0, 2.0, 0.25, -1.0, 0.0, 0.5)
    texture = np.random.default_rng(2).random((4, 5, 3)).astype(np.float32)
    uv = np.random.default_rng(3).random((2, 20))
    moved = np.stack([2.0 * uv[1] + 0.25, 0.5 - uv[0]])
    assert np.allclose(color(ImageTexture(texture, to_uv=m), uv), color(ImageTexture(texture), moved), rtol=1e-12)
    board = Checkerboard((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), m)
    assert np.array_equal(color(board, uv), color(Checkerboard(board.a, board.b), moved))


def test_a_checkerboard_has_squares_of_half_a_unit():
    board = Checkerboard((1.0, 0.5, 0.0), (0.0, 0.0, 1.0))
    uv = np.array([[0.2, 0.7, 0.7, 0.2, -0.3, 0.5, 1.0], [0.2, 0.2, 0.7, 0.7, 0.7, 0.5, 3.0]])
    first = np.array([True, False, True, False, True, True, True])
    assert np.array_equal(color(board, uv), np.where(first, *(np.reshape(c, (3, 1)) for c in (board.a, board.b))))
    assert np.allclose(number(board, uv), np.where(first, LUMINANCE @ board.a, LUMINANCE @ board.b), rtol=1e-15)


def test_rgb_gives_its_luminance_as_a_number_and_one_channel_gives_grey():
    pixels = np.random.default_rng(4).random((3, 3, 3)).astype(np.float32)
    uv = np.random.default_rng(5).random((2, 30))
    assert np.allclose(number(ImageTexture(pixels), uv), LUMINANCE @ color(ImageTexture(pixels), uv), rtol=1e-13)
    grey = ImageTexture(pixels[:, :, :1])
    assert np.array_equal(color(grey, uv), np.tile(number(grey, uv), (3, 1)))


@pytest.mark.parametrize("channels", [1, 3])
def test_the_gradient_is_that_of_the_patch(channels):
    """Against central differences, within patches; `to_uv` turns it."""
    pixels = np.random.default_rng(6).random((4, 5, channels)).astype(np.float32)
    texture = ImageTexture(pixels, to_uv=(1.5, 0.5, 0.1, -0.25, 2.0, 0.3))
    uv, h = np.random.default_rng(7).random((2, 400)), 1e-6
    du, dv = np.array([[h], [0.0]]), np.array([[0.0], [h]])
    expected = [(number(texture, uv + step) - number(texture, uv - step)) / (2.0 * h) for step in (du, dv)]
    error = np.abs(np.array(gradient(texture, uv)) - expected).max(axis=0)
    assert (error > 1e-6).mean() < 0.01  # a few differences reach over an edge of their patch
    assert not np.any(gradient(ImageTexture(pixels, "nearest"), uv))


def test_a_colour_parameter_mixes_constants_and_textures_and_holds_them_in_their_range():
    image = ImageTexture(np.array([[[-1.0, 0.5, 7.0]]], np.float32))
    parameter = ColorParameter([(0.1, 0.2, 0.3), image, Checkerboard((0.2, 0.4, 0.6), (0.4, 2.0, 0.1)), image], high=3.0)
    found = parameter(np.array([2, 0, 1, 3, 2]), points([[0.2, 0.2, 0.2, 9.0, 0.7], [0.2, 0.2, 0.2, 9.0, 0.2]]))
    expected = [(0.2, 0.4, 0.6), (0.1, 0.2, 0.3), (0.0, 0.5, 3.0), (0.0, 0.5, 3.0), (0.4, 2.0, 0.1)]
    assert np.allclose(found.T, expected, rtol=1e-15)
    assert parameter.textured.tolist() == [False, True, True, True]
    assert np.allclose(parameter.largest.T, [(0.1, 0.2, 0.3), (0, 0.5, 3), (0.4, 2, 0.6), (0, 0.5, 3)])
    assert np.allclose(parameter.mean.T, [(0.1, 0.2, 0.3), (0, 0.5, 3), (0.3, 1.2, 0.35), (0, 0.5, 3)])


def test_a_number_parameter_is_a_luminance_in_its_range():
    rgb = ImageTexture(np.array([[[0.0, 1.0, 0.0], [8.0, 8.0, 8.0]]], np.float32), filter="nearest")
    low = ImageTexture(np.zeros((1, 1, 1), np.float32))
    parameter = NumberParameter([0.5, rgb, low], low=1e-4, high=1.0)
    found = parameter(np.array([0, 1, 1, 2]), points([[0.0, 0.2, 0.8, 0.0], [0.5] * 4]))
    assert np.allclose(found, [0.5, 0.715160, 1.0, 1e-4], rtol=1e-15)
    assert np.allclose(parameter.largest, [0.5, 1.0, 1e-4]) and parameter.textured.tolist() == [False, True, True]


def test_no_value_passes_the_largest():
    rng = np.random.default_rng(8)
    textures = [ImageTexture(rng.random((3, 4, channels)).astype(np.float32)) for channels in (1, 3, 3)]
    textures.append(Checkerboard(tuple(rng.random(3)), tuple(rng.random(3))))
    member, at = rng.integers(0, 4, 2000), points(rng.random((2, 2000)))
    colours, numbers = ColorParameter(textures), NumberParameter(textures)
    assert (colours(member, at) <= colours.largest.take(member, axis=1) + 1e-12).all()
    assert (numbers(member, at) <= numbers.largest[member] + 1e-12).all()
