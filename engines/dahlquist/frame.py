"""One frame: its pixels with the flag in alpha, and what a call draws into it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.dahlquist.animation import Reals
from engines.dahlquist.pictures import Picture

Frame = NDArray[np.uint8]
"""(height, width, 4) red, green, blue, and a flag where others have alpha."""

SPHERE = 255
"""Flag of a pixel that shows a ball. It is drawn in every call; so is one whose flag is 255 because it was cleared."""
BACKGROUND = 254
"""Flag of a pixel that shows the background already: it is left as it is."""
DARK = (10, 10, 15)
"""The background while the environment is switched off."""


class View(NamedTuple):
    """What a call draws: rows first_row, first_row + row_step, ... of balls at `centres` (5, 3), each seen by primary rays
    inside its box of the area hierarchy alone (`boxes` (5, 4)). Without `environment` mirrors and background are dark."""

    centres: Reals
    boxes: Reals
    environment: bool
    reflections: bool
    first_row: int
    row_step: int


class Pictures(NamedTuple):
    """What mirrors and misses show."""

    probe: Picture
    background: Picture
