"""Textures, and the parameters of BSDFs that are constants or textures, looked up at points by their (u, v)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from engines.numpy_reference.vectors import Array, Indices, Mask
from engines.scene import Checkerboard, Color, ImageTexture, MeshAttribute, Number, Texture

LUMINANCE = (0.212671, 0.715160, 0.072169)
"""Weights of linear red, green and blue where a texture stands for one number."""


class HasUV(Protocol):
    """n points with texture coordinates."""

    @property
    def uv(self) -> Array | None:
        """(2, n), None in scenes that need none."""
        ...

    @property
    def attributes(self) -> Mapping[str, Array]:
        """(3, n) each, of meshes, by name."""
        ...


class ColorParameter:
    """A colour of each of m members: constant, or a texture held in [0, `high`]. Calls cost no lookup where none is textured.

    `textured` (m,) says which are textures; `largest` (3, m) is never passed by the values, and 0 where they all are.
    """

    def __init__(self, values: Sequence[Color], high: float = 1.0) -> None:
        self._textures = _Textures(values, color, 0.0, high)
        self.textured = self._textures.textured
        constants = [(0.0, 0.0, 0.0) if isinstance(value, Texture) else value for value in values]
        self._constant = np.array(constants, np.float64).reshape(-1, 3).T.copy()
        self.largest = self._constant.copy()
        self.largest[:, self.textured] = self._textures.largest(_largest_color, (3, -1))
        self.mean = self._constant.copy()
        """(3, m) over the texels of an image, each held in the range, or over both colours of a checkerboard."""
        self.mean[:, self.textured] = self._textures.each(lambda texture: _mean_color(texture, high), (3, -1))

    def __call__(self, member: Indices, at: HasUV) -> Array:
        """(3, n) of the members (n,) at n points."""
        found = self._constant.take(member, axis=1)
        self._textures.put(found, member, at)
        return found


class NumberParameter:
    """A number of each of m members: constant, or a texture's luminance held in [`low`, `high`]. `textured` and `largest`
    (m,) as of colours."""

    def __init__(self, values: Sequence[Number], low: float = 0.0, high: float = 1.0) -> None:
        self._textures = _Textures(values, number, low, high)
        self.textured = self._textures.textured
        self._constant = np.array([0.0 if isinstance(value, Texture) else value for value in values], np.float64)
        self.largest = self._constant.copy()
        self.largest[self.textured] = self._textures.largest(_largest_number, (-1,))

    def __call__(self, member: Indices, at: HasUV) -> Array:
        """(n,) of the members (n,) at n points."""
        found = self._constant[member]
        self._textures.put(found, member, at)
        return found


class _Textures:
    """Those values of a parameter that are textures, and how they are looked up."""

    def __init__(
        self, values: Sequence[Color | Number], lookup: Callable[[Texture, Array], Array], low: float, high: float
    ) -> None:
        self.textured: Mask = np.array([isinstance(value, Texture) for value in values], bool)
        self._listed = [value for value in values if isinstance(value, Texture)]
        self._place = np.cumsum(self.textured) - 1
        self._lookup, self._low, self._high = lookup, low, high

    def each(self, function: Callable[[Texture], NDArray], shape: tuple[int, ...]) -> Array:
        """A function of every texture, the last axis being theirs."""
        return np.array([function(texture) for texture in self._listed], np.float64).T.reshape(shape)

    def largest(self, function: Callable[[Texture], NDArray], shape: tuple[int, ...]) -> Array:
        """As `each`, held in the range."""
        return np.clip(self.each(function, shape), self._low, self._high)

    def put(self, found: Array, member: Indices, at: HasUV) -> None:
        """Writes the looked-up values of the points whose member is textured."""
        if not self._listed:
            return
        lanes = np.flatnonzero(self.textured[member])
        place = self._place[member[lanes]]
        for number in np.unique(place):
            here = lanes[place == number]
            texture = self._listed[number]
            shown = at.attributes[texture.name] if isinstance(texture, MeshAttribute) else texture_coordinates(at)
            value = self._lookup(texture, shown.take(here, axis=1))
            found[..., here] = np.clip(value, self._low, self._high)


def texture_coordinates(at: HasUV) -> Array:
    """(2, n) the (u, v) of points, which scenes with textures have."""
    if at.uv is None:
        raise ValueError("the scene was prepared without texture coordinates")
    return at.uv


def color(texture: Texture, given: Array) -> Array:
    """(3, n) values; an image of one channel gives grey. `given`: texture coordinates (2, n), or of an attribute its values
    (3, n)."""
    if isinstance(texture, MeshAttribute):
        return texture.scale * given
    place = _placed(texture, given)
    if isinstance(texture, Checkerboard):
        return np.where(_first(place), *(np.array(colour)[:, None] for colour in (texture.a, texture.b)))
    return np.broadcast_to(_image(texture, place), (3, given.shape[1]))


def number(texture: Texture, given: Array) -> Array:
    """(n,) values: the luminance of RGB. `given` as of `color`."""
    if isinstance(texture, MeshAttribute):
        return _luminance(color(texture, given))
    place = _placed(texture, given)
    if isinstance(texture, Checkerboard):
        return np.where(_first(place), _luminance(np.array(texture.a)), _luminance(np.array(texture.b)))
    return _luminance(_image(texture, place))


def gradient(texture: ImageTexture, uv: Array) -> tuple[Array, Array]:
    """(n,) each: the derivatives by u and by v of `number`, inside the bilinear patch that (u, v) is in; 0 for nearest."""
    if texture.filter == "nearest":
        return np.zeros(uv.shape[1]), np.zeros(uv.shape[1])
    height, width = texture.pixels.shape[:2]
    corners, fx, fy = _patch(texture, _placed(texture, uv))
    h00, h10, h01, h11 = map(_luminance, corners)
    du = width * ((1.0 - fy) * (h10 - h00) + fy * (h11 - h01))
    dv = height * ((1.0 - fx) * (h01 - h00) + fx * (h11 - h10))
    m = texture.to_uv
    return m[0] * du + m[3] * dv, m[1] * du + m[4] * dv


def _mean_color(texture: Texture, high: float) -> Array:
    """(3,) of the colours held in [0, `high`]."""
    if isinstance(texture, MeshAttribute):
        return np.full(3, min(0.5 * texture.scale, high))
    if isinstance(texture, Checkerboard):
        return 0.5 * (np.clip(texture.a, 0.0, high) + np.clip(texture.b, 0.0, high))
    return np.broadcast_to(np.clip(texture.pixels, 0.0, high).mean(axis=(0, 1), dtype=np.float64), (3,))


def _largest_color(texture: Texture) -> Array:
    if isinstance(texture, MeshAttribute):
        return np.full(3, texture.scale)
    if isinstance(texture, Checkerboard):
        return np.maximum(texture.a, texture.b)
    return np.broadcast_to(texture.pixels.max(axis=(0, 1)).astype(np.float64), (3,))


def _largest_number(texture: Texture) -> Array:
    """A bound, not quite reached where the channels have their maxima in different texels."""
    if isinstance(texture, MeshAttribute):
        return np.float64(texture.scale)
    if isinstance(texture, Checkerboard):
        return np.maximum(_luminance(np.array(texture.a)), _luminance(np.array(texture.b)))
    return _luminance(texture.pixels.max(axis=(0, 1)).astype(np.float64))


def _luminance(channels: Array) -> Array:
    """Of linear RGB, or the one number that is there; the channels are on the first axis."""
    if len(channels) == 1:
        return channels[0]
    return LUMINANCE[0] * channels[0] + LUMINANCE[1] * channels[1] + LUMINANCE[2] * channels[2]


def _placed(texture: ImageTexture | Checkerboard, uv: Array) -> Array:
    """(2, n) the (u', v') of the texture."""
    m = np.reshape(texture.to_uv, (2, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([row[0] * uv[0] + row[1] * uv[1] + row[2] for row in m])


def _first(place: Array) -> Mask:
    """(n,) whether a checkerboard has its first colour there."""
    with np.errstate(invalid="ignore"):
        u, v = place - np.floor(place) > 0.5
    return u == v


def _image(texture: ImageTexture, place: Array) -> Array:
    """(channels, n) of an image."""
    if texture.filter == "nearest":
        height, width = texture.pixels.shape[:2]
        x, y = _scaled(place, width, height)
        return _texel(texture, np.floor(x), np.floor(y))
    (h00, h10, h01, h11), fx, fy = _patch(texture, place)
    return (h00 * (1.0 - fx) + h10 * fx) * (1.0 - fy) + (h01 * (1.0 - fx) + h11 * fx) * fy


def _patch(texture: ImageTexture, place: Array) -> tuple[tuple[Array, Array, Array, Array], Array, Array]:
    """The four texels (channels, n) around points, x first, and where between them the points lie (n,), in [0, 1)."""
    height, width = texture.pixels.shape[:2]
    x, y = _scaled(place, width, height, 0.5)
    left, top = np.floor(x), np.floor(y)
    corners = tuple(_texel(texture, left + i, top + j) for j in (0.0, 1.0) for i in (0.0, 1.0))
    return (corners[0], corners[1], corners[2], corners[3]), x - left, y - top


def _scaled(place: Array, width: int, height: int, less: float = 0.0) -> tuple[Array, Array]:
    """(u' w, v' h), both `less` something; (0, 0) where one of them is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        x, y = place[0] * width - less, place[1] * height - less
    good = np.isfinite(x) & np.isfinite(y)
    return np.where(good, x, 0.0), np.where(good, y, 0.0)


def _texel(texture: ImageTexture, x: Array, y: Array) -> Array:
    """(channels, n) texels of whole numbers (x, y), which may lie outside of the image."""
    height, width = texture.pixels.shape[:2]
    return texture.pixels[_wrapped(y, height, texture.wrap), _wrapped(x, width, texture.wrap)].T.astype(np.float64)


def _wrapped(i: Array, size: int, wrap: str) -> Indices:
    """Indices in [0, size): computed on floats, which may be greater than any integer type."""
    if wrap == "clamp":
        return np.clip(i, 0.0, size - 1.0).astype(np.int64)
    if wrap == "repeat":
        return np.mod(i, float(size)).astype(np.int64)
    around = np.mod(i, 2.0 * size)
    return np.where(around < size, around, 2.0 * size - 1.0 - around).astype(np.int64)
