"""Textures: what engines get of each, and the keys of a scene file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError, suggestion
from engines.scene.attributes import EXPECTED_NAME, FACE, is_attribute
from engines.scene.files import Place
from engines.scene.formats.texture import CHANNELS, linear, read_texels
from engines.scene.geometry import read_only
from engines.scene.triple import Triple, product, triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record, by_name
from engines.schema.kinds import NUMBER, POINT, TEXT, ContextKind, Kind, array_of, color, one_of, within
from engines.schema.yaml_file import Located

__all__ = ["Checkerboard", "Color", "ImageTexture", "MeshAttribute", "Number", "Texture"]

UVMatrix = tuple[float, float, float, float, float, float]
"""Two rows of three: u' = m[0] u + m[1] v + m[2], v' = m[3] u + m[4] v + m[5]."""
IDENTITY: UVMatrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ImageTexture:
    """An image (h, w, 3) or (h, w, 1) float32, read-only: linear RGB, or one number a texel.

    (u, v) become (u', v') by `to_uv`; v' = 0 is the upper edge of the first row. `filter` is "bilinear" or "nearest",
    `wrap` "repeat", "mirror" or "clamp". Where one number is expected, RGB gives its luminance.
    """

    pixels: NDArray[np.float32] = field(repr=False)
    filter: str = "bilinear"
    wrap: str = "repeat"
    to_uv: UVMatrix = IDENTITY
    name: str = "image"


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """Squares of half a unit of (u', v'): `a` where frac(u') > 1/2 equals frac(v') > 1/2, else `b`.

    Where one number is expected, each colour gives its luminance.
    """

    a: Triple = (0.4, 0.4, 0.4)
    b: Triple = (0.2, 0.2, 0.2)
    to_uv: UVMatrix = IDENTITY


@dataclass(frozen=True, slots=True)
class MeshAttribute:
    """The attribute of meshes with this name, times `scale`: "vertex_color" is interpolated, "face_color" one value a face.

    Where one number is expected, three give their luminance.
    """

    name: str
    scale: float = 1.0

    @property
    def of_faces(self) -> bool:
        """Whether faces have it, and not vertices."""
        return self.name.startswith(FACE)


UVTexture = ImageTexture | Checkerboard
"""Looks at texture coordinates."""
Texture = UVTexture | MeshAttribute
Color = Triple | Texture
"""Where a colour is expected."""
Number = float | Texture
"""Where a number is expected."""


def sides(texture: UVTexture) -> tuple[int, int]:
    """Height and width of an image in texels; a checkerboard is square."""
    height, width = texture.pixels.shape[:2] if isinstance(texture, ImageTexture) else (1, 1)
    return height, width


def largest(texture: Texture) -> Triple:
    """The largest value of each channel, held in [0, 1]; of an attribute the largest that a mesh may have."""
    if isinstance(texture, MeshAttribute):
        return triple([min(texture.scale, 1.0)] * 3)
    if isinstance(texture, Checkerboard):
        return triple(min(max(a, b), 1.0) for a, b in zip(texture.a, texture.b, strict=True))
    return triple(np.broadcast_to(texture.pixels.max(axis=(0, 1)).clip(0, 1), 3))


def mean_color(texture: Texture) -> Triple:
    """The mean of each channel over the texels of an image, or over both colours of a checkerboard; less than 0 counts as 0.
    Of an attribute half its scale, whatever meshes have."""
    if isinstance(texture, MeshAttribute):
        return triple([0.5 * texture.scale] * 3)
    if isinstance(texture, Checkerboard):
        return triple(0.5 * (max(x, 0.0) + max(y, 0.0)) for x, y in zip(texture.a, texture.b, strict=True))
    return triple(np.broadcast_to(np.maximum(texture.pixels, 0).mean(axis=(0, 1), dtype=np.float64), 3))


def tinted(texture: Texture, factor: Triple) -> Texture:
    """The texture times a colour, an attribute times a grey; texels in float32."""
    if isinstance(texture, MeshAttribute):
        return replace(texture, scale=texture.scale * factor[0])
    if isinstance(texture, Checkerboard):
        return replace(texture, a=product(texture.a, factor), b=product(texture.b, factor))
    factors = factor[:1] if factor[0] == factor[1] == factor[2] else factor
    return replace(texture, pixels=read_only(texture.pixels * np.array(factors, np.float32)))


def _pair(node: Located, alone: bool) -> tuple[float, float]:
    """Two numbers, or one for both where one may stand `alone`."""
    if alone and not isinstance(node.value, (list, np.ndarray)):
        both = fields.number(node)
        return both, both
    expected = "must be a number, or two" if alone else "must be two numbers"
    first, second = (fields.number(item) for item in fields.several(node, 2, expected))
    return first, second


def _matrix(node: Located) -> UVMatrix:
    """Two rows of three numbers."""
    rows = map(fields.triple, fields.several(node, 2, "must be two rows of three numbers"))
    (a, b, c), (d, e, f) = rows
    return a, b, c, d, e, f


_TWO = array_of(NUMBER.json, 2)
PLACING = {
    "scale": Key(
        Kind(lambda node: _pair(node, alone=True), {"anyOf": [NUMBER.json, _TWO]}),
        "Factor of u and v, or one for each: how often the texture repeats.",
        1,
    ),
    "offset": Key(Kind(lambda node: _pair(node, alone=False), _TWO), "What is added to u and v after scaling.", [0, 0]),
    "to_uv": Key(
        Kind(_matrix, array_of(POINT.json, 2)),
        "Instead of scale and offset, a matrix: u' = m[0] . (u, v, 1), v' = m[1] . (u, v, 1).",
        None,
    ),
}


def _to_uv(given: Given) -> UVMatrix:
    if given["to_uv"] is not None:
        for key in ("scale", "offset"):
            if given.has(key):
                raise given.node.refuse_key(key, "either to_uv, or scale and offset")
        return given["to_uv"]
    (a, b), (c, d) = given["scale"], given["offset"]
    return a, 0.0, c, 0.0, b, d


def _image(given: Given, context: Any) -> ImageTexture:
    node, written, name = given.at("image"), given["color_space"], str(given.node.path[-1])
    images, channel = context.images, given["channel"] or ""
    file = None if isinstance(node.value, np.ndarray) else images.file(node, context.place)
    texels = image_array(node) if file is None else images.texels[file]
    srgb = texels.dtype.kind == "u" if written is None else written == "srgb"
    try:
        pixels = read_only(linear(texels, srgb, channel)) if file is None else images.linear(file, srgb, channel)
    except KeyError:
        raise given.at("channel").refuse("the image has no such channel") from None
    if srgb:
        images.srgb.add(name)
    return ImageTexture(pixels, given["filter"], given["wrap"], _to_uv(given), name)


def image_array(node: Located, channels: int = 0) -> NDArray[Any]:
    """(h, w, c) of an array from Python: uint8, uint16 or finite float32. With `channels` c is that, and numbers are floats."""
    texels, kinds = np.atleast_3d(node.value), "f" if channels else "uf"
    if node.value.ndim not in (2, 3) or texels.shape[2] not in ((channels,) if channels else (1, 2, 3, 4)) or 0 in texels.shape:
        expected = f"(h, w, {channels})" if channels else "(h, w), or (h, w, c) with c from 1 to 4"
        raise node.refuse(f"array {node.value.shape}: must have the shape {expected}")
    if texels.dtype.kind not in kinds or (texels.dtype.kind == "u" and texels.dtype.itemsize > 2):
        raise node.refuse(f"array of {texels.dtype}: must be {'floats' if channels else 'uint8, uint16 or floats'}")
    if texels.dtype.kind == "f":
        with np.errstate(over="ignore"):
            texels = texels.astype(np.float32)
        if not np.isfinite(texels).all():
            raise node.refuse("holds values that are infinite or not a number")
    return texels


IMAGE_FILE = Kind(lambda node: node.value if isinstance(node.value, np.ndarray) else fields.text(node), TEXT.json)
"""The name of an image file as it stands, or an array."""


_IMAGE = Record(
    "An image, from a file or (in Python) an array. v = 0 is its upper edge.",
    {
        "image": Key(
            IMAGE_FILE,
            "File of the image, .png (8 or 16 bit), .jpg, .tga, .bmp, .tif, .webp, .exr, .hdr or .pfm, relative "
            "to the scene's folder.",
        ),
        "color_space": Key(
            one_of(("srgb", "linear", "raw"), "color space"),
            "Whether values are sRGB-encoded, or linear; raw is another word for linear. By default sRGB for 8 and 16 bit, "
            "linear for .exr, .hdr and .pfm.",
            None,
        ),
        "channel": Key(
            one_of(CHANNELS, "channel"), "The one channel that is read, a for alpha; by default all but alpha.", None
        ),
        "filter": Key(one_of(("bilinear", "nearest"), "filter"), "Interpolation between texels.", "bilinear"),
        "wrap": Key(one_of(("repeat", "mirror", "clamp"), "wrap"), "What lies outside of [0, 1].", "repeat"),
        **PLACING,
    },
    _image,
)


def _checkerboard(given: Given, context: Any) -> Checkerboard:
    return replace(given["checkerboard"], to_uv=_to_uv(given))


_SQUARES = Record(
    "The two colours of a checkerboard.",
    {
        "a": Key(color(), "Colour where the halves of u and of v are both upper ones, or both lower ones.", 0.4),
        "b": Key(color(), "Colour of the other squares.", 0.2),
    },
    lambda given, context: Checkerboard(given["a"], given["b"]),
)
_CHECKERBOARD = Record(
    "Squares of half a unit of u and v.", {"checkerboard": Key(_SQUARES, "The two colours."), **PLACING}, _checkerboard
)


def _attribute_name(node: Located) -> str:
    name = fields.text(node)
    if not is_attribute(name):
        raise node.refuse(EXPECTED_NAME)
    return name


_ATTRIBUTE = Record(
    "An attribute of the mesh that shows it, such as the colours of its vertices.",
    {
        "attribute": Key(
            Kind(_attribute_name, TEXT.json),
            "Name: vertex_color is interpolated between the vertices, face_color is one value for each triangle.",
        ),
        "scale": Key(within(0.0, math.inf), "Factor of the attribute.", 1),
    },
    lambda given, context: MeshAttribute(given["attribute"], float(given["scale"])),
)
_KINDS = {"image": _IMAGE, "checkerboard": _CHECKERBOARD, "attribute": _ATTRIBUTE}


def _texture(node: Located, context: Any) -> Texture:
    """A texture, which is of the kind whose key it has."""
    names = ", or ".join(_KINDS)
    if not isinstance(node.value, dict):
        raise node.refuse(f"must be a mapping with {names}")
    kinds = [kind for kind in _KINDS if kind in node.value]
    if len(kinds) != 1:
        for key in node.value:
            if key not in {key for record in _KINDS.values() for key in record.keys}:
                raise node.unknown_key(key, _KINDS)
        raise node.refuse(f"must have either {names}")
    return _KINDS[kinds[0]].read(node, context)


_BY_NAME = by_name(ContextKind(_texture, {"anyOf": [record.schema() for record in _KINDS.values()]}), "textures")


def _textures(node: Located, context: Any) -> None:
    """Textures by names of the user's own, which the context learns before materials are read."""
    context.textures = _BY_NAME.read(node, context)


