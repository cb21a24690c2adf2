"""A fixed piece of work whose time shows how the machine itself drifts: arithmetic within the cache, then memory."""

from __future__ import annotations

from time import perf_counter

import numpy as np

_CACHED = 1 << 15
_STREAMED = 1 << 21
_ROUNDS = 120


def sentinel_seconds() -> float:
    """Seconds of the work, some 30 ms; never change it, or old traces cannot be compared with new ones."""
    small = np.arange(_CACHED, dtype=np.float64) / _CACHED
    large = np.ones(_STREAMED)
    start = perf_counter()
    for _ in range(_ROUNDS):
        np.sqrt(np.add(np.multiply(small, small, out=small), 0.25, out=small), out=small)
    large[1:] += large[:-1]
    return perf_counter() - start
