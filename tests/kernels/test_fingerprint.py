"""The name of a user's stage is the same in every process, and another after any edit that its machine code depends on."""

import os
import subprocess
import sys
import types
from pathlib import Path

import numba
import numpy as np
import pytest

from engines.kernels.compile.fingerprint import NotFingerprinted, fingerprint
from engines.kernels.compile.jit import inline

ROOT = Path(__file__).resolve().parents[2]
SOURCE = """
import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import REAL, Row, Table, array, real, rows, scalar, table_view, vector
from engines.kernels.layout import ACCELERATOR, LANES, ray_batch, scene_table

FACTOR = 2.0
TABLE = np.array([1.0, 2.0])


class BoxRow(Row):
    low = vector()
    size = real()


class OwnTable(Table, first=ACCELERATOR):
    n = scalar()
    boxes = rows(BoxRow)
    numbers = array(REAL)


own_table = table_view(OwnTable)


@inline
def further(x):
    return x + 1.0


@inline
def scaled(x):
    return further(x) * FACTOR + TABLE[1]


def make(shadow, real):
    def stage(batch, scene_address):
        rays, own = ray_batch(batch, real), own_table(scene_address, real)
        for lane in range(np.uint64(LANES)):
            rays.t[lane] = scaled(own.boxes[0].size + own.numbers[1])

    return stage
"""
EDITS = {
    "a function that a function calls": ("x + 1.0", "x + 1.5"),
    "a number": ("FACTOR = 2.0", "FACTOR = 3.0"),
    "an array": ("[1.0, 2.0]", "[1.0, 3.0]"),
    "the order of a row": ("    low = vector()\n    size = real()", "    size = real()\n    low = vector()"),
    "the order of a table": ("    n = scalar()\n    boxes = rows(BoxRow)", "    boxes = rows(BoxRow)\n    n = scalar()"),
    "the type of an array": ("array(REAL)", "array(np.int32)"),
    "the stage": ("own.numbers[1]", "own.numbers[2]"),
}


def fingerprint_of(source, shadow=False, real="float32"):
    module = types.ModuleType("own_stage")
    exec(source, module.__dict__)
    return fingerprint(module.make(shadow, getattr(module.np, real)))


def test_two_processes_give_one_name():
    program = f"import tests.kernels.test_fingerprint as t; print(t.fingerprint_of({SOURCE!r}))"
    found = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
            cwd=ROOT,
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert found == {fingerprint_of(SOURCE)}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_gives_another_name(edit):
    before, after = EDITS[edit]
    assert SOURCE.count(before) == 1
    assert fingerprint_of(SOURCE.replace(before, after)) != fingerprint_of(SOURCE)


def test_what_a_factory_was_given_counts():
    names = {fingerprint_of(SOURCE, shadow, real) for shadow in (False, True) for real in ("float32", "float64")}
    assert len(names) == 2  # `shadow` is not used by the stage, so it is not part of it


def composed(function, factor=2.0):
    @inline
    def inner(x):
        return function(x) * factor

    return inner


@inline
def half(x):
    return x * 0.5


@inline
def double(x):
    return x * 2.0


def test_functions_and_numbers_that_a_function_closes_over_count():
    names = [fingerprint(composed(*given).py_func) for given in ((half,), (double,), (half, 3.0), (composed(half),))]
    assert len(set(names)) == 4
    assert fingerprint(composed(half).py_func) == names[0]


def test_a_function_that_calls_itself_has_a_name():
    def countdown(n):
        return countdown(n - 1) if n else 0

    assert fingerprint(countdown) == fingerprint(countdown)


class Opaque:
    """Of no layout, and no NamedTuple."""


@pytest.mark.parametrize(
    "value",
    [object(), [1, 2], {"a": 1}, np.array([object()]), Opaque, Opaque(), (1, object())],
    ids=lambda value: str(type(value)),
)
def test_values_without_a_name_are_refused(value):
    with pytest.raises(NotFingerprinted, match="name"):
        fingerprint(composed(half, value).py_func)


def test_a_value_without_a_name_is_refused():
    with pytest.raises(NotFingerprinted):
        fingerprint_of(SOURCE.replace("FACTOR = 2.0", "FACTOR = object()"))


def test_options_of_a_function_that_is_called_count():
    def square(x):
        return x * x

    def caller(function):
        def call(x):
            return function(x)

        return fingerprint(call)

    exact, fast = (numba.njit(fastmath=fast)(square) for fast in (False, True))
    assert caller(exact) != caller(fast)
    assert caller(exact) == caller(numba.njit(fastmath=False)(square))
