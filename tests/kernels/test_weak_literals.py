"""Float literals in compiled code take the type of what they meet."""

import math
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from engines.kernels.compile.values import fma, select
from engines.kernels.compile.vec3 import Vec3
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
