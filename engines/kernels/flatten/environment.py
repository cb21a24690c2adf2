"""The tables of an environment image, for lookup and importance sampling by texel (docs/transport.md)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene import EnvironmentLight


def tables(light: EnvironmentLight) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Of an image (h, w, 3): the image times `radiance`; pdf in (u, v) (h, w); cumulative rows (h,) and columns (h, w),
    each as a share of its total."""
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
    sums = weight.sum(axis=1)
    rows = np.cumsum(sums) / sums.sum()
    with np.errstate(invalid="ignore"):
        columns = np.cumsum(weight, axis=1) / sums[:, None]
    return image, weight * weight.size / weight.sum(), rows, np.where(np.isfinite(columns), columns, 1.0)