TEXTURES = ContextKind(_textures, _BY_NAME.schema())


@dataclass(slots=True)
class Images:
    """The image files of a scene: each is read once, and decoded once for each way of reading it.

    `srgb` are the names of the textures that were sRGB-encoded.
    """

    srgb: set[str] = field(default_factory=set)
    texels: dict[Path, NDArray[Any]] = field(default_factory=dict)
    decoded: dict[tuple[Path, bool, str], NDArray[np.float32]] = field(default_factory=dict)

    def file(self, node: Located, place: Place) -> Path:
        """The file that is named at `node`, which has been read. Raises `SceneError`."""
        file = place.find(node, fields.text(node))
        try:
            self.read(file)
        except SceneError as problem:
            raise SceneError(f"{node.where}: {problem}") from problem
        return file

    def read(self, file: Path, data: bytes | None = None) -> NDArray[Any]:
        """(h, w, c) values of a file, or of `data` under that name, as `read_texels` gives them. Raises `SceneError`."""
        if file not in self.texels:
            self.texels[file] = read_texels(file, data)
        return self.texels[file]

    def linear(self, file: Path, srgb: bool | None, channel: str) -> NDArray[np.float32]:
        """Values of a file that has been read as `linear` gives them, read-only. Raises KeyError as `linear`."""
        key = (file, self.texels[file].dtype.kind == "u" if srgb is None else srgb, channel)
        if key not in self.decoded:
            self.decoded[key] = read_only(linear(self.texels[file], srgb, channel))
        return self.decoded[key]


