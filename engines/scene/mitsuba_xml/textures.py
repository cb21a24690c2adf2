"""Textures, and the colours and numbers that may be textures."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from engines.scene.attributes import EXPECTED_NAME, is_attribute
from engines.scene.geometry import read_only
from engines.scene.mitsuba_xml.colors import EMISSION, HOTTEST, REFLECTANCE, checked_color, color, of_black_body, of_samples
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.textures import IDENTITY, Checkerboard, Color, ImageTexture, MeshAttribute, Number, Texture, UVMatrix, tinted
from engines.scene.triple import BLACK, WHITE, Triple, product

FILTERS = {"bilinear": "bilinear", "nearest": "nearest", "trilinear": "bilinear", "ewa": "bilinear"}
VECTORS = ("vector", "point")
WRAPS = ("repeat", "mirror", "clamp")
HARMLESS = ("accel", "format", "cache", "max_anisotropy", "bitmap_cache")


def color_or_texture(importer: Importer, plugin: Plugin, *names: str, default: Triple, role: str = REFLECTANCE) -> Color:
    """The colour of a property, or the texture that stands for it; several names are older names of the same property."""
    for name in names:
        if (nested := importer.named(plugin, name)) is not None:
            return texture(importer, nested, role)
    element = plugin.spectrum(*names)
    return default if element is None else color(element, role)


def number_or_texture(
    importer: Importer, plugin: Plugin, *names: str, default: float, low: float = 0.0, high: float = 1.0
) -> Number:
    """The number of a property, or the texture that stands for it. A colour gives its mean."""
    for name in names:
        if (nested := importer.named(plugin, name)) is not None:
            made = texture(importer, nested)
            if nested.type == "rawconstant" and nested.values["value"].tag in VECTORS:
                raise nested.refuse("a number is expected here, not a vector")
            if not isinstance(made, tuple):
                return _as_number(made)
            return _checked(nested, sum(made) / 3.0, low, high)
    element = plugin.spectrum(*names)
    if element is not None and element.tag in ("rgb", "srgb", "spectrum"):
        return _checked(plugin, sum(color(element, REFLECTANCE)) / 3.0, low, high)
    return plugin.number(*names, default=default, low=low, high=high)


def _checked(plugin: Plugin, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise plugin.refuse(f"{value:g}: must lie in [{low:g}, {high:g}]")
    return value


def _as_number(made: Texture) -> Texture:
    """Read as a number, Mitsuba's checkerboard has its two colours exchanged."""
    return dataclasses.replace(made, a=made.b, b=made.a) if isinstance(made, Checkerboard) else made


def texture(importer: Importer, plugin: Plugin, role: str = REFLECTANCE) -> Texture | Triple:
    """The texture of a plugin, or its colour where it is one everywhere. The same plugin gives the same object."""
    key = (id(plugin), "texture", role)
    if key not in importer.built:
        if plugin.kind not in ("texture", "spectrum"):
            raise plugin.refuse("a texture is expected here")
        make = TEXTURES.get(plugin.type)
        if make is None:
            raise plugin.refuse(REFUSED.get(plugin.type, f"unknown texture: known: {', '.join(TEXTURES)}"))
        importer.enter(plugin)
        importer.built[key] = make(importer, plugin, role)
        importer.leave(plugin)
    return importer.built[key]


def image_texture(importer: Importer, plugin: Plugin, role: str = REFLECTANCE) -> ImageTexture:
    """The image of a plugin whose gradient or texels are expected. Raises `SceneError` for anything else."""
    made = texture(importer, plugin, role)
    if plugin.type == "rawconstant" and isinstance(made, tuple):
        return ImageTexture(read_only(np.array(made, np.float32).reshape(1, 1, 3)), name=plugin.label)
    if not isinstance(made, ImageTexture):
        raise plugin.refuse("an image is expected here: a bitmap texture")
    return made


# ---- bitmap ----------------------------------------------------------------------------------------------------------


