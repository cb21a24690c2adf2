"""Rows, and tables of arrays, as records: see `records`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, models, register_model

from engines.kernels.compile.fields import REAL, Field, Layout, scalar_type_of
from engines.kernels.compile.memory import WORD, ArrayType, load, teach_items
from engines.kernels.compile.vec3 import vec3_of


class Row(Layout):
    """Base class of the layouts of rows: see `records`. `size` numbers of `dtype`, REAL unless the class sets another."""

    size: ClassVar[int]
    dtype: ClassVar[Any] = REAL

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.size = 0
        for field in cls.fields.values():
            field.first = cls.size
            cls.size += field.n

    @classmethod
    def packed(cls, **values: Any) -> list[float]:
        """The numbers of a row with these fields, 0 where one is not given. Raises TypeError for a field it lacks."""
        numbers = [0.0] * cls.size
        for name, value in values.items():
            if name not in cls.fields:
                raise TypeError(f"{cls.__name__} has no field {name!r}")
            field, parts = cls.fields[name], np.atleast_1d(value).tolist()
            if len(parts) > field.n or (field.kind != "numbers" and len(parts) != field.n):
                raise TypeError(f"{cls.__name__}.{name}: {len(parts)} numbers, of {field.n}")
            numbers[field.first : field.first + len(parts)] = map(float, parts)
        return numbers


class Table(Layout):
    """Base class of the layouts of tables: see `records`. With `first` its slots start there."""

    slots: ClassVar[int]

    def __init_subclass__(cls, first: int = 0) -> None:
        super().__init_subclass__()
        cls.slots = first
        for field in cls.fields.values():
            field.first = cls.slots
            cls.slots += 1


class TableView(types.Type):
    def __init__(self, layout: type[Table], scalar_type: Any) -> None:
        self.layout, self.real = layout, scalar_type
        super().__init__(name=f"{layout.__module__}.{layout.__qualname__}({scalar_type})")


class Vectors(types.Type):
    """An array (n, 3) of the scalar type `dtype`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Vectors({dtype})")


class Rows(types.Type):
    def __init__(self, row: type[Row], dtype: Any) -> None:
        self.row, self.dtype = row, dtype
        super().__init__(name=f"Rows({row.__module__}.{row.__qualname__}, {dtype})")


class RowView(types.Type):
    def __init__(self, row: type[Row], dtype: Any) -> None:
        self.row, self.dtype = row, dtype
        super().__init__(name=f"{row.__module__}.{row.__qualname__}({dtype})")


@register_model(TableView)
class _TableModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, WORD)


@register_model(Vectors)
@register_model(Rows)
@register_model(RowView)
class _PointerModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager.lookup(kind.dtype).get_value_type().as_pointer())


def _slot_type(field: Field, scalar_type: Any) -> Any:
    if field.kind == "scalar":
        return types.int64
    dtype = scalar_type_of(field.dtype, scalar_type)
    if field.kind == "rows":
        return Rows(field.row, dtype)
    return ArrayType(dtype) if field.kind == "array" else Vectors(dtype)


@infer_getattr
class _TableSlots(AttributeTemplate):
    key = TableView

    def generic_resolve(self, view: Any, name: str) -> Any:
        field = view.layout.fields.get(name)
        return None if field is None else _slot_type(field, view.real)


@lower_getattr_generic(TableView)
def _slot(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    field = kind.layout.fields[name]
    slots = builder.inttoptr(value, WORD.as_pointer())
    word = load(builder, builder.gep(slots, [ir.Constant(WORD, field.first)]))
    if field.kind == "scalar":
        return word
    return builder.inttoptr(word, context.get_value_type(_slot_type(field, kind.real)))


@infer_getattr
class _RowFields(AttributeTemplate):
    key = RowView

    def generic_resolve(self, row: Any, name: str) -> Any:
        field = row.row.fields.get(name)
        if field is None:
            return None
        return {"number": row.dtype, "vector": vec3_of(row.dtype), "numbers": ArrayType(row.dtype)}[field.kind]


@lower_getattr_generic(RowView)
def _row_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    field = kind.row.fields[name]
    places = [builder.gep(value, [ir.Constant(WORD, field.first + k)]) for k in range(field.n)]
    if field.kind == "numbers":
        return places[0]
    values = [load(builder, place) for place in places]
    return context.make_tuple(builder, vec3_of(kind.dtype), values) if field.kind == "vector" else values[0]


def _get_vector(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    first = builder.mul(index[0], ir.Constant(WORD, 3))
    places = [builder.gep(base, [builder.add(first, ir.Constant(WORD, k))]) for k in range(3)]
    return context.make_tuple(builder, vec3_of(kind.dtype), [load(builder, place) for place in places])


def _nth_row(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    return builder.gep(base, [builder.mul(index[0], ir.Constant(WORD, kind.row.size))])


teach_items(Vectors, lambda kind, index: vec3_of(kind.dtype) if isinstance(index, types.Integer) else None, _get_vector)
teach_items(Rows, lambda kind, index: RowView(kind.row, kind.dtype) if isinstance(index, types.Integer) else None, _nth_row)


def table_view(layout: type[Table]) -> Callable[..., Any]:
    """The function of compiled code (address, scalar type) -> view of the table there."""

    @intrinsic
    def view(typing, address, kind):
        def generate(context, builder, sig, arguments):
            return arguments[0]

        return TableView(layout, kind.dtype)(types.int64, kind), generate

    return view
