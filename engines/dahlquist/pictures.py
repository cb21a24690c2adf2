"""The probe that mirrors show and the background behind everything: (h, w, 3) uint8, made by formula or read from files."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from engines.image import read_bitmap

Picture = NDArray[np.uint8]


def smooth_probe() -> Picture:
    """256 x 256, red to the right, green downwards, blue to the upper left."""
    y, x = np.mgrid[:256, :256]
    return np.stack([x, y, 255 - ((x + y) >> 1)], axis=-1).astype(np.uint8)


def checker_probe() -> Picture:
    """The smooth probe with every other square of eight texels at half its brightness."""
    y, x = np.mgrid[:256, :256]
    dark = ((x >> 3) ^ (y >> 3)) & 1
    return smooth_probe() >> dark[:, :, None].astype(np.uint8)


def formula_background() -> Picture:
    """512 x 512, red to the right, green downwards, blue in squares of 32."""
    y, x = np.mgrid[:512, :512]
    blue = np.where(((x >> 5) + (y >> 5)) & 1, 160, 96)
    return np.stack([x * 255 // 511, y * 255 // 511, blue], axis=-1).astype(np.uint8)


PROBES: dict[str, Callable[[], Picture]] = {"checker": checker_probe, "smooth": smooth_probe}


def read_picture(path: str | PathLike[str]) -> Picture:
    """(h, w, 3) uint8 of an 8-bit image file. Raises `SceneError` naming the file."""
    return read_bitmap(path)
