"""Images of floats: Radiance HDR, and portable float maps.

A Radiance file (RGBE) is a text header, then scan lines, as they are or run-length encoded (Ward 1991). A portable float map is
`PF` or `Pf`, width, height and scale, then rows from the lowest up; the sign of the scale says the order of bytes, and values
are multiplied by its size, as in Mitsuba.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

MAGIC = (b"#?RADIANCE", b"#?RGBE")
HEADER = 1 << 16
"""Bytes within which the header ends."""
_NUMBER = rb"[-+]?\d{1,20}(?:\.\d{0,20})?(?:[eE][-+]?\d{1,3})?"
_PFM = re.compile(rb"P([Ff])\s+(\d{1,6})\s+(\d{1,6})\s+(" + _NUMBER + rb")\s")
PFM_HEADER = 200
"""Bytes within which the header of a PFM ends."""
_SIZE = re.compile(rb"-Y (\d{1,6}) \+X (\d{1,6})")
_RUNS = range(8, 1 << 15)
"""Widths of scan lines whose four components may be encoded one after the other."""


def read_hdr(stream: BinaryIO, check: Callable[[int, int], None]) -> NDArray[np.float32]:
    """(h, w, 3) linear values. `check` is called with width and height before they are decoded. Raises `ValueError`."""
    data = stream.read()
    lines = data[:HEADER].split(b"\n")
    if not lines[0].startswith(MAGIC):
        raise ValueError("the content of a Radiance HDR file is expected")
    blank = next((i for i, line in enumerate(lines) if not line.strip()), len(lines))
    size = _SIZE.fullmatch(lines[blank + 1].strip()) if blank + 1 < len(lines) else None
    if size is None or any(line.startswith(b"FORMAT=") and b"rgbe" not in line for line in lines[:blank]):
        raise ValueError("a header with '-Y height +X width' and RGBE values is expected")
    height, width = int(size[1]), int(size[2])
    check(width, height)
    rgbe = _pixels(data, sum(len(line) + 1 for line in lines[: blank + 2]), width, height)
    if rgbe is None:
        raise ValueError("its pixels are damaged or cut short")
    exponent = rgbe[:, :, 3:].astype(np.int32)
    return np.where(exponent > 0, np.ldexp(rgbe[:, :, :3].astype(np.float32), exponent - 136), np.float32(0.0))


def _pixels(data: bytes, at: int, width: int, height: int) -> NDArray[np.uint8] | None:
    """(h, w, 4); None where the data are damaged."""
    if width not in _RUNS or data[at : at + 2] != b"\2\2":
        flat = np.frombuffer(data[at : at + 4 * width * height], np.uint8)
        return flat.reshape(height, width, 4) if len(flat) == 4 * width * height else None
    rgbe = np.empty((height, 4, width), np.uint8)
    for row in rgbe:
        if data[at : at + 4] != bytes((2, 2, width >> 8, width & 255)):
            return None
        line, at = _line(data, at + 4, 4 * width)
        if len(line) != 4 * width:
            return None
        row[:] = np.frombuffer(line, np.uint8).reshape(4, width)
    return rgbe.transpose(0, 2, 1)


def _line(data: bytes, at: int, length: int) -> tuple[bytearray, int]:
    """`length` bytes of runs and literals, more or less where the data are damaged, and where the next line begins."""
    unpacked = bytearray()
    while len(unpacked) < length and at + 1 < len(data):
        count = data[at]
        if count > 128:
            unpacked += data[at + 1 : at + 2] * (count - 128)
            at += 2
        elif count > 0:
            unpacked += data[at + 1 : at + 1 + count]
            at += 1 + count
        else:
            break
    return unpacked, at


def read_pfm(stream: BinaryIO, check: Callable[[int, int], None] = lambda width, height: None) -> NDArray[np.float32]:
    """(h, w, 3) or (h, w, 1) linear values, from the uppermost row down. `check` is called with width and height before pixels
    are read. Raises `ValueError`."""
    header = _PFM.match(stream.read(PFM_HEADER))
    if header is None:
        raise ValueError("the header of a PFM file is expected: PF, width, height, scale")
    width, height, scale, channels = int(header[2]), int(header[3]), float(header[4]), 3 if header[1] == b"F" else 1
    check(width, height)
    stream.seek(header.end())
    expected = 4 * width * height * channels
    data = stream.read(expected)
    if not len(data) == expected > 0:
        raise ValueError(f"its pixels are cut short: {expected} bytes are expected, found {len(data)}")
    values = np.frombuffer(data, "<f4" if scale < 0.0 else ">f4").astype(np.float32) * np.float32(abs(scale))
    return values.reshape(height, width, channels)[::-1]
