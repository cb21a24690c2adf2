"""Tone mappers: from linear radiance (any shape, RGB last) to display values in [0, 1], sRGB-encoded but for `linear`.

A tone mapper is any callable array -> array; `register` gives one a name.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from engines.errors import ConfigError, UnknownName

ToneMapper = Callable[[NDArray[np.float64]], NDArray[np.float64]]

_BRIGHTEST = 1e30
"""The curves are flat long before; beyond it their quotients overflow to NaN."""


def linear(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """No curve and no encoding: for data such as depth."""
    return np.clip(radiance, 0.0, 1.0)


def srgb(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sRGB transfer function (IEC 61966-2-1), clipped."""
    x = np.clip(radiance, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055)


def reinhard(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """x / (1 + x) a channel (Reinhard et al. 2002, equation 3), then sRGB."""
    x = np.clip(radiance, 0.0, _BRIGHTEST)
    return srgb(x / (1.0 + x))


def aces(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """The filmic fit of the ACES curve by Narkowicz (2015), then sRGB."""
    x = np.clip(radiance, 0.0, _BRIGHTEST)
    return srgb(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14))


TONE_MAPPERS: dict[str, ToneMapper] = {"linear": linear, "srgb": srgb, "reinhard": reinhard, "aces": aces}


def register(name: str, mapper: ToneMapper) -> None:
    """Makes `mapper` available by `name`. Raises `ConfigError` for a name that is taken, and for what is not callable."""
    if not callable(mapper):
        raise ConfigError(f"tone mapper {name!r} = {mapper!r}: a callable from array to array is expected")
    if name in TONE_MAPPERS:
        raise ConfigError(f"tone mapper {name!r} exists already: choose another name")
    TONE_MAPPERS[name] = mapper


def tone_mapper(given: str | ToneMapper) -> ToneMapper:
    """The tone mapper of a name, or the callable itself. Raises `UnknownName` and `ConfigError`."""
    if callable(given):
        return given
    if not isinstance(given, str):
        raise ConfigError(f"tone mapper = {given!r}: a name or a callable from array to array is expected")
    if given not in TONE_MAPPERS:
        raise UnknownName("tone mapper", given, TONE_MAPPERS)
    return TONE_MAPPERS[given]


def to_bitmap(image: NDArray[np.float64], mapper: str | ToneMapper = "srgb") -> NDArray[np.uint8]:
    """Display values of linear radiance (h, w, 3) as uint8, rounded to nearest; NaN becomes 0."""
    image = np.asarray(image, np.float64)
    display = np.asarray(tone_mapper(mapper)(image))
    if display.shape != image.shape:
        raise ConfigError(f"tone mapper {mapper!r}: gave shape {display.shape} for an image of shape {image.shape}")
    return np.rint(255.0 * np.clip(np.nan_to_num(display, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)).astype(np.uint8)
