"""The film against statistics computed from the samples themselves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines.errors import ConfigError
from engines.film import Film, to_bitmap


def filled(samples):
    """A film with `samples` (spp, height, width, 3)."""
    film = Film(samples.shape[2], samples.shape[1])
    for layer in samples:
        film.add(layer)
    return film


def noise(spp, height=3, width=4, seed=1):
    return np.random.default_rng(seed).exponential(size=(spp, height, width, 3))


@given(spp=st.integers(1, 9), seed=st.integers(0, 1000))
def test_mean_and_halves_are_means_of_the_samples(spp, seed):
    samples = noise(spp, seed=seed)
    film = filled(samples)
    assert film.spp == spp
    np.testing.assert_allclose(film.mean(), samples.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(film.half(0), samples[::2].mean(axis=0), rtol=1e-12)
    if spp > 1:
        np.testing.assert_allclose(film.half(1), samples[1::2].mean(axis=0), rtol=1e-11)


@given(spp=st.integers(2, 9), seed=st.integers(0, 1000))
def test_variance_of_mean_is_the_sample_variance_over_the_count(spp, seed):
    samples = noise(spp, seed=seed)
    np.testing.assert_allclose(filled(samples).variance_of_mean(), samples.var(axis=0, ddof=1) / spp, rtol=1e-9, atol=1e-15)


def test_variance_is_unknown_below_two_samples():
    assert np.isnan(filled(noise(1)).variance_of_mean()).all()
    assert np.isnan(Film(2, 2).variance_of_mean()).all()


def test_variance_of_equal_samples_is_not_negative():
    assert (filled(np.full((7, 2, 2, 3), 0.1)).variance_of_mean() >= 0.0).all()


def test_an_empty_film_is_black_and_has_no_samples():
    film = Film(5, 2)
    assert film.mean().shape == (2, 5, 3)
    assert not film.mean().any()
    assert not film.half(0).any()
    assert film.spp == 0


def test_samples_for_some_pixels_leave_the_others_alone():
    film = Film(4, 3)
    film.add(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([1 * 4 + 2, 2 * 4 + 0]))
    assert film.mean()[1, 2].tolist() == [1.0, 2.0, 3.0]
    assert film.mean()[2, 0].tolist() == [4.0, 5.0, 6.0]
    assert film.counts.sum() == 2
    assert film.sums.sum() == 21.0
    assert film.spp == 0


def test_each_pixel_alternates_its_halves_by_its_own_count():
    film = Film(2, 1)
    film.add(np.full((1, 3), 1.0), np.array([0]))
    film.add(np.array([[2.0] * 3, [4.0] * 3]))
    assert film.half(0)[0, :, 0].tolist() == [1.0, 4.0]
    assert film.half(1)[0, :, 0].tolist() == [2.0, 0.0]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_bad_sample_counts_as_black_and_is_reported(bad):
    samples = np.ones((2, 1, 2, 3))
    samples[1, 0, 1, 2] = bad
    film = filled(samples)
    assert film.bad_samples == 1
    assert film.mean()[0].tolist() == [[1.0] * 3, [0.5] * 3]
    assert np.isfinite(film.variance_of_mean()).all()


def test_clear_forgets_everything_and_keeps_the_arrays():
    film = filled(np.full((2, 2, 2, 3), np.nan))
    sums = film.sums
    film.clear()
    assert film.sums is sums
    assert (film.spp, film.bad_samples) == (0, 0)
    film.add(np.full((2, 2, 3), 3.0))
    np.testing.assert_array_equal(film.mean(), 3.0)
    np.testing.assert_array_equal(film.half(0), 3.0)


def test_there_are_two_halves():
    with pytest.raises(ValueError, match="0 or 1"):
        Film(1, 1).half(2)


def test_numpy_sees_the_mean():
    film = filled(noise(3))
    np.testing.assert_array_equal(np.asarray(film), film.mean())
    assert np.asarray(film, np.float32).dtype == np.float32
    with pytest.raises(ValueError, match="without a copy"):
        np.asarray(film, copy=False)


def test_a_bitmap_takes_a_name_or_a_callable():
    film = filled(np.full((1, 2, 3, 3), 0.5))
    bitmap = film.to_bitmap("linear")
    assert (bitmap.shape, bitmap.dtype) == ((2, 3, 3), np.uint8)
    assert (bitmap == 128).all()  # 127.5 rounds to even
    assert (film.to_bitmap() == 188).all()
    assert (film.to_bitmap(lambda radiance: radiance / 5) == 26).all()


def test_a_bitmap_of_bad_values_is_black_or_white_but_never_wraps():
    image = np.array([[[np.nan, np.inf, -np.inf], [-1.0, 2.0, 1.0]]])
    assert to_bitmap(image, lambda x: x).tolist() == [[[0, 255, 0], [0, 255, 255]]]


def test_a_tone_mapper_that_changes_the_shape_is_refused():
    with pytest.raises(ConfigError, match=r"\(1, 2\).*\(1, 2, 3\)"):
        to_bitmap(np.ones((1, 2, 3)), lambda x: x.mean(axis=2))


def test_a_film_says_its_size_and_samples():
    assert repr(filled(noise(3))) == "Film(4x3, 3 spp)"


def test_means_of_single_samples_are_samples():
    samples = noise(5)
    film = Film(4, 3)
    for layer in samples:
        film.add_mean(layer, 1)
    for name in ("sums", "squares", "even_sums", "counts"):
        np.testing.assert_array_equal(getattr(film, name), getattr(filled(samples), name))


def test_the_variance_of_means_is_unbiased_whatever_their_samples():
    """Over many films of normal samples, whose means are of 1, 4 and 2 of them."""
    rng, found = np.random.default_rng(4), []
    for _ in range(400):
        film = Film(8, 8)
        for spp in (1, 4, 2):
            film.add_mean(rng.normal(3.0, 1.0, (spp, 8, 8, 3)).mean(axis=0), spp)
        found.append(film.variance_of_mean())
    assert np.mean(found) == pytest.approx(1 / 7, rel=0.02)


def test_means_of_different_numbers_of_samples_count_as_often_in_each_pixel():
    film = Film(2, 1)
    film.add_mean(np.array([[[1.0] * 3, [2.0] * 3]]), np.array([[3, 0]]))
    film.add_mean(np.array([[[4.0] * 3, [6.0] * 3]]), np.array([[1, 2]]))
    assert film.counts.tolist() == [[4, 2]]
    assert film.mean()[0].tolist() == [[1.75] * 3, [6.0] * 3]


def test_a_film_of_means_takes_no_samples_until_it_is_cleared():
    film = Film(2, 1)
    film.add_mean(np.ones((1, 2, 3)), 4)
    assert np.isnan(film.variance_of_mean()).all()
    with pytest.raises(ValueError, match="means of several"):
        film.add(np.ones((1, 2, 3)))
    film.clear()
    film.add(np.full((1, 2, 3), 2.0))
    assert film.mean().max() == film.spp * 2.0


def test_a_bad_mean_counts_as_black_and_all_its_samples_as_bad():
    film = Film(2, 1)
    film.add_mean(np.array([[[1.0] * 3, [1.0, np.inf, 1.0]]]), 4)
    assert film.bad_samples == 4
    assert film.mean()[0].tolist() == [[1.0] * 3, [0.0] * 3]


@pytest.mark.parametrize(("shape", "spp"), [((1, 2, 3), 1), ((2, 1, 3), 0), ((2, 1), 3)])
def test_a_mean_of_another_shape_or_of_no_samples_is_refused(shape, spp):
    with pytest.raises(ValueError, match=r"\(2, 1, 3\) and 1 or more"):
        Film(1, 2).add_mean(np.ones(shape), spp)
