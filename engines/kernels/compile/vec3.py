"""Three-vectors as values of compiled code: a NamedTuple with the usual operators, which LLVM takes apart into registers."""

from __future__ import annotations

import operator
from typing import NamedTuple

from numba import types
from numba.extending import overload

from engines.kernels.compile.simd_types import Simd
from engines.kernels.compile.weak_literals import Weak, WeakCompiler, WeakFloat


class Vec3(NamedTuple):
    """x, y, z in one scalar type. Supports +, -, unary -, and * by a vector (by component) or a scalar."""

    x: float
    y: float
    z: float


ZERO = Weak(0.0)
BLACK, WHITE = Vec3(ZERO, ZERO, ZERO), Vec3(Weak(1.0), Weak(1.0), Weak(1.0))
"""Constants that take the type of what they meet, as literals do: a vector of literals alone is float64."""


def vec3_of(scalar: object) -> types.Type:
    """Numba's type of a Vec3 of a scalar type."""
    return types.NamedUniTuple(scalar, 3, Vec3)


def _is_vector(kind: object) -> bool:
    return isinstance(kind, (types.NamedTuple, types.NamedUniTuple)) and kind.instance_class is Vec3


def _is_number(kind: object) -> bool:
    return isinstance(kind, (types.Float, WeakFloat, Simd))


@overload(operator.add, jit_options={"pipeline_class": WeakCompiler})
def _add(a, b):
    if _is_vector(a) and _is_vector(b):
        return lambda a, b: Vec3(a.x + b.x, a.y + b.y, a.z + b.z)
    return None


@overload(operator.sub, jit_options={"pipeline_class": WeakCompiler})
def _sub(a, b):
    if _is_vector(a) and _is_vector(b):
        return lambda a, b: Vec3(a.x - b.x, a.y - b.y, a.z - b.z)
    return None


@overload(operator.mul, jit_options={"pipeline_class": WeakCompiler})
def _mul(a, b):
    if _is_vector(a) and _is_vector(b):
        return lambda a, b: Vec3(a.x * b.x, a.y * b.y, a.z * b.z)
    if _is_vector(a) and _is_number(b):
        return lambda a, b: Vec3(a.x * b, a.y * b, a.z * b)
    if _is_number(a) and _is_vector(b):
        return lambda a, b: Vec3(a * b.x, a * b.y, a * b.z)
    return None


@overload(operator.neg, jit_options={"pipeline_class": WeakCompiler})
def _neg(a):
    if _is_vector(a):
        return lambda a: Vec3(-a.x, -a.y, -a.z)
    return None
