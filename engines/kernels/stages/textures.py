"""What a texture holds at (u, v): docs/transport.md, "Textures". All in float64."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import array_at
from engines.kernels.flatten.programs import CHECKERBOARD, CLAMP, REPEAT
from engines.kernels.lane.vector import Vec3


class Place(NamedTuple):
    """A point of an image, in texels from the upper left corner."""

    x: float
    y: float


@inline
def luminance(color):
    return 0.212671 * color.x + 0.715160 * color.y + 0.072169 * color.z


@inline
def _wrapped(index, n, wrap):
    """The texel that stands at a whole number, inside the image or not."""
    size = np.float64(n)
    if wrap == REPEAT:
        index -= math.floor(index / size) * size
    elif wrap != CLAMP:
        index -= math.floor(index / (2.0 * size)) * (2.0 * size)
        if index >= size:
            index = 2.0 * size - 1.0 - index
    return np.int64(min(max(index, 0.0), size - 1.0))


@inline
def _texel(texels, row, x, y):
    """The colour of a texel, by whole numbers that may lie outside."""
    wrap, channels = np.int64(row.wrap), np.int64(row.channels)
    column, line = _wrapped(x, np.int64(row.width), wrap), _wrapped(y, np.int64(row.height), wrap)
    first = (line * np.int64(row.width) + column) * channels
    step = np.int64(1) if channels == 3 else np.int64(0)
    return Vec3(np.float64(texels[first]), np.float64(texels[first + step]), np.float64(texels[first + 2 * step]))


@inline
def _place(row, u, v):
    """(u', v') of (u, v)."""
    m = row.to_uv
    return Place(m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5])


@inline
def color_at(scene, texture, u, v):
    """The colour there; a number in all channels of an image that has one."""
    row = scene.textures[texture]
    at = _place(row, u, v)
    if np.int64(row.kind) == CHECKERBOARD:
        odd_u, odd_v = at.x - math.floor(at.x) > 0.5, at.y - math.floor(at.y) > 0.5
        return row.a if odd_u == odd_v else row.b
    texels = array_at(scene.texels[texture], np.float32)
    x, y = at.x * row.width, at.y * row.height
    if not (math.isfinite(x) and math.isfinite(y)):
        return _texel(texels, row, 0.0, 0.0)
    if row.nearest != 0.0:
        return _texel(texels, row, math.floor(x), math.floor(y))
    x, y = x - 0.5, y - 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    above = _texel(texels, row, left, top) * (1.0 - fx) + _texel(texels, row, left + 1.0, top) * fx
    below = _texel(texels, row, left, top + 1.0) * (1.0 - fx) + _texel(texels, row, left + 1.0, top + 1.0) * fx
    return above * (1.0 - fy) + below * fy


@inline
def gradient_at(scene, texture, u, v):
    """(dh/du, dh/dv) of an image read as a number; 0 where (u, v) is not finite, and of the nearest texel."""
    row = scene.textures[texture]
    at = _place(row, u, v)
    x, y = at.x * row.width - 0.5, at.y * row.height - 0.5
    if row.nearest != 0.0 or not (math.isfinite(x) and math.isfinite(y)):
        return Place(0.0, 0.0)
    texels = array_at(scene.texels[texture], np.float32)
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    h00, h10 = luminance(_texel(texels, row, left, top)), luminance(_texel(texels, row, left + 1.0, top))
    h01, h11 = luminance(_texel(texels, row, left, top + 1.0)), luminance(_texel(texels, row, left + 1.0, top + 1.0))
    du = row.width * ((1.0 - fy) * (h10 - h00) + fy * (h11 - h01))
    dv = row.height * ((1.0 - fx) * (h01 - h00) + fx * (h11 - h10))
    m = row.to_uv
    return Place(m[0] * du + m[3] * dv, m[1] * du + m[4] * dv)