NAMED = {"type": "string", "title": "name of a texture"}


def named_texture(node: Located, context: Any) -> Texture:
    """The texture of the scene that is named here."""
    if not isinstance(node.value, str):
        raise node.refuse("must be the name of a texture")
    if not context.textures:
        raise node.refuse("must be the name of a texture, and the scene has no textures")
    if node.value not in context.textures:
        raise node.refuse(f"unknown texture: {suggestion(node.value, context.textures)}")
    return context.textures[node.value]


def _projected(node: Located, context: Any) -> UVTexture:
    """The texture of the scene that is named here and that a light can show."""
    texture = named_texture(node, context)
    if isinstance(texture, MeshAttribute):
        raise node.refuse("must be an image or a checkerboard: meshes alone have attributes")
    return texture


PROJECTED = ContextKind(_projected, NAMED)


def _textured(constant: Kind) -> ContextKind:
    """What a `constant` kind reads, or the name of a texture."""

    def read(node: Located, context: Any) -> Any:
        if isinstance(node.value, str) and not context.textures:
            raise node.refuse("must be a number or the name of a texture, and the scene has no textures")
        return named_texture(node, context) if isinstance(node.value, str) else constant.read(node)

    return ContextKind(read, {"anyOf": [*constant.json.get("anyOf", [constant.json]), NAMED]})


def textured_color(high: float = math.inf) -> ContextKind:
    """A number for grey, or [r, g, b], each in [0, high], or the name of a texture."""
    return _textured(color(high))


def textured_number(low: float, high: float) -> ContextKind:
    """A number in [low, high], or the name of a texture."""
    return _textured(within(low, high))
