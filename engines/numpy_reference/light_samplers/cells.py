"""The choice of a light by the cell of a grid that a point lies in."""

from __future__ import annotations

import numpy as np

from engines.light_cells import STEPS, LightCells
from engines.numpy_reference.light_samplers.plain import ChosenLight
from engines.numpy_reference.vectors import Array, Indices


class SpatialLightSampler:
    """Every cell has probabilities of all lights for each of six sides that a surface may face."""

    def __init__(self, cells: LightCells, learned: bool = False) -> None:
        self.learned = learned
        self._cells = cells

    def choose(self, point: Array, geometric: Array, u: Array) -> ChosenLight:
        count = self._cells.bins.shape[1]
        bin = (u * count).astype(np.int64)
        own_steps, other, of_own, of_other = self._cells.bins[self._row(point, geometric), bin].T
        place, end = u * count - bin, own_steps * count / STEPS
        own = place < end
        with np.errstate(divide="ignore", invalid="ignore"):
            uc = np.where(own, place / end, (place - end) / (1.0 - end))
        return ChosenLight(np.where(own, bin, other), uc, STEPS / np.where(own, of_own, of_other))

    def inverse_pmf(self, light: Indices, point: Array, geometric: Array) -> Array:
        with np.errstate(divide="ignore"):
            return STEPS / self._cells.bins[self._row(point, geometric), light, 2]

    def _row(self, point: Array, geometric: Array) -> Indices:
        """(n,) rows of the probabilities at points (3, n)."""
        cells = self._cells
        last = np.array(cells.row.shape[:3])[:, None] - 1
        place = np.floor((point - cells.low[:, None]) / cells.size)
        x, y, z = np.clip(place, 0, last).astype(np.int64)
        axis = np.abs(geometric).argmax(axis=0)
        positive = geometric[axis, np.arange(axis.size)] > 0.0
        return cells.row[x, y, z, 2 * axis + positive].astype(np.int64)
