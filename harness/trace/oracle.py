"""Exact answers: decimals of 80 digits, computed from the same floats that the engine gets.

Arrays here hold `decimal.Decimal`. Floats are converted without error; sums and products of coordinates between 1e-44 and
1e30 are then more exact than float64 can show. No code is shared with an engine.
"""

from __future__ import annotations

import decimal
from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Exact = NDArray[Any]
P = ParamSpec("P")
R = TypeVar("R")
DIGITS = 80
NONE = decimal.Decimal("Infinity")


def exactly(function: Callable[P, R]) -> Callable[P, R]:
    """Runs a function with `DIGITS` digits."""

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        with decimal.localcontext(prec=DIGITS):
            return function(*args, **kwargs)

    return run


def lift(values: ArrayLike) -> Exact:
    """The floats as decimals, without rounding."""
    return np.asarray(np.frompyfunc(decimal.Decimal, 1, 1)(np.asarray(values, np.float64).astype(object)), object)


_root = np.frompyfunc(lambda x: x.sqrt() if x >= 0 else NONE, 1, 1)


class Crossing(NamedTuple):
    """Where lines meet triangles: t, u, v, decimals; infinite where a line is parallel."""

    t: Exact
    u: Exact
    v: Exact


def _where(condition: Any, value: decimal.Decimal, others: Any) -> Exact:
    """`others` with `value` where the condition holds."""
    return np.where(np.asarray(condition, bool), np.array(value, object), others)


def dot(a: Exact, b: Exact) -> Exact:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a: Exact, b: Exact) -> Exact:
    parts = [a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)]
    return np.stack(parts, -1)


@exactly
def sphere_roots(center: ArrayLike, radius: ArrayLike, origin: ArrayLike, direction: ArrayLike) -> tuple[Exact, Exact]:
    """Nearer and farther t of lines (n, 3) with spheres, either sign; infinite for a line that misses."""
    f, d, r = lift(origin) - lift(center), lift(direction), lift(radius)
    a, b = dot(d, d), dot(f, d)
    root = _root(b * b - a * (dot(f, f) - r * r))
    missed = np.asarray(root == NONE, bool)
    root = _where(missed, decimal.Decimal(0), root)
    return tuple(_where(missed, NONE, (-b + sign * root) / a) for sign in (-1, 1))  # type: ignore[return-value]


@exactly
def triangle(a: ArrayLike, b: ArrayLike, c: ArrayLike, origin: ArrayLike, direction: ArrayLike) -> Crossing:
    """Crossings of lines (n, 3) with the planes of triangles, by Cramer's rule (exact here, whatever its rounding)."""
    first, o, d = lift(a), lift(origin), lift(direction)
    ab, ac, s = lift(b) - first, lift(c) - first, o - first
    p, q = cross(d, ac), cross(s, ab)
    det = dot(ab, p)
    parallel = np.asarray(det == 0, bool)
    det = _where(parallel, decimal.Decimal(1), det)
    parts = (dot(ac, q) / det, dot(s, p) / det, dot(d, q) / det)
    return Crossing(*(_where(parallel, NONE, part) for part in parts))


@exactly
def cylinder(
    p0: ArrayLike, p1: ArrayLike, radius: float, origin: ArrayLike, direction: ArrayLike
) -> tuple[Exact, NDArray[np.bool_]]:
    """Smallest t > 0 of lines (n, 3) with the side of a cylinder, infinite where there is none; and which lines are clear
    cases: those that come within 1e-3 of a tangent, or of an end, are not."""
    start, axis = lift(p0), lift(p1) - lift(p0)
    f, d, square = lift(origin) - start, lift(direction), dot(lift(p1) - lift(p0), lift(p1) - lift(p0))
    h, k = dot(f, axis) / square, dot(d, axis) / square
    f, d = f - h[:, None] * axis, d - k[:, None] * axis
    a, b, r2 = dot(d, d), dot(f, d), decimal.Decimal(radius) ** 2
    quarter = b * b - a * (dot(f, f) - r2)
    clear = np.abs((quarter / (a * r2)).astype(np.float64)) > 1e-3
    nearest = np.full(len(h), NONE, object)
    met = np.asarray(quarter > 0, bool)
    root = _root(_where(~met, decimal.Decimal(0), quarter))
    for sign in (1, -1):
        t = (-b + sign * root) / a
        place = h + k * t
        clear &= (np.abs(place.astype(np.float64)) > 1e-3) & (np.abs(place.astype(np.float64) - 1) > 1e-3)
        good = met & np.asarray(t > 0, bool) & np.asarray(place >= 0, bool) & np.asarray(place <= 1, bool)
        nearest[good] = t[good]
    return nearest, clear


@exactly
def relative(found: ArrayLike, exact: Exact) -> Array:
    """|found - exact| / |exact|, 0 where both are infinite, inf where one is."""
    return _distance(found, exact, abs(_where(exact == 0, decimal.Decimal(1), exact)))


@exactly
def absolute(found: ArrayLike, exact: Exact) -> Array:
    return _distance(found, exact, 1)


@exactly
def ulps(found: ArrayLike, exact: Exact, kind: Any) -> Array:
    """The distance in units in the last place of the floats `kind` at the exact value."""
    return _distance(found, exact, lift(np.spacing(np.abs(exact.astype(np.float64)).astype(kind))))


def _distance(found: ArrayLike, exact: Exact, unit: Any) -> Array:
    given = np.broadcast_to(np.asarray(found, np.float64), np.shape(exact))
    truth, unit = exact.astype(np.float64), np.broadcast_to(unit, np.shape(exact))
    usable = np.isfinite(given) & np.isfinite(truth)
    errors = np.where(np.isinf(given) & np.isinf(truth), 0.0, np.inf)
    errors[usable] = (abs(lift(given[usable]) - exact[usable]) / unit[usable]).astype(np.float64)
    return errors
