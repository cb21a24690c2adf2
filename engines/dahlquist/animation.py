"""The scene and how it moves: five balls that follow their targets, and are dragged.

Axes: x is depth, away from the viewer; y is the image's right, z its bottom. Everything is float32, as in the original,
so positions agree with it to the bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

REAL = np.float32
Reals = NDArray[Any]
"""Arrays of float32."""

START = np.array([(950, -80, 10), (880, 80, 100), (880, -40, 120), (805, 50, 120), (880, 20, 170)], REAL)
RADII = np.array([100, 50, 40, 30, 25], REAL)
COLOURS = np.array([(180, 0, 0), (0, 120, 0), (0, 0, 250), (130, 130, 0), (150, 0, 150)], REAL)
"""(5, 3) diffuse colours, 0 to 255."""
FOLLOW = REAL(0.09)
"""Share of the way to its target that a ball moves in each call."""
FOCAL = REAL(2.6)
"""Distance of the image plane, in image widths."""


class Animation:
    """Where the balls are, call after call. They lag behind their targets, so positions depend on the number of calls too."""

    def __init__(self) -> None:
        self.centres: Reals = START.copy()
        """(5, 3)."""
        self._clock = REAL(0)

    def step(self, time_elapsed: int) -> None:
        """One call of the original: time goes on by `time_elapsed` / 3000 and every ball follows."""
        self._clock = REAL(self._clock + REAL(time_elapsed) / REAL(3000))
        self.centres = (REAL(1) - FOLLOW) * self.centres + FOLLOW * _targets(self._clock)

    def drag(self, ball: int, x: float, y: float, width: int) -> None:
        """Puts a ball's centre under pixel (x, y) of an image `width` wide, at the depth where it is."""
        depth = self.centres[ball, 0]
        self.centres[ball, 1] = (REAL(x) / REAL(width) - REAL(0.5)) / FOCAL * depth
        self.centres[ball, 2] = (REAL(y) / REAL(width) - REAL(0.5)) / FOCAL * depth


def _sin(angle: Any) -> np.float32:
    return REAL(math.sin(float(angle)))


def _cos(angle: Any) -> np.float32:
    return REAL(math.cos(float(angle)))


def _targets(f: np.float32) -> Reals:
    """(5, 3) where the balls want to be at time f."""
    r = REAL
    return np.array(
        [
            (r(950) + r(50) * _sin(f / r(70)), r(-80) + r(40) * _sin(f / r(70)), r(10) * _cos(f / r(60))),
            (r(880), r(80) + r(40) * _sin(f / r(34) + r(6)), r(100) - r(90) * _sin(f / r(43))),
            (r(880), r(-40) + r(10) * _sin(f / r(54) + r(5)), r(120) + r(40) * _sin(f / r(30))),
            (r(805), r(50) + r(23) * _sin(f / r(19)), r(120) + r(23) * _cos(f / r(20))),
            (r(880) + r(200) * _sin(f / r(23)), r(20) + r(40) * _cos(f / r(11)), r(170) + r(150) * _cos(f / r(23))),
        ],
        REAL,
    )
