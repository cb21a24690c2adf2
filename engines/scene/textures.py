"""Textures: what engines get of each, and the keys of a scene file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.scene.triple import Triple

__all__ = ["Checkerboard", "Color", "ImageTexture", "Number", "Texture"]

UVMatrix = tuple[float, float, float, float, float, float]
"""Two rows of three: u' = m[0] u + m[1] v + m[2], v' = m[3] u + m[4] v + m[5]."""
IDENTITY: UVMatrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ImageTexture:
    """An image (h, w, 3) or (h, w, 1) float32, read-only: linear RGB, or one number a texel.

    (u, v) become (u', v') by `to_uv`; v' = 0 is the upper edge of the first row. `filter` is "bilinear" or "nearest",
    `wrap` "repeat", "mirror" or "clamp". Where one number is wanted, RGB gives its luminance.
    """

    pixels: NDArray[np.float32]
    filter: str = "bilinear"
    wrap: str = "repeat"
    to_uv: UVMatrix = IDENTITY
    name: str = "image"


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """Squares of half a unit of (u', v'): `a` where frac(u') > 1/2 equals frac(v') > 1/2, else `b`.

    Where one number is wanted, each colour gives its luminance.
    """

    a: Triple = (0.4, 0.4, 0.4)
    b: Triple = (0.2, 0.2, 0.2)
    to_uv: UVMatrix = IDENTITY


Texture = ImageTexture | Checkerboard
Color = Triple | Texture
"""Where a colour is expected."""
Number = float | Texture
"""Where a number is expected."""