def _bitmap(importer: Importer, plugin: Plugin, role: str) -> ImageTexture:
    named = plugin.file("filename")
    if plugin.has("bitmap", "data"):
        raise plugin.refuse("an image from a file is expected")
    plugin.read.update(HARMLESS)
    raw, gamma = plugin.boolean("raw", default=False), plugin.number("gamma", default=-1.0)
    channel = plugin.text("channel", default="", known=("", "r", "g", "b", "a", "all")) or ""
    pixels, name = _pixels(importer, named, raw or gamma > 0.0, "" if channel == "all" else channel)
    if gamma > 0.0 and gamma != 1.0:
        pixels = read_only(np.power(np.maximum(pixels, 0.0), np.float32(gamma)))
    kind = plugin.text("filter_type", "filter", default="bilinear", known=FILTERS) or ""
    if kind != FILTERS[kind]:
        importer.notes.add(f"filter_type {kind} of a texture is taken as {FILTERS[kind]}", plugin.element)
    return ImageTexture(pixels, FILTERS[kind], _wrap(plugin), _to_uv(importer, plugin), name)


def _pixels(importer: Importer, named: Element, raw: bool, channel: str) -> tuple[NDArray[np.float32], str]:
    """(h, w, 3) or (h, w, 1) linear, read-only, and the name of the file; the same file read in the same way is one array."""
    images = importer.reader.images
    file = images.file(named.located(named.attributes["value"]), importer.place)
    srgb = images.texels[file].dtype.kind == "u" and not raw
    try:
        return images.linear(file, srgb, channel), file.name
    except KeyError:
        raise named.refuse_value(f"the image has no channel {channel!r}") from None


def _wrap(plugin: Plugin) -> str:
    mode = plugin.text("wrap_mode", default="repeat", known=WRAPS) or ""
    both = [plugin.text(name, default=mode, known=WRAPS) or "" for name in ("wrap_mode_u", "wrap_mode_v")]
    if both[0] != both[1]:
        raise plugin.refuse_property("wrap_mode_v", "must equal wrap_mode_u")
    return both[0]


def _to_uv(importer: Importer, plugin: Plugin) -> UVMatrix:
    """`to_uv`, or the scale and offset of older files."""
    if plugin.has("to_uv"):
        matrix = plugin.transform("to_uv")
        a, b, c = (float(x) for x in matrix[0, [0, 1, 3]])
        d, e, f = (float(x) for x in matrix[1, [0, 1, 3]])
        return a, b, c, d, e, f
    both = plugin.number("uvscale", "uv_scale", default=1.0)
    su, sv = (plugin.number(name, default=both) for name in ("uscale", "vscale"))
    ou, ov = (plugin.number(name, default=0.0) for name in ("uoffset", "voffset"))
    if (ou and su != 1.0) or (ov and sv != 1.0):
        importer.notes.add("scale and offset of a texture mean scale (uv + offset), as in Mitsuba 3", plugin.element)
    return IDENTITY if (su, sv, ou, ov) == (1.0, 1.0, 0.0, 0.0) else (su, 0.0, su * ou, 0.0, sv, sv * ov)


# ---- others ----------------------------------------------------------------------------------------------------------


def _checkerboard(importer: Importer, plugin: Plugin, role: str) -> Checkerboard:
    colors: list[Triple] = []
    for name, default in (("color0", Checkerboard().a), ("color1", Checkerboard().b)):
        square = color_or_texture(importer, plugin, name, default=default, role=role)
        if not isinstance(square, tuple):
            raise plugin.refuse(f"{name}: a colour is expected, not a texture")
        colors.append(square)
    plugin.read.add("line_width")
    return Checkerboard(colors[0], colors[1], _to_uv(importer, plugin))


def _scaled(importer: Importer, plugin: Plugin, role: str) -> Texture | Triple:
    """A texture of Mitsuba 0.x: another one times a number or a colour."""
    inner = importer.taken(plugin, "texture", "spectrum")
    if len(inner) != 1:
        raise plugin.refuse("one nested texture is expected")
    scaled, element = texture(importer, inner[0], role), plugin.spectrum("scale", "value")
    factor = WHITE if element is None else color(element, "factor")
    if isinstance(scaled, MeshAttribute) and len(set(factor)) > 1:
        raise plugin.refuse("an attribute of meshes is scaled by a number, not by a colour")
    return product(scaled, factor) if isinstance(scaled, tuple) else tinted(scaled, factor)


