"""Choosing from a list in proportion to weights, by inversion of their cumulative sums."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import Array, Indices

BELOW_ONE = 1.0 - 2.0**-53
"""The largest number below 1."""


def shares(weight: Array) -> Array:
    """Cumulative sums over the last axis as shares of their total; 1 where the total is 0."""
    sums = np.cumsum(weight, axis=-1)
    with np.errstate(invalid="ignore"):
        return np.where(sums[..., -1:] > 0.0, sums / sums[..., -1:], 1.0)


def first_above(table: Array, start: Indices, size: Indices, u: Array) -> Indices:
    """(n,) the first index whose share exceeds `u`, in the list of `size` shares that begins at `start` of `table`."""
    low, high = np.zeros_like(start), size - 1
    for _ in range(int(size.max(initial=1)).bit_length()):
        middle = (low + high) // 2
        above = table[start + middle] > u
        high = np.where(above, middle, high)
        low = np.where(above, low, np.minimum(middle + 1, high))
    return low


def rest(table: Array, start: Indices, index: Indices, u: Array) -> Array:
    """(n,) where in [0, 1] the draw falls inside the interval that it chose."""
    end = table[start + index]
    begin = np.where(index > 0, table[start + index - 1], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(end > begin, (u - begin) / (end - begin), 0.0)


def last_begun(weight: Array, u: Array) -> tuple[Indices, Array, Array]:
    """(n,) the last of k choices that has a `weight` (k, n) above 0 and begins at or before `u` times the sum of all; the first
    one, where none has. Where it begins (n,), and the sum (n,)."""
    ends = np.cumsum(weight, axis=0)
    begins = np.vstack([np.zeros(u.size), ends[:-1]])
    eligible = (weight > 0.0) & (begins <= u * ends[-1])
    index = np.where(eligible, np.arange(len(weight))[:, None], 0).max(axis=0)
    return index, np.take_along_axis(begins, index[None], axis=0)[0], ends[-1]
