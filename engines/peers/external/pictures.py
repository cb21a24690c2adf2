"""The image that a program left: EXR or PFM, of the size asked for, every pixel finite."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engines.errors import RaybenchError, RendererFailed
from engines.image import read_image
from engines.scene.formats.floats import read_pfm

Image = NDArray[np.float64]


def read_picture(name: str, path: Path, width: int, height: int) -> Image:
    """(height, width, 3) linear radiance, row 0 at the top. Raises `RendererFailed`, naming the renderer."""
    if not path.is_file():
        raise RendererFailed(f"{name}: the program ended well, but wrote no image to {{image}}")
    try:
        image = _read_pfm(path) if path.suffix == ".pfm" else read_image(path)
    except (RaybenchError, ValueError, OSError) as error:
        raise RendererFailed(f"{name}: its image cannot be read: {str(error).replace(str(path), path.name)}") from error
    if image.shape[:2] != (height, width):
        size = f"{image.shape[1]}x{image.shape[0]}"
        raise RendererFailed(f"{name}: its image has {size} pixels where {width}x{height} are expected")
    bad = int((~np.isfinite(image).all(axis=2)).sum())
    if bad:
        raise RendererFailed(f"{name}: {bad} of the {width * height} pixels of its image are not finite")
    return np.array(np.broadcast_to(image, (height, width, 3)), np.float64)


def _read_pfm(path: Path) -> NDArray[np.float32]:
    with path.open("rb") as stream:
        return read_pfm(stream)
