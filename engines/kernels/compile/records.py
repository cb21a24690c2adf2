"""Named, typed memory: what kernels write as `rays.origin[lane]`, `scene.lights[i].position`.

Three kinds of layout are declared as classes:

- `LaneRecord`: the state of sixteen lanes, field by field, each field sixteen numbers in a row. `lane_view(Layout)` makes
  the function `view(address, real)`. Of a view, `view.field[lane]` loads and `view.field[lane] = value` stores; `view[k]`
  is the view of the k-th such record in memory that holds several.
- `Row`: numbers of one type side by side; `row.field` loads.
- `Table`: 64-bit slots, each the address of an array or a whole number. `table_view(Layout)` makes `view(address, real)`,
  of which `view.array[i]` and `view.number` load.

A view is an address and its field a constant offset: nothing of this is left in machine code.
"""

<<<<<<< HEAD
from engines.kernels.compile.fields import (
    LANES,
    REAL,
    Field,
    array,
    bits_of,
    doubles,
    flag,
    integer,
    real,
    reals,
    rows,
    scalar,
    vector,
    vectors,
=======
from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, models, register_model

from engines.kernels.compile.memory import WORD, ArrayType, load, store, teach_items
from engines.kernels.compile.vec3 import vec3_of

LANES = 16
"""Lanes of a ray batch: one 512-bit vector of float32."""

REAL = "REAL"
"""Stands for the scalar type of the view: float32 or float64."""


def _scalar(dtype: Any, real: Any) -> Any:
    return real if dtype is REAL else getattr(types, np.dtype(dtype).name)


def _word(real: Any) -> Any:
    """The integer type as wide as `real`."""
    return types.int32 if real == types.float32 else types.int64


class _Layout:
    """Collects the fields that a class declares, in order, and tells each its name."""

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


# ---- lanes -----------------------------------------------------------------------------------------------------------


class LaneRecord(_Layout):
    """Base class of the layouts of lanes: see the module. `size` is the numbers a lane has."""

    size: ClassVar[int]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.size = 0
        for field in cls.fields.values():
            if field.over is not None:
                field.first = field.over.first
                continue
            field.first = cls.size
            cls.size += field.n * (2 if field.kind == "doubles" else 1)

    @classmethod
    def bytes(cls, scalar_type: Any) -> int:
        """Bytes of one record in the scalar type np.float32 or np.float64."""
        return cls.size * LANES * np.dtype(scalar_type).itemsize


class LaneView(types.Type):
    def __init__(self, layout: type[LaneRecord], scalar_type: Any) -> None:
        self.layout, self.real = layout, scalar_type
        super().__init__(name=f"{layout.__name__}({scalar_type})")


class LaneField(types.Type):
    def __init__(self, layout: str, scalar_type: Any, field: Field) -> None:
        self.real, self.field = scalar_type, field
        super().__init__(name=f"{layout}.{field.name}({scalar_type})")


@register_model(LaneView)
@register_model(LaneField)
class _LaneModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager.lookup(kind.real).get_value_type().as_pointer())


@infer_getattr
class _LaneFields(AttributeTemplate):
    key = LaneView

    def generic_resolve(self, view: Any, name: str) -> Any:
        field = view.layout.fields.get(name)
        return None if field is None else LaneField(view.layout.__name__, view.real, field)


@lower_getattr_generic(LaneView)
def _lane_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    return value


def _lane_item(kind: Any, index: Any) -> Any:
    several = kind.field.kind in ("numbers", "integers", "doubles")
    if isinstance(index, types.BaseTuple) != several or (several and len(index) != 2):
        return None
    return {
        "number": kind.real, "numbers": kind.real, "vector": vec3_of(kind.real), "integer": _word(kind.real),
        "integers": _word(kind.real), "flag": types.boolean, "doubles": types.float64,
    }[kind.field.kind]  # fmt: skip


def _lane_place(builder: Any, base: Any, number: Any, lane: Any) -> Any:
    """Where number `number` (a 64-bit word) of a lane lies."""
    return builder.gep(base, [builder.add(builder.mul(number, ir.Constant(WORD, LANES)), lane)])


