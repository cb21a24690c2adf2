"""Media as rows, and which of them lie on the sides of primitives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.rows import MediumRow
from engines.scene import HomogeneousMedium, Shape, singles

NO_BOUNDARY = -1
"""In place of both media of a surface that changes none."""


def medium_rows(media: Sequence[HomogeneousMedium], real: type) -> NDArray[Any]:
    """(m + 1, numbers of a row) in precision `real`; the last is vacuum."""
    most = 1.0 - float(np.finfo(real).epsneg)  # what is nearer to 1 would be rounded to it
    rows = [MediumRow.packed(sigma_t=each.sigma_t, albedo=each.albedo, g=np.clip(each.g, -most, most)) for each in media]
    return np.array([*rows, MediumRow.packed()], real)


def medium_sides(shapes: Sequence[Shape], first_id: Sequence[int], primitives: int, vacuum: int) -> NDArray[np.int32]:
    """(primitives, 2) rows of the media inside and outside; `first_id` are the ids of the first primitives of shapes
    that are no instances, those of groups at the end."""
    counts = np.diff([*first_id, primitives])
    found = singles(shapes)
    sides = np.full((len(found), 2), NO_BOUNDARY, np.int32)
    for row, (_, shape) in zip(sides, found, strict=True):
        if shape.is_boundary:
            row[:] = [vacuum if side is None else side for side in (shape.interior, shape.exterior)]
    return np.repeat(sides, counts, axis=0)
