"""Pixels for a canvas: 8-bit RGBA from linear radiance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.film import Film
from engines.tonemap import ToneMapper, tone_mapper


class Tone:
    """A tone mapper that applies an exposure in stops first."""

    def __init__(self, mapper: str = "srgb", exposure: float = 0.0) -> None:
        self.name, self.exposure = mapper, exposure
        self._mapper: ToneMapper = tone_mapper(mapper)

    def __call__(self, radiance: NDArray[Any]) -> NDArray[Any]:
        exposed = radiance * radiance.dtype.type(2.0**self.exposure) if self.exposure else radiance
        return self._mapper(exposed)


def rgba(film: Film, tone: Tone) -> bytes:
    """(height, width, 4) uint8 as bytes. Computed in float32, in half the time of float64; 8 bits show no difference."""
    counts = np.maximum(film.counts, 1).astype(np.float32)[:, :, None]
    mean = film.sums.astype(np.float32)
    mean /= counts
    shown = tone(mean)
    if not np.isfinite(shown.sum()):
        shown = np.nan_to_num(shown, nan=0.0, posinf=1.0, neginf=0.0)
    scaled = np.clip(shown, 0.0, 1.0) * np.float32(255.0)
    scaled += np.float32(0.5)  # the cast truncates
    pixels = np.full((film.height, film.width, 4), 255, np.uint8)
    pixels[:, :, :3] = scaled.astype(np.uint8)
    return pixels.tobytes()


def half_floats(film: Film) -> bytes:
    """(height, width, 3) little-endian float16 of the mean, for views that the page computes."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.clip(film.mean(), -65504, 65504).astype("<f2").tobytes()