def _mesh_attribute(importer: Importer, plugin: Plugin, role: str) -> MeshAttribute:
    """The `vertexcolors` of Mitsuba 0.x have no name."""
    name = "vertex_color" if plugin.type == "vertexcolors" else plugin.text("name")
    if name is None or not is_attribute(name):
        raise plugin.refuse(f"name: {EXPECTED_NAME}")
    made = MeshAttribute(name, plugin.number("scale", default=1.0, low=0.0))
    importer.reader.textures[name] = made
    return made


def _constant(importer: Importer, plugin: Plugin, role: str) -> Triple:
    element = plugin.spectrum("color", "value")
    if element is None:
        raise plugin.refuse("the property 'color' or 'value' is missing")
    return color(element, role)


def _raw_constant(importer: Importer, plugin: Plugin, role: str) -> Triple:
    """A number for all channels, or a vector."""
    element = plugin.spectrum("value")
    if element is None or element.tag not in ("float", "integer", *VECTORS):
        raise plugin.refuse("value: a <float> or a <vector> is expected")
    if element.tag in VECTORS:
        return checked_color(element, plugin.point("value") or BLACK, role)
    return color(element, role)


def _volume(importer: Importer, plugin: Plugin, role: str) -> Triple:
    """A volume that is one colour everywhere."""
    volume = importer.named(plugin, "volume")
    if volume is None or volume.kind != "volume":
        raise plugin.refuse("a nested volume is expected, of the name 'volume'")
    if volume.type != "constvolume":
        raise volume.refuse("volumes that vary are not supported: use constvolume, or a bitmap in place of the texture")
    made = color_or_texture(importer, volume, "value", default=WHITE, role=role)
    if not isinstance(made, tuple):
        raise volume.refuse("value: a colour is expected, not a texture")
    volume.read.add("to_world")
    importer.finish(volume)
    return made


def _d65(importer: Importer, plugin: Plugin, role: str) -> Triple:
    """White, as in the RGB variants of Mitsuba 3."""
    grey = plugin.number("scale", default=1.0, low=0.0, high=1.0 if role == REFLECTANCE else math.inf)
    return grey, grey, grey


def _black_body(importer: Importer, plugin: Plugin, role: str) -> Triple:
    if role != EMISSION:
        raise plugin.refuse("a black body is a light: give rgb")
    kelvin = plugin.number("temperature", default=6500.0, low=1.0, high=HOTTEST)
    return of_black_body(kelvin, plugin.number("scale", default=1.0, low=0.0))


def _sampled(importer: Importer, plugin: Plugin, role: str) -> Triple:
    """`irregular` has its wavelengths; those of `regular` lie between two at equal steps."""
    values = plugin.numbers("values")
    if plugin.type == "irregular":
        wavelengths = plugin.numbers("wavelengths")
    else:
        least, most = plugin.number("wavelength_min", default=360.0), plugin.number("wavelength_max", default=830.0)
        wavelengths = np.linspace(least, most, len(values)).tolist()
    growing = len(wavelengths) == len(values) >= 2 and (np.diff(wavelengths) > 0.0).all()
    if not growing or min(values) < 0.0:
        raise plugin.refuse("two values at least are expected, none below 0, of as many wavelengths that grow")
    return of_samples(np.array([wavelengths, values]), role)


TEXTURES = {
    "bitmap": _bitmap,
    "checkerboard": _checkerboard,
    "mesh_attribute": _mesh_attribute,
    "vertexcolors": _mesh_attribute,
    "scale": _scaled,
    "srgb": _constant,
    "uniform": _constant,
    "rawconstant": _raw_constant,
    "volume": _volume,
    "d65": _d65,
    "blackbody": _black_body,
    "regular": _sampled,
    "irregular": _sampled,
}
REFUSED = {
    "wireframe": "is not supported: bake it into a bitmap",
    "gridtexture": "is not supported: bake it into a bitmap",
    "curvature": "is not supported: bake it into a bitmap",
}
