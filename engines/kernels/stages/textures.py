"""What a texture holds at (u, v): docs/transport.md, "Textures". All in float64."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import array_at, prefetch
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten import palettes
from engines.kernels.flatten.programs import CHECKERBOARD, CLAMP, FACE_ATTRIBUTE, REPEAT, VERTEX_ATTRIBUTE
from engines.kernels.lane.vector import Vec3, to_real


class Place(NamedTuple):
    """A point of an image, in texels from the upper left corner."""

    x: float
    y: float


@inline
def luminance(color):
    return 0.212671 * color.x + 0.715160 * color.y + 0.072169 * color.z


@inline
def _wrapped(index, n, wrap):
    """The texel that stands at a whole number, a float, inside the image or not."""
    size = np.float64(n)
    if wrap == REPEAT:
        index -= np.floor(index / size) * size
    elif wrap != CLAMP:
        index -= np.floor(index / (2.0 * size)) * (2.0 * size)
        if index >= size:
            index = 2.0 * size - 1.0 - index
    return np.int64(min(max(index, 0.0), size - 1.0))


class Corners(NamedTuple):
    """Where the texels around a point begin among the numbers of an image, each the sum of a row's start and a column's; and
    how near the point is to the right and the lower ones."""

    left: int
    right: int
    above: int
    below: int
    fx: float
    fy: float


@inline
def _corners(row, x, y):
    """Around a point in texels, counted from the centre of the first one; both finite."""
    width, height, wrap, channels = (np.int64(row.width), np.int64(row.height), np.int64(row.wrap), np.int64(row.channels))
    left, top = np.floor(x), np.floor(y)
    return Corners(
        _wrapped(left, width, wrap) * channels,
        _wrapped(left + 1.0, width, wrap) * channels,
        _wrapped(top, height, wrap) * width * channels,
        _wrapped(top + 1.0, height, wrap) * width * channels,
        x - left,
        y - top,
    )


@inline
def _texel(address, row, first):
    """The colour of the texel that begins at a number of the image at `address`."""
    second = first + (np.int64(1) if row.channels == 3.0 else np.int64(0))
    third, numbers = 2 * second - first, array_at(address, np.float32)
    if row.indexed != 0.0:  # the numbers are a palette
        places = array_at(address + palettes.BYTES, np.uint8)
        first, second, third = np.int64(places[first]), np.int64(places[second]), np.int64(places[third])
    return Vec3(np.float64(numbers[first]), np.float64(numbers[second]), np.float64(numbers[third]))


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
    texels = scene.texels[texture]
    x, y = at.x * row.width, at.y * row.height
    if not (math.isfinite(x) and math.isfinite(y)):
        return _texel(texels, row, 0)
    if row.nearest != 0.0:
        corners = _corners(row, x, y)
        return _texel(texels, row, corners.above + corners.left)
    at = _corners(row, x - 0.5, y - 0.5)
    above = _texel(texels, row, at.above + at.left) * (1.0 - at.fx) + _texel(texels, row, at.above + at.right) * at.fx
    below = _texel(texels, row, at.below + at.left) * (1.0 - at.fx) + _texel(texels, row, at.below + at.right) * at.fx
    return above * (1.0 - at.fy) + below * at.fy


@inline
def as_light(color, real):
    """A colour of a texture that emits: less than 0 counts as 0."""
    return to_real(Vec3(max(color.x, 0.0), max(color.y, 0.0), max(color.z, 0.0)), real)


class OnTriangle(NamedTuple):
    """A point of a triangle, the id of a primitive, by the weights of its second and third vertex."""

    primitive: int
    b1: float
    b2: float


@inline
def _row_of(address, index):
    first, numbers = 3 * np.int64(index), array_at(address, np.float32)
    return Vec3(np.float64(numbers[first]), np.float64(numbers[first + 1]), np.float64(numbers[first + 2]))


@inline
def _attribute_at(scene, texture, on):
    row, values = scene.textures[texture], scene.texels[texture]
    index = np.int64(scene.primitives[on.primitive].index)
    if np.int64(row.kind) == FACE_ATTRIBUTE:
        return _row_of(values, index) * row.a.x
    face = scene.triangles[index]
    a, b, c = _row_of(values, face.a), _row_of(values, face.b), _row_of(values, face.c)
    return (a * (1.0 - on.b1 - on.b2) + b * on.b1 + c * on.b2) * row.a.x


@per_features
def make_color(features: SceneFeatures) -> Any:
    """The function (scene, texture, at, on) -> its colour at coordinates `at`; of an attribute of meshes at the point `on` of a
    triangle."""
    attributes = features.attributes

    @inline
    def color(scene, texture, at, on):
        if attributes and np.int64(scene.textures[texture].kind) >= VERTEX_ATTRIBUTE:
            return _attribute_at(scene, texture, on)
        return color_at(scene, texture, at.u, at.v)

    return color


@inline
def gradient_at(scene, texture, u, v):
    """(dh/du, dh/dv) of an image read as a number; 0 where (u, v) is not finite, and of the nearest texel."""
    row = scene.textures[texture]
    at = _place(row, u, v)
    x, y = at.x * row.width - 0.5, at.y * row.height - 0.5
    if row.nearest != 0.0 or not (math.isfinite(x) and math.isfinite(y)):
        return Place(0.0, 0.0)
    texels = scene.texels[texture]
    c = _corners(row, x, y)
    h00, h10 = luminance(_texel(texels, row, c.above + c.left)), luminance(_texel(texels, row, c.above + c.right))
    h01, h11 = luminance(_texel(texels, row, c.below + c.left)), luminance(_texel(texels, row, c.below + c.right))
    du = row.width * ((1.0 - c.fy) * (h10 - h00) + c.fy * (h11 - h01))
    dv = row.height * ((1.0 - c.fx) * (h01 - h00) + c.fx * (h11 - h10))
    m = row.to_uv
    return Place(m[0] * du + m[3] * dv, m[1] * du + m[4] * dv)


@inline
def prefetch_texels(scene, texture, u, v):
    """Starts loading what `color_at` and `gradient_at` read there."""
    row = scene.textures[texture]
    at = _place(row, u, v)
    x, y = at.x * row.width - 0.5, at.y * row.height - 0.5
    if math.isfinite(x) and math.isfinite(y):
        corners, texels, size = _corners(row, x, y), scene.texels[texture], 4
        if row.indexed != 0.0:
            texels, size = texels + palettes.BYTES, 1
        prefetch(texels + size * (corners.above + corners.left))
        prefetch(texels + size * (corners.above + corners.right + 2))
        prefetch(texels + size * (corners.below + corners.left))
        prefetch(texels + size * (corners.below + corners.right + 2))
