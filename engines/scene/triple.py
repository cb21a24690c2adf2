"""Three floats: a point, a direction or a colour in linear RGB."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

__all__ = ["BLACK", "WHITE", "Triple"]

Triple = tuple[float, float, float]
BLACK: Triple = (0.0, 0.0, 0.0)
WHITE: Triple = (1.0, 1.0, 1.0)


def triple(values: Iterable[Any]) -> Triple:
    """Three numbers of any type, such as a row of an array, as floats."""
    x, y, z = map(float, values)
    return x, y, z


def product(color: Triple, factor: Triple | float) -> Triple:
    """A colour times another one, or times a number."""
    factors = factor if isinstance(factor, tuple) else (factor,) * 3
    return color[0] * factors[0], color[1] * factors[1], color[2] * factors[2]
