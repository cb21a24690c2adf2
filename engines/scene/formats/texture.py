"""Images of textures: from files or arrays to linear float32, in as many channels as they have."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.image import (
    PILLOW_FORMATS,
    SUFFIXES,
    check_bitmap,
    check_size,
    decoding,
    exr_channels,
    most_pixels,
    opened_bitmap,
    readable,
)
from engines.input_files import open_regular
from engines.scene.formats.floats import read_hdr, read_pfm

TEXTURE_SUFFIXES = (*SUFFIXES, ".hdr", ".pfm", ".tga")
FLOATS = {".hdr": read_hdr, ".pfm": read_pfm}
"""Ending -> reader of formats that hold linear values and are not EXR."""
CHANNELS = "rgba"
_LETTERS = {1: "r", 2: "ra", 3: "rgb", 4: "rgba"}
"""What the channels of an image are; the first of a grey one is its grey, which `r`, `g` and `b` all mean."""


def read_texels(path: Path, data: bytes | None = None) -> NDArray[Any]:
    """(h, w, c) values as a file has them, c from 1 to 4: grey, grey and alpha, RGB, RGB and alpha. `data` is a bitmap that
    stands within another file; messages call it `path`.

    uint8 and uint16 of bitmaps, float32 of EXR, HDR and PFM. Raises `SceneError` naming the file when it is missing, no regular
    file, damaged, of an unknown format, too large (known from its header), or holds infinities or NaN.
    """
    if data is not None:
        return _bitmap(path, PILLOW_FORMATS, data)
    file = readable(path, TEXTURE_SUFFIXES)
    suffix = file.suffix.lower()
    if suffix != ".exr" and suffix not in FLOATS:
        return _bitmap(file, (*PILLOW_FORMATS, "TGA") if suffix == ".tga" else PILLOW_FORMATS)
    if suffix == ".exr":
        texels = _exr(file)
    else:
        with decoding(file), open_regular(file) as stream:
            texels = FLOATS[suffix](stream, lambda width, height: check_size(file, width, height, most_pixels(file)))
    if not np.isfinite(texels).all():
        raise SceneError(f"{file}: holds values that are infinite or not a number")
    return texels


def _exr(file: Path) -> NDArray[np.float32]:
    channels = exr_channels(file)
    names = "RGB" if all(name in channels for name in "RGB") else "Y"
    if names == "Y" and "Y" not in channels:
        if len(channels) != 1:
            raise SceneError(f"{file}: channels R, G, B, or Y are expected: it has {', '.join(sorted(channels))}"[:500])
        (names,) = ([name] for name in channels)
    names = [*names, *(["A"] if "A" in channels else [])]
    with decoding(file):
        return np.stack([channels[name] for name in names], axis=2, dtype=np.float32, casting="same_kind")


def _bitmap(file: Path, formats: tuple[str, ...], data: bytes | None = None) -> NDArray[Any]:
    with opened_bitmap(file, formats, data) as image:
        check_bitmap(file, image, None if data is None else len(data))
        raw = str(image.tile[0][3]) if image.format == "PNG" and image.tile else ""
        if raw in ("RGB;16B", "RGBA;16B", "LA;16B"):
            return _deep_png(file, raw, data)
        if image.mode in ("I;16", "I;16L", "I;16B", "I"):
            texels = np.asarray(image)
            return texels.clip(0, 65535).astype(np.uint16)[:, :, None]
        if image.mode == "F":
            texels = np.asarray(image)
            if not np.isfinite(texels).all():
                raise SceneError(f"{file}: holds values that are infinite or not a number")
            return texels[:, :, None]
        clear = "transparency" in image.info or image.mode in ("La", "PA", "RGBa")
        if clear or image.mode not in ("L", "LA", "RGB", "RGBA"):
            texels = np.asarray(image.convert("RGBA" if clear else "L" if image.mode == "1" else "RGB"))
        else:
            texels = np.asarray(image)
        return texels[:, :, None] if texels.ndim == 2 else texels


def _deep_png(file: Path, raw: str, data: bytes | None) -> NDArray[np.uint16]:
    """Pillow has eight bits for these: its unpackers for the other order of bytes read the low ones."""

    def unpacked(how: str) -> NDArray[np.uint16]:
        with opened_bitmap(file, ("PNG",), data) as image:
            codec, extents, offset, _ = image.tile[0]
            image.tile = [type(image.tile[0])(codec, extents, offset, how)]
            return np.asarray(image).astype(np.uint16)

    if raw == "LA;16B":
        four = unpacked("RGBA")
        return four[:, :, ::2] * np.uint16(256) + four[:, :, 1::2]
    return unpacked(raw) * np.uint16(256) + unpacked(f"{raw[:-1]}L")


def linear(texels: NDArray[Any], srgb: bool | None, channel: str = "") -> NDArray[np.float32]:
    """(h, w, 3) or (h, w, 1) linear values of (h, w, c): without alpha, or one `channel` of "rgba" alone.

    Whole numbers mean shares of their largest. `srgb` says whether the values are sRGB-encoded, which alpha never is; with
    None whole numbers are. Raises KeyError for a channel that is not there.
    """
    letters = _LETTERS[texels.shape[2]]
    if channel:
        grey = "a" not in channel and len(letters) < 3
        index = 0 if grey else letters.find(channel)
        if index < 0:
            raise KeyError(channel)
        texels = texels[:, :, index : index + 1]
    else:
        texels = texels[:, :, : len(letters.rstrip("a"))]
    whole = texels.dtype.kind == "u"
    encoded = (whole if srgb is None else srgb) and channel != "a"
    if whole:
        return _table(texels.dtype.itemsize, encoded)[texels]
    values = np.ascontiguousarray(texels, np.float32)
    return _decoded(values).astype(np.float32) if encoded else values


@cache
def _table(size: int, encoded: bool) -> NDArray[np.float32]:
    values = np.arange(256**size) / (256**size - 1)
    return (_decoded(values) if encoded else values).astype(np.float32)


def _decoded(x: NDArray[Any]) -> NDArray[Any]:
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)
