"""The fields of named, typed memory, as layouts declare them; see `records`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numba import types

LANES = 16
"""Lanes of a ray batch: one 512-bit vector of float32."""

REAL = "REAL"
"""Stands for the scalar type of the view: float32 or float64."""


def scalar_type_of(dtype: Any, real: Any) -> Any:
    return real if dtype is REAL else getattr(types, np.dtype(dtype).name)


def word_of(real: Any) -> Any:
    """The integer type as wide as `real`."""
    return types.int32 if real == types.float32 else types.int64


class Layout:
    """Collects the fields that a class declares, in order, and gives each its name."""

    fields: ClassVar[dict[str, Any]]

    def __init_subclass__(cls) -> None:
        cls.fields = {name: value for name, value in vars(cls).items() if isinstance(value, Field)}
        for name, value in cls.fields.items():
            value.name = name


class Field:
    """A field of a layout: `n` numbers of a `kind`, and where it lies."""

    def __init__(self, kind: str, n: int = 1, dtype: Any = REAL, row: Any = None, over: Any = None) -> None:
        self.kind, self.n, self.dtype, self.row, self.over = kind, n, dtype, row, over
        self.name, self.first = "", 0


def _declared(kind: str, n: int = 1, dtype: Any = REAL, row: Any = None) -> Any:
    return Field(kind, n, dtype, row)


def real() -> Any:
    """One number of the view's scalar type."""
    return _declared("number")


def reals(n: int) -> Any:
    """n numbers: `field[k, lane]` in lanes, `row.field[k]` in a row."""
    return _declared("numbers", n)


def vector() -> Any:
    """A Vec3."""
    return _declared("vector", 3)


def integer() -> Any:
    """In lanes: an integer as wide as the view's scalar type, whose bits are kept."""
    return _declared("integer")


def flag() -> Any:
    """In lanes: a truth value."""
    return _declared("flag")


def bits_of(field: Any) -> Any:
    """In lanes: the memory of another field of n numbers, as integers: `field[k, lane]`."""
    return Field("integers", field.n, over=field)


def doubles(n: int) -> Any:
    """In lanes: n float64 numbers, whatever the view's scalar type."""
    return _declared("doubles", n)


def scalar() -> Any:
    """In a table: a whole number."""
    return _declared("scalar")


def array(dtype: Any) -> Any:
    """In a table: an array of `dtype`, REAL or a NumPy type."""
    return _declared("array", 1, dtype)


def vectors(dtype: Any) -> Any:
    """In a table: an array (n, 3) of `dtype`, whose items are Vec3."""
    return _declared("vectors", 3, dtype)


def rows(row: Any) -> Any:
    """In a table: an array whose items are the rows of a `Row` layout."""
    return _declared("rows", row.size, row.dtype, row)
