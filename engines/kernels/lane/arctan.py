"""The angle of a point in the plane as vector code."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select


@inline
def arctan2(y, x):
    """In radians, in [-pi, pi], to 2 ulp; of zeros, with their signs, as IEEE 754 has it. Rational
    approximation of Moshier's Cephes library (1995)."""
    one, half_turn = const(1.0, x), const(math.pi, x)
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    low, high = select(steep, ax, ay), select(steep, ay, ax)
    far = low > high * 0.41421356237309503
    over = select(far, low + high, high)
    t = select(far, low - high, low) / select(over > 0.0, over, one)
    z = t * t
    p = -16.15753718733365076637 + z * -0.8750608600031904122785
    p = -122.8866684490136173410 + z * (-75.00855792314704667340 + z * p)
    p = -64.85021904942025371773 + z * p
    q = 165.0270098316988542046 + z * (24.85846490142306297962 + z)
    q = 485.3903996359136964868 + z * (432.8810604912902668951 + z * q)
    q = 194.5506571482613964425 + z * q
    angle = t + t * (z * p / q)
    angle = select(far, angle + const(math.pi / 4, x), angle)
    angle = select(steep, const(math.pi / 2, x) - angle, angle)
    angle = select(math.copysign(one, x) < 0.0, half_turn - angle, angle)
    return math.copysign(angle, y)
