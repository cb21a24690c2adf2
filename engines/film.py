"""The film: per-pixel sums of radiance, from which the mean, its variance and two half-buffers follow.

Everything is float64 and linear RGB; row 0 is the top of the image. Samples of even index also enter the `even` sums,
so that two halves of the image can be compared. Counts are per pixel: a stopped render may leave them unequal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines import memory
from engines.tonemap import ToneMapper, to_bitmap

Image = NDArray[np.float64]

BYTES_A_PIXEL = 3 * 3 * 8 + 8
"""Of a film. An EXR of it takes four images in float64 and in float32 besides, while it is written."""
BYTES_A_PIXEL_WRITTEN = BYTES_A_PIXEL + 4 * 3 * (8 + 4)

Arrays = tuple[Image, Image, Image, NDArray[np.int64]]
"""Sums, squares, even sums (height, width, 3), and counts (height, width)."""


def _zeros(width: int, height: int) -> Arrays:
    """The arrays of a film, all 0, in this process's own memory."""
    colours = (np.zeros((height, width, 3)) for _ in range(3))
    return (*colours, np.zeros((height, width), np.int64))  # type: ignore[return-value]


_allocate: ContextVar[Callable[[int, int], Arrays]] = ContextVar("_allocate", default=_zeros)


@contextmanager
def allocated_by(allocate: Callable[[int, int], Arrays]) -> Iterator[None]:
    """Within, `allocate` makes the arrays of new films, all 0: a process that renders for another one shares their memory."""
    token = _allocate.set(allocate)
    try:
        yield
    finally:
        _allocate.reset(token)


