"""A film on its way from a worker to its parent, and what must hold of it there: an engine may return anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import RendererFailed
from engines.film import Film, Image
from harness.measure import scratch

COLOURS = ("sums", "squares", "even_sums")
PARTS = (*COLOURS, "counts", "bad_samples")
MOST_BYTES_PER_PIXEL = 256
"""Of the file: three colour arrays and counts take 80 bytes per pixel in float64."""
LARGEST = float(np.finfo(np.float32).max)
"""Image files hold float32."""


def leave(film: Any, path: str | Path, width: int, height: int, spp: int, overshoots: bool = False) -> None:
    """Writes an engine's film into a file. Raises `RendererFailed` where it is not the film of the request, and
    `scratch.Unwritten` where the file cannot be written."""
    lacking = [part for part in PARTS if not hasattr(film, part)]
    if lacking:
        raise RendererFailed(
            f"the engine's render returned {type(film).__name__}, which lacks {', '.join(lacking)}: a Film is expected"
        )
    parts = {part: getattr(film, part) for part in PARTS}
    _refuse_unfit(parts, width, height, spp, overshoots)
    scratch.leave(path, **parts)


def take(path: Path, width: int, height: int, spp: int, overshoots: bool = False) -> Film:
    """The film that a worker left, checked once more: engines share the worker's process and may have changed the file.

    Raises `RendererFailed` where it is not a film of `height` x `width` pixels with `spp` samples each, or more from an engine
    that `overshoots`.
    """
    parts = scratch.take(path, PARTS, width * height * MOST_BYTES_PER_PIXEL, "film")
    if parts["bad_samples"].size == 1:
        parts["bad_samples"] = parts["bad_samples"].item()
    _refuse_unfit(parts, width, height, spp, overshoots)
    film = Film(width, height)
    film.sums, film.squares, film.even_sums = (np.asarray(parts[part], np.float64) for part in COLOURS)
    film.counts, film.bad_samples = np.asarray(parts["counts"], np.int64), int(parts["bad_samples"])
    return film


def _refuse_unfit(parts: Mapping[str, Any], width: int, height: int, spp: int, overshoots: bool) -> None:
    """Raises `RendererFailed` for arrays of another shape or kind, and for counts that are not `spp` everywhere, or less than
    that."""
    for name in COLOURS:
        _refuse_array(name, parts[name], (height, width, 3), np.floating, "floating-point numbers")
    counts = parts["counts"]
    _refuse_array("counts", counts, (height, width), np.integer, "integers")
    low, high = int(counts.min()), int(counts.max())
    if low < spp or (high > spp and not overshoots):
        found = str(low) if low == high else f"{low} to {high}"
        raise RendererFailed(f"the engine's film.counts are {found}: {spp} is expected, the samples requested")
    bad = parts["bad_samples"]
    if isinstance(bad, bool) or not isinstance(bad, Integral) or int(bad) < 0:
        raise RendererFailed(f"the engine's film.bad_samples is {bad!r}: an integer from 0 on is expected")


def _refuse_array(name: str, found: Any, shape: tuple[int, ...], kind: type, words: str) -> None:
    if not isinstance(found, np.ndarray):
        raise RendererFailed(f"the engine's film.{name} is of type {type(found).__name__}: a NumPy array is expected")
    if found.shape != shape:
        raise RendererFailed(f"the engine's film.{name} is of shape {found.shape}: {shape} is expected")
    if not np.issubdtype(found.dtype, kind):
        raise RendererFailed(f"the engine's film.{name} is of dtype {found.dtype}: {words} are expected")


def image_of(film: Film) -> Image:
    """(height, width, 3) linear radiance of a film; what image files cannot hold (float32) is infinite."""
    mean = film.mean()
    return np.where(abs(mean) > LARGEST, np.copysign(np.inf, mean), mean)


def claimed_variance(film: Film) -> float | None:
    """What the spread of a film's samples says of the variance of its pixels, averaged over pixels and channels; None for one
    sample, and where the engine knows no spread."""
    variance = float(film.variance_of_mean().mean())
    return variance if math.isfinite(variance) else None


def bad_pixels(image: NDArray[np.float64]) -> int:
    """Pixels with a channel that is NaN or infinite."""
    return int((~np.isfinite(image).all(axis=2)).sum())
