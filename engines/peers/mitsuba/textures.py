"""Textures in Mitsuba's terms: raw float32 bitmaps, and its checkerboard. Each stands in a scene once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from engines.peers.mitsuba.nodes import Array, Node, Placing, rgb
from engines.scene import Checkerboard, Color, ImageTexture, Number, Texture, Triple

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


class Textures:
    """The textures that the materials of a scene use: `nodes` by their names at the top of the scene."""

    def __init__(self, placing: Placing) -> None:
        self.nodes: Node = {}
        self._placing = placing
        self._names: dict[Any, tuple[str, Texture]] = {}  # with the texture: an id is its own while it lives

    def color(self, value: Color) -> Node:
        return self._named(value, "color") if is_texture(value) else rgb(value)

    def number(self, value: Number) -> float | Node:
        return self._named(value, "number") if is_texture(value) else float(value)  # type: ignore[arg-type]

    def vector(self, value: ImageTexture) -> Node:
        """Three numbers, of an image with one channel three equal ones."""
        return self._named(value, "vector")

    def _named(self, texture: Any, kind: str) -> Node:
        key = (kind, id(texture) if isinstance(texture, ImageTexture) else texture)
        if key not in self._names:
            name = f"texture_{len(self._names)}"
            self._names[key] = name, texture
            self.nodes[name] = self._node(texture, kind, name)
        return {"type": "ref", "id": self._names[key][0]}

    def _node(self, texture: Texture, kind: str, name: str) -> Node:
        # as in a file, offsets stand in the fourth column: of nine numbers Mitsuba's XML ignores them
        matrix = np.eye(4)
        matrix[:2, [0, 1, 3]] = np.reshape(texture.to_uv, (2, 3))
        if isinstance(texture, Checkerboard):
            a, b = (rgb(texture.a), rgb(texture.b)) if kind == "color" else map(luminance, (texture.b, texture.a))
            # read as numbers, Mitsuba's checkerboard exchanges its colours
            return {"type": "checkerboard", "color0": a, "color1": b, "to_uv": matrix}
        found = self._placing.image(name, pixels(texture, kind))
        return {
            "type": "bitmap",
            **found,
            "raw": True,
            "format": "variant",
            "filter_type": texture.filter,
            "wrap_mode": texture.wrap,
            "to_uv": matrix,
        }


def pixels(texture: ImageTexture, kind: str) -> Array:
    """At least 2 x 2 texels, as Mitsuba resamples smaller images; of a number their luminance, (h, w, 1)."""
    found = texture.pixels
    if kind == "number" and found.shape[2] == 3:
        found = (found @ LUMINANCE)[..., None]
    elif kind == "vector" and found.shape[2] == 1:
        found = np.repeat(found, 3, axis=2)
    for axis in (0, 1):
        found = np.repeat(found, 2, axis=axis) if found.shape[axis] == 1 else found
    return np.ascontiguousarray(found, np.float32)


TEXTURES = (ImageTexture, Checkerboard)


def is_texture(value: Any) -> bool:
    return isinstance(value, TEXTURES)


def luminance(color: Triple) -> float:
    return float(np.dot(LUMINANCE, color))


def largest(value: Color | Number) -> float:
    """The largest component that it has anywhere."""
    if isinstance(value, ImageTexture):
        return float(value.pixels.max())
    return max(*value.a, *value.b) if isinstance(value, Checkerboard) else float(np.max(value))


def least(value: Color | Number) -> float:
    """The least component that it has anywhere."""
    if isinstance(value, ImageTexture):
        return float(value.pixels.min())
    return min(*value.a, *value.b) if isinstance(value, Checkerboard) else float(np.min(value))


def scaled(value: Color, factor: Any) -> Any:
    """A colour times a number, or times three."""
    factors = np.broadcast_to(np.asarray(factor, np.float64), (3,))
    if isinstance(value, ImageTexture):
        wide = factors if value.pixels.shape[2] == 3 or len(set(factors)) > 1 else factors[:1]
        return replace(value, pixels=(value.pixels * wide).astype(np.float32))
    if isinstance(value, Checkerboard):
        return replace(value, a=scaled(value.a, factors), b=scaled(value.b, factors))
    red, green, blue = (float(part * scale) for part, scale in zip(value, factors, strict=True))
    return red, green, blue
