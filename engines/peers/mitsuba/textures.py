"""Textures in Mitsuba's terms: raw float32 bitmaps, and its checkerboard. Each stands in a scene once."""

from __future__ import annotations

from typing import Any

import numpy as np

from engines.peers.adapters.colors import LUMINANCE, luminance
from engines.peers.mitsuba.nodes import Array, Node, Placing, rgb
from engines.scene import Checkerboard, Color, ImageTexture, MeshAttribute, Number, Texture
from engines.scene.attributes import Attributes

LUMINANCE_OF = "_as_number"
"""Ends the names of attributes that are the luminance of others."""


class Textures:
    """The textures that materials and lights of a scene use: `nodes` by their names at the top of the scene.

    `read_as_numbers` are the names of attributes whose luminance counts: Mitsuba wants it as an attribute of its own.
    """

    def __init__(self, placing: Placing) -> None:
        self.nodes: Node = {}
        self.read_as_numbers: set[str] = set()
        self._placing = placing
        self._names: dict[Any, tuple[str, Texture]] = {}  # with the texture: an id is its own while it lives

    def color(self, value: Color) -> Node:
        """A colour, or a reference to the texture."""
        return self._named(value, "color") if isinstance(value, Texture) else rgb(value)

    def number(self, value: Number) -> float | Node:
        """A number, or a reference to the texture, of which the luminance counts."""
        return self._named(value, "number") if isinstance(value, Texture) else float(value)  # type: ignore[arg-type]

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

    def attributes_of(self, attributes: Attributes) -> dict[str, Array]:
        """The attributes of a mesh, and the luminance of those that are read as numbers."""
        numbers = {name: values for name, values in attributes.items() if name in self.read_as_numbers}
        return {**attributes, **{name + LUMINANCE_OF: _as_number(values) for name, values in numbers.items()}}

    def _node(self, texture: Texture, kind: str, name: str) -> Node:
        if isinstance(texture, MeshAttribute):
            if kind == "number":
                self.read_as_numbers.add(texture.name)
            shown = texture.name + (LUMINANCE_OF if kind == "number" else "")
            return {"type": "mesh_attribute", "name": shown, "scale": float(texture.scale)}
        # as in a file, offsets stand in the fourth column: of nine numbers Mitsuba's XML ignores them
        matrix = np.eye(4)
        matrix[:2, [0, 1, 3]] = np.reshape(texture.to_uv, (2, 3))
        if isinstance(texture, Checkerboard):
            a, b = (rgb(texture.a), rgb(texture.b)) if kind == "color" else map(luminance, (texture.b, texture.a))
            # read as numbers, Mitsuba's checkerboard exchanges its colours
            return {"type": "checkerboard", "color0": a, "color1": b, "to_uv": matrix}
        placed = self._placing.image(name, pixels(texture, kind))
        return {
            "type": "bitmap",
            **placed,
            "raw": True,
            "format": "variant",
            "filter_type": texture.filter,
            "wrap_mode": texture.wrap,
            "to_uv": matrix,
        }


def _as_number(values: Array) -> Array:
    """(n, 1)"""
    return values if values.shape[1] == 1 else (values @ LUMINANCE)[:, None]


def pixels(texture: ImageTexture, kind: str) -> Array:
    """At least 2 x 2 texels, as Mitsuba resamples smaller images; of a number their luminance, (h, w, 1)."""
    texels = texture.pixels
    if kind == "number" and texels.shape[2] == 3:
        texels = (texels @ LUMINANCE)[..., None]
    elif kind == "vector" and texels.shape[2] == 1:
        texels = np.repeat(texels, 3, axis=2)
    for axis in (0, 1):
        texels = np.repeat(texels, 2, axis=axis) if texels.shape[axis] == 1 else texels
    return np.ascontiguousarray(texels, np.float32)
