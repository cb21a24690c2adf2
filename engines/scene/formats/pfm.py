"""Portable float maps: `PF` or `Pf`, width, height and scale, then rows from the lowest up.

The sign of the scale says the order of bytes. Values are multiplied by its size, as in Mitsuba."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.input_files import open_regular

_HEADER = re.compile(rb"P([Ff])\s+(\d{1,6})\s+(\d{1,6})\s+([-+]?\d{1,20}(?:\.\d{0,20})?)\s")
HEADER = 200
"""Bytes within which the header ends."""


def read_pfm(file: Path, check: Callable[[int, int], None]) -> NDArray[np.float32]:
    """(h, w, 3) or (h, w, 1) linear values, from the uppermost row down. `check` is called with width and height before pixels
    are read. Raises `SceneError`."""
    with open_regular(file) as stream:
        header = _HEADER.match(stream.read(HEADER))
        if header is None:
            raise SceneError(f"{file}: is not a usable image: the header of a PFM file is expected: PF, width, height, scale")
        width, height, channels = int(header[2]), int(header[3]), 3 if header[1] == b"F" else 1
        check(width, height)
        stream.seek(header.end())
        data = stream.read(4 * width * height * channels)
    if not len(data) == 4 * width * height * channels > 0:
        raise SceneError(f"{file}: is not a usable image: its pixels are cut short")
    order = "<f4" if header[4].startswith(b"-") else ">f4"
    values = np.frombuffer(data, order).astype(np.float32) * np.float32(abs(float(header[4])))
    return values.reshape(height, width, channels)[::-1]
