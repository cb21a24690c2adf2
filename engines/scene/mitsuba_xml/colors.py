"""Colours: `rgb`, `srgb`, `spectrum`, `blackbody` and `float` as linear RGB."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from engines.input_files import open_regular, unreadable
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.properties import number_of
from engines.scene.mitsuba_xml.spectra import FLAT_SPECTRUM, rgb_of_black_body, rgb_of_samples
from engines.scene.mitsuba_xml.transforms import number, numbers
from engines.scene.triple import Triple, product, triple

REFLECTANCE, EMISSION, INDEX = "reflectance", "emission", "index"
"""What a colour is for: a share in [0, 1], light, or an index of refraction."""
MAX_SAMPLES = 10_000
MAX_BYTES = 2**20
"""Of a file with a spectrum."""
HOTTEST = 1e6
"""Kelvin."""
_HEX = re.compile(r"#([0-9a-fA-F]{6})")


def color(element: Element, role: str) -> Triple:
    """The colour of an element. Raises `SceneError` with its line."""
    return checked_color(element, _values(element, role), role)


def checked_color(element: Element, values: Triple, role: str) -> Triple:
    """The values, which an element gives. Raises `SceneError` for negative ones, and for shares above 1."""
    if min(values) < 0.0:
        raise element.refuse_value("must not be negative")
    if role == REFLECTANCE and max(values) > 1.0 + 1e-6:
        raise element.refuse_value("must lie in [0, 1], as it is a share of light")
    return _held(values, role)


def _held(values: Triple, role: str) -> Triple:
    """The values, at most 1 where they are shares of light."""
    return triple(min(x, 1.0) for x in values) if role == REFLECTANCE else values


def _values(element: Element, role: str) -> Triple:
    tag, text = element.tag, element.attributes.get("value", "").strip()
    if tag in ("float", "integer"):
        grey = number_of(element)
        return grey, grey, grey
    if tag == "spectrum":
        return _spectrum(element, text, role)
    if tag == "blackbody" and role == EMISSION:
        return _black_body(element)
    if tag not in ("rgb", "srgb"):
        raise element.refuse("a colour is expected: <rgb>, <srgb>, <spectrum> or <float>")
    if hexadecimal := _HEX.fullmatch(text):
        code = int(hexadecimal[1], 16)
        return _linear((code >> 16) / 255.0, (code >> 8 & 255) / 255.0, (code & 255) / 255.0)
    r, g, b = _three(element)
    return _linear(r, g, b) if tag == "srgb" else (r, g, b)


def _three(element: Element) -> Triple:
    values = numbers(element, "value", (1, 3))
    return triple(values * 3 if len(values) == 1 else values)


def _linear(*encoded: float) -> Triple:
    """Linear RGB of sRGB values."""
    return triple(x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in encoded)


def _spectrum(element: Element, text: str, role: str) -> Triple:
    """One number is a flat spectrum, which is white as a reflectance and a little red as light; three are RGB."""
    if "filename" in element.attributes:
        text = _file_text(element)
        return of_samples(_samples(replace(element, attributes={**element.attributes, "value": text}), text), role)
    if ":" in text:
        return of_samples(_samples(element, text), role)
    if role == EMISSION and len(re.split(r"[,\s]+", text)) == 1:
        return product(_three(element), FLAT_SPECTRUM)
    return _three(element)


def _file_text(element: Element) -> str:
    """`wavelength:value` of each line of the file that an element names; what follows a # is a remark."""
    try:
        with open_regular(element.attributes["filename"]) as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as problem:
        raise element.refuse(f"{element.attributes['filename']}: {unreadable(problem)}") from problem
    if len(data) > MAX_BYTES:
        raise element.refuse(f"{element.attributes['filename']}: has more than {MAX_BYTES // 2**20} MiB")
    lines = data.decode("latin-1").splitlines()
    return ", ".join(":".join(words) for line in lines if (words := line.split("#")[0].split()))


def of_samples(samples: np.ndarray, role: str) -> Triple:
    """The colour of (2, n) growing wavelengths and values."""
    return _held(triple(max(0.0, x) for x in rgb_of_samples(samples, role == EMISSION)), role)


def of_black_body(kelvin: float, scale: float) -> Triple:
    """The light of a black body."""
    return product(rgb_of_black_body(kelvin), scale)


def _black_body(element: Element) -> Triple:
    """`<blackbody temperature="3000K" scale="2"/>` of Mitsuba 0.x."""
    text = element.required("temperature").strip()
    try:
        kelvin, scale = number(text.removesuffix("K")), number(element.attributes.get("scale", "1"))
    except ValueError:
        kelvin = scale = -1.0
    if not (0.0 < kelvin <= HOTTEST and scale >= 0.0):
        raise element.refuse(f"temperature must lie in (0, {HOTTEST:g}] K, and scale must not be negative")
    return of_black_body(kelvin, scale)


def _samples(element: Element, text: str) -> np.ndarray:
    """(2, n) wavelengths in nanometres, growing, and values."""
    pairs = [pair.split(":") for pair in re.split(r"[,\s]+", re.sub(r"\s*:\s*", ":", text)) if pair]
    try:
        if not 2 <= len(pairs) <= MAX_SAMPLES:
            raise ValueError
        table = np.array([[number(word) for word in pair] for pair in pairs]).T
        if table.shape != (2, len(pairs)) or not (np.diff(table[0]) > 0.0).all():
            raise ValueError
    except ValueError:
        raise element.refuse_value("must be pairs wavelength:value with growing wavelengths, two at least") from None
    return table
