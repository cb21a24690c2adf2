"""The tables of an environment image, for lookup and importance sampling by texel (docs/transport.md)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.layout import RUN
from engines.kernels.rows import EnvironmentRow
from engines.scene import EnvironmentLight

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def is_turned(light: EnvironmentLight | None) -> bool:
    """Whether the light has an image, and that is rotated."""
    return light is not None and light.image is not None and light.rotation != IDENTITY


def place_row(light: EnvironmentLight) -> NDArray[np.float64]:
    """The row (1, n) of `SceneTable.environment_map` of an image."""
    assert light.image is not None
    height, axes = len(light.image), np.transpose(light.rotation)
    rows, first = (height - 1.0, 0.0) if light.rows == "poles" else (float(height), 0.5)
    return np.array([EnvironmentRow.packed(rows=rows, first_row=first, x=axes[0], y=axes[1], z=axes[2])])


class Tables(NamedTuple):
    """An image (h, w, 3), and how its texels are chosen: a row, then a run of `RUN` texels in it, then one of the run. All
    sums are those of the densities as they are stored, so that each texel is chosen with its density."""

    texels: NDArray[Any]
    """(h, w, 3) times the light's radiance."""
    pdf: NDArray[Any]
    """(h, w) in (u, v)."""
    rows: NDArray[np.float64]
    """(h,) cumulative, as shares."""
    runs: NDArray[np.float64]
    """(h, w / RUN, rounded up) of each row cumulative sums of densities."""


def guides(values: NDArray[np.float64], dtype: type) -> NDArray[Any]:
    """Where searches in cumulative rows (m, n) begin, (m, n): of each row, for each k the first value above k/n of the last.

    What lies a rounding error below k/n counts, too, as the entry of a number u is the integer part of u n, rounded.
    """
    n = values.shape[1]
    marks = np.arange(n) / n * (1 - 1e-12)
    found = [np.searchsorted(row, marks * row[-1], side="right") for row in values]
    return np.minimum(np.array(found), n - 1).astype(dtype)


def tables(light: EnvironmentLight, real: Any) -> Tables:
    """The tables of an image in the precision of the batch."""
    assert light.image is not None
    image = np.asarray(light.image, np.float64) * np.asarray(light.radiance)
    height = image.shape[0]
    grey = image.mean(axis=2)
    tall = np.concatenate([grey[:1], grey, grey[-1:]])
    tall = tall[:-2] + tall[1:-1] + tall[2:]
    weight = (np.roll(tall, 1, axis=1) + tall + np.roll(tall, -1, axis=1)) / 9
    weight = weight * np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]
    if not weight.sum() > 0:  # a black image: any density will do
        weight = np.ones_like(weight)
    pdf = (weight / weight.sum() * weight.size).astype(real)
    starts = np.arange(0, pdf.shape[1], RUN)
    runs = np.cumsum(np.add.reduceat(pdf.astype(np.float64), starts, axis=1), axis=1)
    rows = np.cumsum(runs[:, -1])
    return Tables(image.astype(real), pdf, rows / rows[-1], runs)
