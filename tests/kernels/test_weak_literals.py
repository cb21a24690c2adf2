"""Float literals in compiled code take the type of what they meet."""

import math
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import fma, select
from engines.kernels.compile.vec3 import BLACK, WHITE, ZERO, Vec3
from engines.kernels.compile.weak_literals import WeakCompiler

THIRD = 1.0 / 3.0


def compiled(function):
    return numba.njit(pipeline_class=WeakCompiler)(function)


def arithmetic(x):
    return 2.0 * x + math.pi / 2.0 - (0.5 if x > 0.0 else x) + THIRD


def accumulated(x):
    total = 0.0
    for _ in range(3):
        total += x
    return total


def selected(x):
    return select(x > 0.25, x, 0.1) + select(x > 0.25, 0.1, x) + fma(x, 2.0, 0.1) + max(x, 0.1) + min(0.1, x)


def folded(x):
    return x * math.sqrt(2.0) + math.log(2.0) * x


def in_a_vector(x):
    v = Vec3(-x, x, 0.1) * (2.0 * math.pi)
    return v.x + v.y + v.z


@pytest.mark.parametrize("function", [arithmetic, accumulated, selected, folded, in_a_vector])
@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_literals_do_not_change_the_type_of_arithmetic(function, real):
    jitted = compiled(function)
    jitted(real(0.7))
    (overload,) = jitted.overloads.values()
    assert overload.signature.return_type == getattr(numba.types, real.__name__)


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_literal_is_rounded_once(real):
    assert compiled(lambda x: x * (2.0 * math.pi / 3.0))(real(1)) == real(2 * math.pi / 3)


def test_a_number_type_makes_a_literal_its_own():
    assert compiled(lambda x: np.float64(0.1) * x)(np.float32(1)) == 0.1


def test_literals_that_only_meet_at_run_time_are_refused():
    def both(c):
        one = 1.0 if c else 2.0
        return one * one

    with pytest.raises(TypingError, match="all operands are float literals"):
        compiled(both)(True)


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_vectors_of_literals_alone_are_float64_and_may_be_added_to(real):
    def added(x):
        total, other = Vec3(0.0, 0.0, 0.0), Vec3(1.0, 0.0, 0.0) + Vec3(0.0, 1.0, 0.0)
        for _ in range(3):
            total = total + Vec3(x, x, x)
        return total.x + other.y if x > 0.0 else 0.0

    assert compiled(added)(real(2)) == 7.0


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_black_and_white_take_the_type_of_what_they_meet(real):
    def met(x):
        v = select(x > 0.0, Vec3(x, x, x), BLACK) + WHITE * x
        return v.x + ZERO

    jitted = compiled(met)
    assert jitted(real(2)) == 4.0
    (overload,) = jitted.overloads.values()
    assert overload.signature.return_type == getattr(numba.types, real.__name__)


def test_python_gets_constants_of_no_type_of_their_own_as_floats():
    assert inline(lambda x: BLACK)(1.0) == (0.0, 0.0, 0.0)


class Sample(NamedTuple):
    count: int
    direction: Vec3
    weight: float


@pytest.mark.parametrize("function", [lambda x: x + 1.0 / 0.0, lambda x: x + math.sqrt(-1.0)])
def test_literals_without_a_value_in_python_are_refused(function):
    with pytest.raises(TypingError, match="all operands are float literals"):
        compiled(function)(np.float32(1))


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_literal_in_a_record_has_the_type_of_its_other_numbers(real):
    sample = compiled(lambda x: Sample(1, Vec3(x, 0.0, 1.0), weight=0.5))
    sample(real(1))
    (overload,) = sample.overloads.values()
    kind = getattr(numba.types, real.__name__)
    _, direction, weight = overload.signature.return_type
    assert (direction.dtype, weight) == (kind, kind)
