"""Elementary functions as vector code, to a few ulp of either precision.

Coefficients of the exponential, the logarithm and the error function are interpolations at Chebyshev nodes, made in 50 digits,
of truncation errors below 2e-17.
"""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, exponent_of, mantissa_of, polynomial, power_of_two, select
from engines.kernels.lane.target import floor, sqrt


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


LOWEST = -87.0
"""exp of what lies below is 0: so near to it are the smallest normal numbers of float32."""
LARGEST_ERROR_ARGUMENT = 6.0
"""erf is 1 from here on, in float64."""

_LN2_HIGH, _LN2_LOW = 0.693359375, -2.121944400546905827679e-4  # the first has few bits: its multiples are exact

_exp = polynomial(
    1.0,
    1.0,
    0.5000000000000019,
    0.1666666666666668,
    0.0416666666664881,
    0.008333333333319601,
    0.0013888888952314775,
    0.00019841269890047113,
    2.4801485482328494e-05,
    2.755724091857897e-06,
    2.763263963904103e-07,
    2.5110037605963777e-08,
)
_log = polynomial(
    0.666666666666667,
    0.39999999999899505,
    0.28571428625975487,
    0.2222221113479508,
    0.18182889125261723,
    0.15331721600556042,
    0.14616449685043406,
)
_erfcx = polynomial(
    1.283912401933249,
    -0.04179282426054168,
    -0.1006085645110349,
    0.11179778216964247,
    -0.07019928518989947,
    0.030947322509490865,
    -0.009843380026854972,
    0.002119694537561868,
    -0.00022461000617869883,
    -2.3760296525760404e-05,
    1.150177970305934e-05,
    -5.709012809907176e-07,
    -3.8663938250745935e-07,
    4.927463681440268e-08,
    1.3942262073777178e-08,
    -2.4168832249506796e-09,
    -6.032051629689462e-10,
    8.739895047740391e-11,
    2.484087226517852e-11,
)
# Giles 2012, "Approximating the erfinv function", single precision: the middle, and the tails
_erfinv_middle = polynomial(
    1.50140941,
    0.246640727,
    -0.00417768164,
    -0.00125372503,
    0.00021858087,
    -4.39150654e-06,
    -3.5233877e-06,
    3.43273939e-07,
    2.81022636e-08,
)
_erfinv_tail = polynomial(
    2.83297682,
    1.00167406,
    0.00943887047,
    -0.0076224613,
    0.00573950773,
    -0.00367342844,
    0.00134934322,
    0.000100950558,
    -0.000200214257,
)


@inline
def exp(x):
    """e^x for x <= 88; 0 below -87."""
    lowest = const(LOWEST, x)
    held = select(x > lowest, x, lowest)
    n = floor(held * const(1.0 / math.log(2.0), x) + 0.5)
    rest = held - n * _LN2_HIGH - n * _LN2_LOW
    return select(x > lowest, _exp(rest) * power_of_two(n), 0.0)


@inline
def log(x):
    """The natural logarithm of a positive normal number."""
    e, m = exponent_of(x), mantissa_of(x)
    large = m > const(math.sqrt(2.0), x)
    m, e = select(large, m * 0.5, m), select(large, e + 1.0, e)
    s = (m - 1.0) / (m + 1.0)
    square = s * s
    return e * _LN2_HIGH + (e * _LN2_LOW + (s * square * _log(square) + (s + s)))


@inline
def erfcx(x):
    """exp(x^2) erfc(x) for x in [0, 6]."""
    return _erfcx(1.625 * ((x - 3.75) / (x + 3.75)) + 0.625) / (1.0 + x + x)


@inline
def erf(x):
    """The error function of x >= 0; of large ones to an ulp of 1, not of their own."""
    most = const(LARGEST_ERROR_ARGUMENT, x)
    held = select(x < most, x, most)
    return 1.0 - exp(-held * held) * erfcx(held)


@inline
def rough_erfinv(x):
    """The inverse error function of |x| < 1, with errors below 4e-7 where 1 - |x| is above 2^-24."""
    w = -log((1.0 - x) * (1.0 + x))
    tail = _erfinv_tail(sqrt(select(w > 0.0, w, 1.0)) - 3.0)
    return x * select(w < 5.0, _erfinv_middle(w - 2.5), tail)
