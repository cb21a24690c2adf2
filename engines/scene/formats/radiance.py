"""Radiance HDR files (RGBE): a text header, then scan lines, as they are or run-length encoded (Ward 1991)."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.input_files import open_regular

MAGIC = (b"#?RADIANCE", b"#?RGBE")
HEADER = 1 << 16
"""Bytes within which the header ends."""
_SIZE = re.compile(rb"-Y (\d{1,6}) \+X (\d{1,6})")
_RUNS = range(8, 1 << 15)
"""Widths of scan lines whose four components may be encoded one after the other."""


def read_hdr(file: Path, check: Callable[[int, int], None]) -> NDArray[np.float32]:
    """(h, w, 3) linear values. `check` is called with width and height before pixels are read. Raises `SceneError`."""
    with open_regular(file) as stream:
        data = stream.read()
    lines = data[:HEADER].split(b"\n")
    if not lines[0].startswith(MAGIC):
        raise SceneError(f"{file}: is not a usable image: the content of a Radiance HDR file is expected")
    blank = next((i for i, line in enumerate(lines) if not line.strip()), len(lines))
    size = _SIZE.fullmatch(lines[blank + 1].strip()) if blank + 1 < len(lines) else None
    if size is None or any(line.startswith(b"FORMAT=") and b"rgbe" not in line for line in lines[:blank]):
        raise SceneError(f"{file}: is not a usable image: a header with '-Y height +X width' and RGBE values is expected")
    height, width = int(size[1]), int(size[2])
    check(width, height)
    rgbe = _pixels(data, sum(len(line) + 1 for line in lines[: blank + 2]), width, height)
    if rgbe is None:
        raise SceneError(f"{file}: is not a usable image: its pixels are damaged or cut short")
    exponent = rgbe[:, :, 3:].astype(np.int32)
    return np.where(exponent > 0, np.ldexp(rgbe[:, :, :3].astype(np.float32), exponent - 136), np.float32(0.0))


def _pixels(data: bytes, at: int, width: int, height: int) -> NDArray[np.uint8] | None:
    """(h, w, 4); None where the data are damaged."""
    if width not in _RUNS or data[at : at + 2] != b"\2\2":
        flat = np.frombuffer(data[at : at + 4 * width * height], np.uint8)
        return flat.reshape(height, width, 4) if len(flat) == 4 * width * height else None
    found = np.empty((height, 4, width), np.uint8)
    for row in found:
        if data[at : at + 4] != bytes((2, 2, width >> 8, width & 255)):
            return None
        line, at = _line(data, at + 4, 4 * width)
        if len(line) != 4 * width:
            return None
        row[:] = np.frombuffer(line, np.uint8).reshape(4, width)
    return found.transpose(0, 2, 1)


def _line(data: bytes, at: int, length: int) -> tuple[bytearray, int]:
    """`length` bytes of runs and literals, more or less where the data are damaged, and where the next line begins."""
    found = bytearray()
    while len(found) < length and at + 1 < len(data):
        count = data[at]
        if count > 128:
            found += data[at + 1 : at + 2] * (count - 128)
            at += 2
        elif count > 0:
            found += data[at + 1 : at + 1 + count]
            at += 1 + count
        else:
            break
    return found, at