class Film:
    """Accumulates samples of a `height` x `width` image.

    `sums`, `squares` and `even_sums` are (height, width, 3) float64, `counts` is (height, width) int64. Raises
    `ConfigError` where they would not fit into memory.
    """

    def __init__(self, width: int, height: int) -> None:
        memory.require(BYTES_A_PIXEL * width * height, f"a film of {width}x{height} pixels")
        self.width, self.height = width, height
        self.sums, self.squares, self.even_sums, self.counts = _allocate.get()(width, height)
        self.bad_samples = 0
        """Samples that were NaN or infinite; they count as black."""
        self._means = 0  # what `add_mean` was given, from its first mean of several samples on; single samples count too
        self._between: Image = self.squares  # then: the sum of n m^2 over means m of n samples

    def clear(self) -> None:
        """Forgets all samples, keeping the arrays."""
        for array in (self.sums, self.squares, self.even_sums, self.counts):
            array[...] = 0
        self.bad_samples = self._means = 0

    @property
    def spp(self) -> int:
        """Samples that every pixel has."""
        return int(self.counts.min())

    def add(self, samples: Image, pixels: NDArray[np.integer] | None = None) -> None:
        """Adds a sample to each pixel: `samples` (h, w, 3), or (n, 3) with `pixels` (n,) distinct, y * width + x."""
        if self._means:
            raise ValueError("this film holds means of several samples: its squares and halves cannot take single ones")
        samples = np.asarray(samples, np.float64).reshape(-1, 3)
        where = np.arange(self.width * self.height) if pixels is None else np.asarray(pixels)
        good: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(samples), axis=1)
        if not good.all():
            self.bad_samples += int((~good).sum())
            samples = np.where(good[:, None], samples, 0.0)
        counts = self.counts.reshape(-1)
        even = (1 - counts[where] % 2)[:, None]
        self.sums.reshape(-1, 3)[where] += samples
        self.squares.reshape(-1, 3)[where] += samples * samples
        self.even_sums.reshape(-1, 3)[where] += even * samples
        counts[where] += 1

    def add_mean(self, image: Image, spp: int | NDArray[np.integer]) -> None:
        """Adds `image` (h, w, 3), the mean of `spp` samples of every pixel, or of (h, w) numbers of them, none of which is
        known by itself.

        Sums and counts are those of the samples. What they spread is seen between such means alone: `squares` are set so that
        `variance_of_mean` is unbiased from the second mean on, and NaN before; each mean counts as much as it has samples.
        Halves are NaN. As long as every mean is of one sample, all is as with `add`, which cannot follow a mean of several. A
        pixel that is not finite counts as black, and as `spp` bad samples. Raises ValueError.
        """
        image = np.asarray(image, np.float64)
        counts = np.broadcast_to(np.asarray(spp), self.counts.shape)
        low, high = counts.min(), counts.max()
        if image.shape != self.sums.shape or low < 0 or high < 1:
            raise ValueError(
                f"an image of shape {image.shape} and {high} samples: {self.sums.shape} and 1 or more are expected"
            )
        if self._means == 0 and low == high == 1:
            self.add(image)
            return
        if self._means == 0:  # what is there are single samples
            self._means, self._between = self.spp, self.squares.copy()
        good: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(image), axis=2)
        self.bad_samples += int(counts[~good].sum())
        image, weights = np.where(good[:, :, None], image, 0.0), counts[:, :, None]
        self._means += 1
        self._between += weights * image**2
        self.sums += weights * image
        self.counts += counts
        mean, count = self.mean(), self.counts[:, :, None]
        between = np.maximum(self._between - count * mean**2, 0.0) / max(self._means - 1, 1)
        spread = between if self._means > 1 else np.full_like(between, np.nan)
        self.squares[...] = count * mean**2 + (count - 1) * spread
        self.even_sums[...] = np.nan

    def mean(self) -> Image:
        """(height, width, 3) linear radiance; 0 where a pixel has no sample."""
        return self.sums / np.maximum(self.counts, 1)[:, :, None]

    def half(self, index: int) -> Image:
        """The mean of the samples of even (0) or odd (1) index, (height, width, 3)."""
        if index not in (0, 1):
            raise ValueError(f"half {index!r}: 0 or 1 is expected")
        even_counts = (self.counts + 1) // 2
        sums = self.even_sums if index == 0 else self.sums - self.even_sums
        counts = even_counts if index == 0 else self.counts - even_counts
        return sums / np.maximum(counts, 1)[:, :, None]

    def variance_of_mean(self) -> Image:
        """(height, width, 3): the sample variance over the count; NaN below two samples.

        It supposes independent samples; for stratified and quasi-random samplers it is an upper estimate.
        """
        counts = self.counts[:, :, None].astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.maximum(self.squares / counts - (self.sums / counts) ** 2, 0.0)
            return np.where(counts > 1, spread / (counts - 1), np.nan)

    def to_bitmap(self, tone_mapper: str | ToneMapper = "srgb") -> NDArray[np.uint8]:
        """(height, width, 3) uint8. A tone mapper takes linear radiance to display values in [0, 1]."""
        return to_bitmap(self.mean(), tone_mapper)

    def save(
        self, path: str | PathLike[str], provenance: Mapping[str, Any] | None = None, tone_mapper: str | ToneMapper = "srgb"
    ) -> None:
        """Writes `.exr` (float32: colour, variance, both halves; provenance in the header), or 8 bit: `.png` (with provenance),
        `.jpg` (quality 95), `.bmp`, `.tif`, `.webp` (lossless).

        Raises `ConfigError` for other suffixes and for files that cannot be written.
        """
        from engines.image import FilmLayers, write_film_layers, write_image

        if Path(path).suffix.lower() == ".exr":
            layers = FilmLayers(self.mean(), self.variance_of_mean(), self.half(0), self.half(1))
            write_film_layers(path, layers, provenance)
        else:
            write_image(path, self.to_bitmap(tone_mapper), provenance)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False:
            raise ValueError("the mean of a film is a new array: it cannot be given without a copy")
        return self.mean() if dtype is None else self.mean().astype(dtype)

    def _repr_png_(self) -> bytes:
        from engines.image import png_bytes

        return png_bytes(self.to_bitmap())

    def __repr__(self) -> str:
        return f"Film({self.width}x{self.height}, {self.spp} spp)"
