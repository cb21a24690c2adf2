"""The inverse cosine as vector code."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.target import sqrt


@inline
def arccos(x):
    """In radians, to 2 ulp; x in [-1, 1]. fdlibm's rational approximation of the inverse sine (Sun Microsystems 1993)."""
    size = abs(x)
    small = size < 0.5
    rest = 1.0 - size
    z = select(small, x * x, 0.5 * select(rest > 0.0, rest, 0.0))
    p = 7.91534994289814532176e-04 + z * 3.47933107596021167570e-05
    p = 2.01212532134862925881e-01 + z * (-4.00555345006794114027e-02 + z * p)
    p = z * (1.66666666666666657415e-01 + z * (-3.25565818622400915405e-01 + z * p))
    q = -6.88283971605453293030e-01 + z * 7.70381505559019352791e-02
    q = 1.0 + z * (-2.40339491173441421878 + z * (2.02094576023350569471 + z * q))
    ratio = p / q
    root = sqrt(z)
    far = 2.0 * (root + root * ratio)
    far = select(x < 0.0, math.pi - far, far)
    return select(small, const(math.pi / 2, x) - (x + x * ratio), far)