def _double_place(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    start = builder.gep(base, [ir.Constant(WORD, kind.field.first * LANES)])
    start = builder.bitcast(start, context.get_value_type(types.float64).as_pointer())
    return _lane_place(builder, start, index[0], index[1])


def _get_lane(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    field = kind.field
    if field.kind == "doubles":
        return load(builder, _double_place(context, builder, kind, base, index), True)
    if field.kind in ("numbers", "integers"):
        number = builder.add(ir.Constant(WORD, field.first), index[0])
        value = load(builder, _lane_place(builder, base, number, index[1]), True)
        bits = context.get_value_type(_word(kind.real))
        return value if field.kind == "numbers" else builder.bitcast(value, bits)
    places = [_lane_place(builder, base, ir.Constant(WORD, field.first + k), index[0]) for k in range(field.n)]
    values = [load(builder, place, True) for place in places]
    if field.kind == "vector":
        return context.make_tuple(builder, vec3_of(kind.real), values)
    if field.kind == "number":
        return values[0]
    word = context.get_value_type(_word(kind.real))
    bits = builder.bitcast(values[0], word)
    return bits if field.kind == "integer" else builder.icmp_signed("!=", bits, ir.Constant(word, 0))


def _put_lane(context: Any, builder: Any, kind: Any, base: Any, index: Any, value: Any, of: Any) -> None:
    field = kind.field
    if field.kind == "doubles":
        value = context.cast(builder, value, of, types.float64)
        store(builder, value, _double_place(context, builder, kind, base, index), True)
    elif field.kind in ("numbers", "integers"):
        number = builder.add(ir.Constant(WORD, field.first), index[0])
        value = context.cast(builder, value, of, kind.real if field.kind == "numbers" else _word(kind.real))
        value = builder.bitcast(value, context.get_value_type(kind.real))
        store(builder, value, _lane_place(builder, base, number, index[1]), True)
    elif field.kind == "vector":
        for k, (part, part_type) in enumerate(zip(cgutils.unpack_tuple(builder, value), of, strict=True)):
            place = _lane_place(builder, base, ir.Constant(WORD, field.first + k), index[0])
            store(builder, context.cast(builder, part, part_type, kind.real), place, True)
    else:
        if field.kind == "number":
            value = context.cast(builder, value, of, kind.real)
        else:
            value = context.cast(builder, value, of, _word(kind.real))
            value = builder.bitcast(value, context.get_value_type(kind.real))
        store(builder, value, _lane_place(builder, base, ir.Constant(WORD, field.first), index[0]), True)


def _nth_record(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    return builder.gep(base, [builder.mul(index[0], ir.Constant(WORD, kind.layout.size * LANES))])


teach_items(LaneField, _lane_item, _get_lane, _put_lane)
teach_items(LaneView, lambda kind, index: kind if isinstance(index, types.Integer) else None, _nth_record)


def lane_view(layout: type[LaneRecord]) -> Callable[..., Any]:
    """The function of compiled code (address, scalar type) -> view of the record there."""

    @intrinsic
    def view(typing, address, kind):
        def generate(context, builder, sig, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(sig.return_type))

        return LaneView(layout, kind.dtype)(types.int64, kind), generate

    return view


# ---- rows and tables -------------------------------------------------------------------------------------------------


class Row(_Layout):
    """Base class of the layouts of rows: see the module. `size` numbers of `dtype`, REAL unless the class says
    otherwise."""

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


class Table(_Layout):
    """Base class of the layouts of tables: see the module. With `first` its slots start there."""

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
        super().__init__(name=f"{layout.__module__}.{layout.__name__}({scalar_type})")


class Vectors(types.Type):
    """An array (n, 3) of the scalar type `dtype`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Vectors({dtype})")


class Rows(types.Type):
    def __init__(self, row: type[Row], dtype: Any) -> None:
        self.row, self.dtype = row, dtype
        super().__init__(name=f"Rows({row.__module__}.{row.__name__}, {dtype})")


class RowView(types.Type):
    def __init__(self, row: type[Row], dtype: Any) -> None:
        self.row, self.dtype = row, dtype
        super().__init__(name=f"{row.__module__}.{row.__name__}({dtype})")


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
    dtype = _scalar(field.dtype, scalar_type)
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
teach_items(
    Rows, lambda kind, index: RowView(kind.row, kind.dtype) if isinstance(index, types.Integer) else None, _nth_row
>>>>>>> h-accel
)
from engines.kernels.compile.lanes import LaneField, LaneRecord, lane_view
from engines.kernels.compile.tables import Row, Table, table_view

__all__ = [
    "LANES", "REAL", "Field", "LaneField", "LaneRecord", "Row", "Table", "array", "bits_of", "doubles", "flag", "integer",
    "lane_view", "real", "reals", "rows", "scalar", "table_view", "vector", "vectors",
]  # fmt: skip
