"""Texture coordinates of a point of a shape, in float64 (docs/transport.md)."""

from __future__ import annotations

import math
from typing import NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.vec3 import Vec3


class Coordinates(NamedTuple):
    """(u, v), and the derivatives of the point by them."""

    u: float
    v: float
    dp_du: Vec3
    dp_dv: Vec3


@inline
def turn_of(y, x):
    """atan2(y, x) in [0, 2 pi)."""
    phi = math.atan2(y, x)
    return phi + 2.0 * math.pi if phi < 0.0 else phi
