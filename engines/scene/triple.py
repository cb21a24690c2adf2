"""Three floats: a point, a direction or a colour in linear RGB."""

from __future__ import annotations

__all__ = ["BLACK", "WHITE", "Triple"]

Triple = tuple[float, float, float]
BLACK: Triple = (0.0, 0.0, 0.0)
WHITE: Triple = (1.0, 1.0, 1.0)
