"""Textures of a glTF file: images within it or beside it, with a sampler and a transform of texture coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.image import MAX_PIXELS
from engines.scene.geometry import read_only
from engines.scene.gltf.document import TO_PNG, Document, extension, integer, mapping, number, numbers, optional, required
from engines.scene.notes import Notes
from engines.scene.textures import IDENTITY, Images, ImageTexture, UVMatrix
from engines.schema.yaml_file import Located

WRAPS = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
NEAREST = 9728
PIXELS_PER_BYTE = 32
"""Pixels of all images, those that materials have changed included, for each byte of the files; `MAX_PIXELS` are free."""
NO_KTX = f"is a KTX2 image, which is not read: {TO_PNG}"

Pixels = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Change:
    """What is done with the pixels of an image; `key` says which it is."""

    key: tuple[Any, ...]
    function: Callable[[Pixels], NDArray[Any]]


@dataclass(slots=True)
class Textures:
    """The textures of a file that have been read. `pixels` counts those of all images."""

    document: Document
    images: Images
    notes: Notes
    pixels: int = 0
    made: dict[tuple[Any, ...], ImageTexture | None] = field(default_factory=dict)
    arrays: dict[tuple[Any, ...], Pixels] = field(default_factory=dict)

    def read(
        self, info: Located, to_uv: UVMatrix, channel: str, srgb: bool, change: Change | None, flat: bool
    ) -> ImageTexture | None:
        """The texture of a `textureInfo`: of linear colours, or one `channel`, with its pixels changed, or, `flat`, one texel
        with their mean; None where the channel is alpha, and the image has none."""
        index = required(info, "index")
        texture = self.document.item("textures", index)
        key = (index.value, channel, srgb, change and change.key, to_uv, flat)
        if key not in self.made:
            made = self._texture(texture, channel, srgb, change, to_uv)
            if made is not None and flat:
                mean = made.pixels.mean(axis=(0, 1), dtype=np.float64, keepdims=True)
                made = replace(made, pixels=read_only(mean.astype(np.float32)))
            self.made[key] = made
        return self.made[key]

    def times(self, place: Located, image: ImageTexture, factor: Any) -> ImageTexture:
        """An image times a number, a colour, or as many pixels."""
        self._count(place, image.pixels)
        pixels = image.pixels * np.asarray(factor, np.float32)
        return replace(image, pixels=read_only(np.ascontiguousarray(pixels)))

    def _texture(
        self, texture: Located, channel: str, srgb: bool, change: Change | None, to_uv: UVMatrix
    ) -> ImageTexture | None:
        file, place = self._image(texture)
        try:
            pixels = self.images.linear(file, srgb, channel)
        except KeyError:
            return None
        if change is not None:
            key = (file, channel, srgb, change.key)
            if key not in self.arrays:
                self._count(place, pixels)
                self.arrays[key] = read_only(np.ascontiguousarray(change.function(pixels), np.float32))
            pixels = self.arrays[key]
        wrap, how = self._sampler(texture)
        return ImageTexture(pixels, how, wrap, to_uv, f"{file.name.partition('.')[0]}_{place.path[-1]}")

    def _image(self, texture: Located) -> tuple[Path, Located]:
        """The name under which the image of a texture has been read, and its place in the file."""
        webp = extension(texture, "EXT_texture_webp")
        source = optional(texture, "source") if webp is None else required(webp, "source")
        if source is None:
            if extension(texture, "KHR_texture_basisu"):
                raise texture.refuse(NO_KTX)
            raise texture.refuse_key("source", "is missing")
        image = self.document.item("images", source)
        name = Path(f"{self.document.file} images[{source.value}]")
        if name in self.images.texels:
            return name, image
        view = optional(image, "bufferView")
        data = self.document.bytes_of(image) if view is None else self.document.view(view)[0]
        if data is None:
            raise image.refuse("has neither uri nor bufferView")
        if bytes(data[:6]) == b"\xabKTX 2":
            raise image.refuse(NO_KTX)
        texels = self.images.read(name, bytes(data))
        self._count(image, texels)
        return name, image

    def _count(self, place: Located, pixels: NDArray[Any]) -> None:
        self.pixels += pixels.shape[0] * pixels.shape[1]
        if self.pixels > max(MAX_PIXELS, PIXELS_PER_BYTE * self.document.held):
            raise place.refuse(f"with those before it has {self.pixels} pixels: more than are read of images of so few bytes")

    def _sampler(self, texture: Located) -> tuple[str, str]:
        named = optional(texture, "sampler")
        if named is None:
            return "repeat", "bilinear"
        sampler = self.document.item("samplers", named)
        s, t = (integer(sampler, key, 10497) for key in ("wrapS", "wrapT"))
        for key, code in (("wrapS", s), ("wrapT", t)):
            if code not in WRAPS:
                raise sampler.refuse_key(key, f"{code}: must be one of {', '.join(map(str, WRAPS))}")
        if s != t:
            self.notes.add("wrapT differs from wrapS, which is taken for both", f"sampler {named.value}")
        return WRAPS[s], "nearest" if integer(sampler, "magFilter", 0) == NEAREST else "bilinear"


def placing(info: Located) -> tuple[int, UVMatrix]:
    """Which set of texture coordinates a texture looks at, and the matrix of KHR_texture_transform: scale, then rotation,
    counter-clockwise in the image, then offset."""
    node, own = extension(mapping(info), "KHR_texture_transform"), integer(info, "texCoord", 0, most=1000)
    if node is None:
        return own, IDENTITY
    (x, y), (u, v) = numbers(node, "offset", (0.0, 0.0)), numbers(node, "scale", (1.0, 1.0))
    angle = number(node, "rotation", 0.0)
    cos, sin = math.cos(angle), math.sin(angle)
    return integer(node, "texCoord", own, most=1000), (cos * u, sin * v, x, -sin * u, cos * v, y)
