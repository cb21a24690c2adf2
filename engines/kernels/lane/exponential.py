"""Exponential, logarithm and error function as vector code, to a few ulp of either precision.

Coefficients are interpolations at Chebyshev nodes, made in 50 digits, of truncation errors below 2e-17.
"""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, exponent_of, mantissa_of, polynomial, power_of_two, select
from engines.kernels.lane.target import floor, sqrt

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
