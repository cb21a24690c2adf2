"""Images of textures: what each kind of file gives, and how the damaged ones are refused."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

import engines
from engines.errors import SceneError
from engines.image import write_channels
from engines.scene.formats import texture

RANDOM = np.random.default_rng(3)
COLORS = RANDOM.integers(0, 256, (5, 7, 4), np.uint8)
DEEP = RANDOM.integers(0, 65536, (5, 7, 4), np.uint16)
SCENE = {"raybench_scene": 1, "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]}}


def decoded(x):
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def pixels(folder, name="a.png", **keys):
    """Of the texture that a scene in this folder has."""
    found = engines.scene_from(
        {**SCENE, "textures": {"t": {"image": name, **keys}}, "materials": {"m": {"diffuse": {"reflectance": "t"}}}},
        folder=folder,
    )
    held = found.materials[0].bsdf.reflectance.pixels
    assert held.dtype == np.float32 and not held.flags.writeable
    return held


def png(values, interlace=0):
    """A PNG of (h, w, c) uint16."""
    height, width, channels = values.shape
    rows = b"".join(b"\0" + values[y].astype(">u2").tobytes() for y in range(height))
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    head = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, interlace)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    chunks = (struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in parts)
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.parametrize(
    ("mode", "suffix", "channels"),
    [
        ("L", "png", 1),
        ("LA", "png", 1),
        ("RGB", "png", 3),
        ("RGBA", "png", 3),
        ("RGB", "bmp", 3),
        ("RGB", "tga", 3),
        ("RGBA", "tga", 3),
        ("L", "tga", 1),
        ("RGB", "webp", 3),
        ("RGBA", "tif", 3),
    ],
)
def test_eight_bits_are_decoded_from_srgb_once_and_alpha_only_where_it_is_asked_for(tmp_path, mode, suffix, channels):
    values = {"L": COLORS[:, :, 0], "LA": COLORS[:, :, [0, 3]], "RGB": COLORS[:, :, :3], "RGBA": COLORS}[mode]
    options = {"lossless": True} if suffix == "webp" else {}
    Image.fromarray(values).save(tmp_path / f"a.{suffix}", **options)
    expected = COLORS[:, :, :channels] / 255
    assert np.allclose(pixels(tmp_path, f"a.{suffix}"), decoded(expected), rtol=1e-6)
    assert np.allclose(pixels(tmp_path, f"a.{suffix}", color_space="raw"), expected, rtol=1e-6)
    assert np.allclose(pixels(tmp_path, f"a.{suffix}", channel="b"), decoded(expected[:, :, -1:]), rtol=1e-6)
    if "A" in mode:
        assert np.allclose(pixels(tmp_path, f"a.{suffix}", channel="a"), COLORS[:, :, 3:] / 255, rtol=1e-6)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_sixteen_bits_are_kept(tmp_path, channels):
    (tmp_path / "a.png").write_bytes(png(DEEP[:, :, :channels]))
    last = (channels - 1) // 2 * 2 + 1
    expected = DEEP[:, :, :last] / 65535
    assert np.allclose(pixels(tmp_path), decoded(expected), rtol=1e-6)
    if channels in (2, 4):
        assert np.allclose(pixels(tmp_path, channel="a"), DEEP[:, :, channels - 1 : channels] / 65535, rtol=1e-6)


def test_palettes_bits_cmyk_and_jpeg_become_colours_or_grey(tmp_path):
    flat = np.full((8, 8, 3), (200, 100, 50), np.uint8)
    Image.fromarray(flat).convert("P", palette=Image.Palette.ADAPTIVE).save(tmp_path / "p.png")
    Image.fromarray(flat).save(tmp_path / "j.jpg", quality=98)
    Image.fromarray(flat).convert("CMYK").save(tmp_path / "c.jpg", quality=98)
    Image.fromarray(np.eye(8) > 0).save(tmp_path / "bit.png")
    for name in ("p.png", "j.jpg", "c.jpg"):
        assert np.allclose(pixels(tmp_path, name, color_space="raw") * 255, flat, atol=3)
    assert np.array_equal(pixels(tmp_path, "bit.png")[:, :, 0], np.eye(8))


def test_exr_is_linear_and_has_one_channel_or_three(tmp_path):
    values = RANDOM.normal(size=(5, 7, 3)).astype(np.float32)
    write_channels(tmp_path / "c.exr", {"RGB": values, "A": np.ones((5, 7), np.float32)})
    write_channels(tmp_path / "y.exr", {"Y": values[:, :, 0]})
    assert np.array_equal(pixels(tmp_path, "c.exr"), values)
    assert np.array_equal(pixels(tmp_path, "c.exr", channel="a"), np.ones((5, 7, 1)))
    assert np.array_equal(pixels(tmp_path, "y.exr"), values[:, :, :1])
    values[2, 3, 1] = np.nan
    write_channels(tmp_path / "n.exr", {"RGB": values})
    with pytest.raises(SceneError, match=r"textures\.t\.image: .*n\.exr: holds values that are infinite or not a number$"):
        pixels(tmp_path, "n.exr")


def hdr(rows, width):
    return b"#?RADIANCE\nSOFTWARE=x\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (len(rows), width) + b"".join(rows)


def test_hdr_with_and_without_runs(tmp_path):
    flat = bytes((128, 64, 32, 129)) * 2 + bytes((255, 0, 1, 0))
    (tmp_path / "flat.hdr").write_bytes(hdr([flat], 3))
    expected = [[1.0, 0.5, 0.25], [1.0, 0.5, 0.25], [0, 0, 0]]
    assert np.array_equal(pixels(tmp_path, "flat.hdr")[0], expected)
    literal = bytes((8, *range(1, 9)))
    row = bytes((2, 2, 0, 8)) + literal + bytes((128 + 8, 64)) + bytes((3, 9, 9, 9, 128 + 5, 0)) + bytes((128 + 8, 136))
    (tmp_path / "runs.hdr").write_bytes(hdr([row, row], 8))
    found = pixels(tmp_path, "runs.hdr")
    assert found.shape == (2, 8, 3) and np.array_equal(found[1], found[0])
    assert found[0, :, 0].tolist() == [*range(1, 9)] and found[0, :, 1].tolist() == [64] * 8
    assert found[0, :, 2].tolist() == [9] * 3 + [0] * 5
    for cut in (len(row) * 2 - 1, len(row), 3):
        (tmp_path / "cut.hdr").write_bytes(hdr([row, row], 8)[: -len(row) * 2 + cut])
        with pytest.raises(SceneError, match="pixels are damaged or cut short"):
            pixels(tmp_path, "cut.hdr")


@pytest.mark.parametrize(("scale", "order"), [("-1.0", "<f4"), ("2", ">f4")])
def test_pfm_in_both_orders_of_bytes(tmp_path, scale, order):
    values = np.arange(12).reshape(2, 2, 3)
    content = f"PF\n2 2\n{scale}\n".encode() + values.astype(order).tobytes()
    (tmp_path / "a.pfm").write_bytes(content)
    assert np.array_equal(pixels(tmp_path, "a.pfm"), values[::-1] * abs(float(scale)))
    (tmp_path / "g.pfm").write_bytes(content.replace(b"PF", b"Pf"))
    assert pixels(tmp_path, "g.pfm").tolist()[1][0] == pytest.approx([0.0])
    for damaged in (content[:-1], b"PF 2 2\n", content.replace(b"2 2", b"0 2")):
        (tmp_path / "d.pfm").write_bytes(damaged)
        with pytest.raises(SceneError, match=r"is not a usable image|has 0 x 2 pixels"):
            pixels(tmp_path, "d.pfm")


def test_a_file_is_read_once_a_scene_and_decoded_once_each_way(tmp_path, monkeypatch):
    Image.fromarray(COLORS).save(tmp_path / "a.png")
    read = []
    original = texture._bitmap
    monkeypatch.setattr(texture, "_bitmap", lambda file, formats: read.append(file) or original(file, formats))
    ways = [{}, {"scale": 2}, {"color_space": "raw"}, {"channel": "a"}, {"color_space": "srgb"}]
    scene = engines.scene_from(
        {
            **SCENE,
            "textures": {f"t{i}": {"image": "a.png", **way} for i, way in enumerate(ways)},
            "materials": {f"m{i}": {"kd": f"t{i}"} for i in range(len(ways))},
        },
        folder=tmp_path,
    )
    held = [material.bsdf.kd.pixels for material in scene.materials]
    assert len(read) == 1 and held[0] is held[1] is held[4] and held[2] is not held[0]


def test_one_texel_and_twenty_thousand(tmp_path):
    Image.fromarray(COLORS[:1, :1]).save(tmp_path / "a.png")
    assert pixels(tmp_path).shape == (1, 1, 3)
    Image.fromarray(np.zeros((2, 20_000), np.uint8)).save(tmp_path / "a.png")
    assert pixels(tmp_path).shape == (2, 20_000, 1)


def bomb(width, height):
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    start = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + head + struct.pack(">I", zlib.crc32(b"IHDR" + head))
    return start + struct.pack(">I", 100) + b"IDAT" + zlib.compress(bytes(50))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.png", bomb(60_000, 60_000), "a.png: "),
        ("a.png", bomb(12_000, 12_000), "pixels: at most 33554432 are read from a file of its size"),
        ("a.png", png(DEEP)[:-40], "a.png: is not a usable image: "),
        ("a.hdr", hdr([], 500_000).replace(b"-Y 0", b"-Y 500000"), "pixels: at most 33554432 are read"),
        ("a.hdr", b"#?RADIANCE\n\n+Y 3 +X 3\n", "'-Y height [+]X width'"),
        ("a.hdr", b"P6 3 3 255\n", "the content of a Radiance HDR file is expected"),
        ("a.exr", b"v/1\x01" + bytes(40), "a.exr: is not a usable image"),
        ("a.gif", b"GIF89a", "unknown image format '.gif'"),
        ("a.tga", b"not one", "a.tga: is not a usable image"),
        ("a.png", b"", "a.png: is empty"),
    ],
)
def test_damaged_huge_and_foreign_files_are_refused_in_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=message) as refused:
        pixels(tmp_path, name)
    assert str(refused.value).startswith("textures.t.image: ") and "\n" not in str(refused.value)


def test_arrays_are_textures_too():
    assert np.allclose(pixels(".", COLORS), decoded(COLORS[:, :, :3] / 255), rtol=1e-6)
    assert np.array_equal(pixels(".", COLORS[:, :, 0] / 255.0), (COLORS[:, :, :1] / 255).astype(np.float32))
    mine = np.zeros((2, 2, 3), np.float32)
    held = pixels(".", mine)
    mine[0] = 1.0
    assert not held.any()
    for wrong, message in (
        (np.zeros(3), r"array \(3,\): must have the shape"),
        (np.zeros((2, 2, 5)), "must have the shape"),
        (np.zeros((2, 2), np.int32), "array of int32: must be uint8"),
        (np.full((2, 2), np.inf), "infinite"),
    ):
        with pytest.raises(SceneError, match=message):
            pixels(".", wrong)


@pytest.mark.parametrize(("letter", "texel"), [(b"F", [1.0, 0.5, 0.25]), (b"f", [0.5])])
def test_an_environment_may_be_a_pfm_whose_first_row_is_the_lowest(tmp_path, letter, texel):
    rows = np.array([[texel] * 2, [[0.0] * len(texel)] * 2], "<f4")
    (tmp_path / "sky.pfm").write_bytes(b"P" + letter + b"\n2 2\n-1.0\n" + rows.tobytes())
    (found,) = engines.scene_from({**SCENE, "lights": [{"environment": {"image": "sky.pfm"}}]}, folder=tmp_path).lights
    expected = texel if len(texel) == 3 else texel * 3
    assert found.image.tolist() == [[[0.0] * 3] * 2, [expected] * 2]


def test_an_environment_may_be_hdr_or_an_array(tmp_path):
    (tmp_path / "sky.hdr").write_bytes(hdr([bytes((128, 64, 32, 129)) * 2], 2))
    light = {"image": "sky.hdr", "scale": 2, "radiance": [1, 2, 3], "rotation": [[0, 0, 1], [0, 1, 0], [1, 0, 0]]}
    (found,) = engines.scene_from({**SCENE, "lights": [{"environment": light}]}, folder=tmp_path).lights
    assert found.image.tolist() == [[[1.0, 0.5, 0.25]] * 2] and found.radiance == (2, 4, 6) and found.rows == "cells"
    assert found.rotation == ((0, 0, 1), (0, 1, 0), (1, 0, 0))
    (found,) = engines.scene_from({**SCENE, "lights": [{"environment": {"image": np.ones((2, 2, 3))}}]}).lights
    assert found.image.shape == (2, 2, 3)


def test_a_buffer_with_the_wrong_channel_says_so(tmp_path):
    buffer = io.BytesIO()
    Image.fromarray(COLORS[:, :, :3]).save(buffer, "PNG")
    (tmp_path / "a.png").write_bytes(buffer.getvalue())
    with pytest.raises(SceneError, match=r"textures.t.channel = 'a': the image has no such channel"):
        pixels(tmp_path, channel="a")
