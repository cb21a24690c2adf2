"""The inverse cosine as vector code."""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select


@inline
def arccos(x):
    """In radians, to 2 ulp; x in [-1, 1]. fdlibm's rational approximation of the inverse sine (Sun Microsystems 1993)."""
    one, half, zero = const(1.0, x), const(0.5, x), const(0.0, x)
    size = abs(x)
    small = size < half
    rest = one - size
    z = select(small, x * x, half * select(rest > zero, rest, zero))
    p = const(7.91534994289814532176e-04, x) + z * const(3.47933107596021167570e-05, x)
    p = const(2.01212532134862925881e-01, x) + z * (const(-4.00555345006794114027e-02, x) + z * p)
    p = z * (const(1.66666666666666657415e-01, x) + z * (const(-3.25565818622400915405e-01, x) + z * p))
    q = const(-6.88283971605453293030e-01, x) + z * const(7.70381505559019352791e-02, x)
    q = one + z * (const(-2.40339491173441421878, x) + z * (const(2.02094576023350569471, x) + z * q))
    ratio = p / q
    root = np.sqrt(z)
    far = const(2.0, x) * (root + root * ratio)
    far = select(x < zero, const(math.pi, x) - far, far)
    return select(small, const(math.pi / 2, x) - (x + x * ratio), far)
