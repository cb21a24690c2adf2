"""Image files: exact in float32, whole or not at all, and refused by name when they cannot be used."""

from __future__ import annotations

import os

import numpy as np
import pytest
from PIL import Image as Pillow

from engines.errors import ConfigError, SceneError
from engines.film import Film, to_bitmap
from engines.image import png_bytes, read_film_layers, read_image, read_provenance, write_image

PROVENANCE = {"engine": "numpy", "spp": 3, "unicode": "ö", "nested": {"a": [1, 2.5, None]}}


def some_film(samples=3):
    film, random = Film(7, 5), np.random.default_rng(1)
    for _ in range(samples):
        film.add(random.random((5, 7, 3)) * 10)
    return film


def test_a_film_comes_back_exactly_in_float32(tmp_path):
    film = some_film()
    film.save(tmp_path / "a.exr", PROVENANCE)
    layers = read_film_layers(tmp_path / "a.exr")
    written = (film.mean(), film.variance_of_mean(), film.half(0), film.half(1))
    for found, expected in zip(layers, written, strict=True):
        assert found.dtype == np.float64 and np.array_equal(found, expected.astype(np.float32))
    assert np.array_equal(read_image(tmp_path / "a.exr"), layers.mean)
    assert read_provenance(tmp_path / "a.exr") == PROVENANCE


def test_a_film_is_saved_as_a_bitmap_through_its_tone_mapper(tmp_path):
    film = some_film()
    film.save(tmp_path / "a.png", PROVENANCE, tone_mapper="reinhard")
    assert np.array_equal(np.asarray(Pillow.open(tmp_path / "a.png")), film.to_bitmap("reinhard"))
    assert read_provenance(tmp_path / "a.png") == PROVENANCE
    assert film._repr_png_()[:4] == b"\x89PNG"


def test_a_film_of_one_sample_keeps_its_missing_variance(tmp_path):
    some_film(1).save(tmp_path / "a.exr")
    assert np.isnan(read_film_layers(tmp_path / "a.exr").variance).all()
    assert read_provenance(tmp_path / "a.exr") == {}


def test_special_floats_survive_in_exr(tmp_path):
    image = np.array([[[0.0, -0.0, 1e-45], [np.inf, -np.inf, np.nan], [3.4e38, -1e-38, 1 / 3]]], np.float32)
    write_image(tmp_path / "a.exr", image)
    found = read_image(tmp_path / "a.exr").astype(np.float32)
    assert found.tobytes() == image.tobytes()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (33, 17)])
def test_images_of_any_shape_survive(tmp_path, size):
    image = np.random.default_rng(2).random((*size, 3)).astype(np.float32)
    write_image(tmp_path / "a.exr", image)
    assert np.array_equal(read_image(tmp_path / "a.exr"), image)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".tiff", ".webp", ".PNG"])
def test_lossless_bitmaps_survive_and_are_read_as_linear(tmp_path, suffix):
    bitmap = np.random.default_rng(3).integers(0, 256, (4, 6, 3), np.uint8)
    write_image(tmp_path / f"a{suffix}", bitmap)
    linear = read_image(tmp_path / f"a{suffix}")
    assert linear.dtype == np.float64 and np.array_equal(to_bitmap(linear, "srgb"), bitmap)


def test_linear_images_are_encoded_as_srgb(tmp_path):
    write_image(tmp_path / "a.png", np.full((1, 1, 3), 0.5))
    assert np.asarray(Pillow.open(tmp_path / "a.png")).tolist() == [[[188, 188, 188]]]
    write_image(tmp_path / "a.jpg", np.full((8, 8, 3), 0.5))
    assert np.allclose(read_image(tmp_path / "a.jpg"), 0.5, atol=0.02)


def test_grey_and_transparent_bitmaps_are_read_as_rgb(tmp_path):
    Pillow.fromarray(np.full((2, 3), 255, np.uint8)).save(tmp_path / "grey.png")
    assert read_image(tmp_path / "grey.png").tolist() == np.ones((2, 3, 3)).tolist()
    Pillow.fromarray(np.full((2, 3, 4), 255, np.uint8)).save(tmp_path / "alpha.png")
    assert read_image(tmp_path / "alpha.png").shape == (2, 3, 3)


def test_png_bytes_carry_provenance(tmp_path):
    (tmp_path / "a.png").write_bytes(png_bytes(np.zeros((2, 2, 3), np.uint8), PROVENANCE))
    assert read_provenance(tmp_path / "a.png") == PROVENANCE


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    write_image(tmp_path / "a.exr", np.zeros((2, 2, 3)))
    before = (tmp_path / "a.exr").read_bytes()

    def broken(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", broken)
    for name in ("a.exr", "a.png"):
        with pytest.raises(ConfigError, match=rf"{name}: cannot be written: No space left on device"):
            write_image(tmp_path / name, np.ones((2, 2, 3)))
    assert os.listdir(tmp_path) == ["a.exr"] and (tmp_path / "a.exr").read_bytes() == before


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("a.gif", np.zeros((2, 2, 3)), "unknown image format '.gif'"),
        ("a", np.zeros((2, 2, 3)), "unknown image format ''"),
        ("a.ex", np.zeros((2, 2, 3)), "did you mean '.exr'"),
        ("missing/a.exr", np.zeros((2, 2, 3)), "there is no folder"),
        ("folder.png", np.zeros((2, 2, 3)), "is a folder"),
        ("a.exr", np.zeros((2, 2)), r"an image of shape \(height, width, 3\) is expected"),
        ("a.png", np.zeros((0, 2, 3)), r"an image of shape \(height, width, 3\) is expected"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, name, array, message):
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(ConfigError, match=message):
        write_image(tmp_path / name, array)
    assert os.listdir(tmp_path) == ["folder.png"]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.exr", None, "cannot be read: No such file"),
        ("a.xyz", b"x", "unknown image format '.xyz'"),
        ("a.exr", b"", "is empty"),
        ("a.exr", b"garbage", "is not a usable image"),
        ("a.exr", b"v/1\x01\x02\0\0\0", "is not a usable image"),
        ("a.png", b"garbage", "is not a usable image"),
        ("a.png", b"\x89PNG\r\n\x1a\n" + b"\0" * 30, "is not a usable image"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    for read in (read_image, read_provenance):
        with pytest.raises(SceneError, match=message) as caught:
            read(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


def test_layers_are_asked_only_of_films(tmp_path):
    write_image(tmp_path / "a.exr", np.zeros((2, 2, 3)))
    with pytest.raises(SceneError, match=r"channel 'variance.R' is missing: it has B, G, R"):
        read_film_layers(tmp_path / "a.exr")
    write_image(tmp_path / "a.png", np.zeros((2, 2, 3)))
    with pytest.raises(SceneError, match=r"only .exr files have layers"):
        read_film_layers(tmp_path / "a.png")
