"""The original's "bounding area hierarchy": a box for each ball in (y, z) of the unit direction, for primary rays.

The original has two mistakes, kept here because they are visible at the rims of balls: it divides by sqrt(D^2 - r) where
the tangent's length is sqrt(D^2 - r^2), and its cross product has the wrong sign in y. Boxes shift towards the axis by up to
0.0008. A ball is tried where the direction lies inside its box; the sorted lists of the original decide nothing else.
"""

from __future__ import annotations

import numpy as np

from engines.dahlquist.animation import RADII, REAL, Reals

EVERYWHERE = np.array([-np.inf, np.inf, -np.inf, np.inf], REAL)
"""A box that holds every direction."""


def boxes(centres: Reals) -> Reals:
    """(n, 4) lowest and highest y, lowest and highest z for balls at `centres` (n, 3)."""
    squared = _squared_length(centres.T)
    axis = centres.T / np.sqrt(squared)
    sine = RADII / np.sqrt(squared - RADII)
    squared_cosine = (1.0 - sine.astype(np.float64) ** 2).astype(REAL)
    sides = []
    for k in (1, 2):
        towards = np.zeros((3, 1), REAL)
        towards[k] = 1
        across = _cross(axis, _cross(axis, towards))
        across = across / np.sqrt(_squared_length(across))
        ends = axis[k] * squared_cosine - across[k] * sine, axis[k] * squared_cosine + across[k] * sine
        sides += [np.minimum(*ends), np.maximum(*ends)]
    return np.stack(sides, axis=1)


def _squared_length(a: Reals) -> Reals:
    return (a.astype(np.float64) ** 2).sum(axis=0).astype(REAL)


def _cross(a: Reals, b: Reals) -> Reals:
    """The original's cross product: y has the wrong sign."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[0] * b[2] - a[2] * b[0], a[0] * b[1] - a[1] * b[0]])
