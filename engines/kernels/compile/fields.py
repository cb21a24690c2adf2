"""The fields of named, typed memory, as layouts declare them; see `records`."""

from __future__ import annotations

from typing import Any, ClassVar, get_type_hints

import numpy as np
from numba import types

from engines.kernels.compile.vec3 import Vec3

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
            value.set_name(name)


class Field:
    """A field of a layout: `n` numbers of a `kind`, and where it lies."""

    def __init__(self, kind: str, n: int = 1, dtype: Any = REAL, row: Any = None, over: Any = None) -> None:
        self.kind, self.n, self.dtype, self.row, self.over = kind, n, dtype, row, over
        self.name, self.first = "", 0
        self.record: Any = None
        self.parts: dict[str, Field] = {}

    def set_name(self, name: str) -> None:
        """Gives the field its name, and its parts theirs, such as `hit.point`."""
        self.name = name
        for part, field in self.parts.items():
            field.set_name(f"{name}.{part}")

    def place(self, first: int) -> int:
        """Puts the field at number `first` of a lane; returns the number behind it."""
        self.first = first
        for part in self.parts.values():
            first = part.place(first)
        self.n = first - self.first if self.parts else self.n
        return first if self.parts else first + self.n * (2 if self.kind == "doubles" else 1)


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


def record(kind: type) -> Any:
    """In lanes: a NamedTuple, whose fields are as annotated: `float`, `int`, `bool`, `Vec3`, or another NamedTuple.
    `field[lane]` loads it, `field[lane] = value` stores what in it is not None, `field.part[lane]` is one of its fields."""
    field = Field("record")
    field.record, field.parts = kind, {name: _part(hint) for name, hint in get_type_hints(kind).items()}
    return field


def _part(hint: Any) -> Field:
    kinds = {float: "number", int: "integer", bool: "flag"}
    if hint is Vec3:
        return Field("vector", 3)
    return Field(kinds[hint]) if hint in kinds else record(hint)


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
