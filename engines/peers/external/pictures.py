"""The image that a program left: EXR or PFM, of the size asked for, every pixel finite."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engines.errors import RaybenchError, RendererFailed
from engines.image import read_image

Image = NDArray[np.float64]
_PFM_HEADER = re.compile(rb"(PF|Pf)\s+([0-9]{1,6})\s+([0-9]{1,6})\s+([-+0-9.eE]{1,32})\s")


def read_picture(name: str, path: Path, width: int, height: int) -> Image:
    """(height, width, 3) linear radiance, row 0 at the top. Raises `RendererFailed`, naming the renderer."""
    if not path.is_file():
        raise RendererFailed(f"{name}: the program ended well, but wrote no image to {{image}}")
    try:
        image = read_pfm(path.read_bytes()) if path.suffix == ".pfm" else read_image(path)
    except (RaybenchError, ValueError, OSError) as error:
        raise RendererFailed(f"{name}: its image cannot be read: {str(error).replace(str(path), path.name)}") from error
    if image.shape != (height, width, 3):
        found = f"{image.shape[1]}x{image.shape[0]}"
        raise RendererFailed(f"{name}: its image has {found} pixels where {width}x{height} are expected")
    bad = int((~np.isfinite(image).all(axis=2)).sum())
    if bad:
        raise RendererFailed(f"{name}: {bad} of the {width * height} pixels of its image are not finite")
    return image


def read_pfm(data: bytes) -> Image:
    """(h, w, 3) of a portable float map: `PF` or grey `Pf`, width, height, then a scale that is negative where the
    float32 values are little-endian; rows run from the bottom up. Raises ValueError."""
    header = _PFM_HEADER.match(data)
    if header is None:
        raise ValueError("is no portable float map: 'PF', width, height and a scale are expected")
    channels = 3 if header[1] == b"PF" else 1
    width, height, scale = int(header[2]), int(header[3]), float(header[4])
    pixels = data[header.end() :]
    wanted = 4 * width * height * channels
    if not wanted or len(pixels) != wanted:
        raise ValueError(f"a portable float map of {width}x{height} holds {len(pixels)} bytes, not {wanted}")
    values = np.frombuffer(pixels, "<f4" if scale < 0 else ">f4").reshape(height, width, channels)[::-1]
    return np.ascontiguousarray(np.broadcast_to(values, (height, width, 3)), np.float64)
