"""The angle of a point in the plane as vector code."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select


@inline
def arctan2(y, x):
    """In radians, in [-pi, pi], to 2 ulp; of zeros, with their signs, as IEEE 754 has it. Rational
    approximation of Moshier's Cephes library (1995)."""
    zero, one, half_turn = const(0.0, x), const(1.0, x), const(math.pi, x)
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    low, high = select(steep, ax, ay), select(steep, ay, ax)
    far = low > high * const(0.41421356237309503, x)
    over = select(far, low + high, high)
    t = select(far, low - high, low) / select(over > zero, over, one)
    z = t * t
    p = const(-16.15753718733365076637, x) + z * const(-0.8750608600031904122785, x)
    p = const(-122.8866684490136173410, x) + z * (const(-75.00855792314704667340, x) + z * p)
    p = const(-64.85021904942025371773, x) + z * p
    q = const(165.0270098316988542046, x) + z * (const(24.85846490142306297962, x) + z)
    q = const(485.3903996359136964868, x) + z * (const(432.8810604912902668951, x) + z * q)
    q = const(194.5506571482613964425, x) + z * q
    angle = t + t * (z * p / q)
    angle = select(far, angle + const(math.pi / 4, x), angle)
    angle = select(steep, const(math.pi / 2, x) - angle, angle)
    angle = select(math.copysign(one, x) < zero, half_turn - angle, angle)
    return math.copysign(angle, y)
