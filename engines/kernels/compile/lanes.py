"""The state of sixteen lanes as a record: see `records`."""

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

from engines.kernels.compile.fields import LANES, Field, Layout, word_of
from engines.kernels.compile.memory import WORD, index_word, load, store, teach_items
from engines.kernels.compile.vec3 import vec3_of


class LaneRecord(Layout):
    """Base class of the layouts of lanes: see `records`. `size` is the count of numbers of a lane."""

    size: ClassVar[int]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.size = 0
        for field in cls.fields.values():
            if field.over is not None:
                field.first = field.over.first
            else:
                cls.size = field.place(cls.size)

    @classmethod
    def field(cls, path: str) -> Field:
        """A field, such as "t" or "hit.point"."""
        name, *parts = path.split(".")
        found = cls.fields[name]
        for part in parts:
            found = found.parts[part]
        return found

    @classmethod
    def bytes(cls, scalar_type: Any) -> int:
        """Bytes of one record in the scalar type np.float32 or np.float64."""
        return cls.size * LANES * np.dtype(scalar_type).itemsize


class LaneView(types.Type):
    def __init__(self, layout: type[LaneRecord], scalar_type: Any) -> None:
        self.layout, self.real = layout, scalar_type
        super().__init__(name=f"{layout.__module__}.{layout.__qualname__}({scalar_type})")


class LaneField(types.Type):
    def __init__(self, layout: type[LaneRecord], scalar_type: Any, field: Field) -> None:
        self.layout, self.real, self.field = layout, scalar_type, field
        super().__init__(name=f"{layout.__module__}.{layout.__qualname__}.{field.name}({scalar_type})")

    def part(self, field: Field) -> LaneField:
        """The type of a part of a record."""
        return LaneField(self.layout, self.real, field)


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
        return None if field is None else LaneField(view.layout, view.real, field)


@lower_getattr_generic(LaneView)
def _lane_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    return value


@infer_getattr
class _RecordFields(AttributeTemplate):
    key = LaneField

    def generic_resolve(self, field: Any, name: str) -> Any:
        part = field.field.parts.get(name)
        return None if part is None else field.part(part)


@lower_getattr_generic(LaneField)
def _record_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    return value


def _lane_item(kind: Any, index: Any) -> Any:
    if kind.field.kind == "record":
        parts = [_lane_item(kind.part(part), index) for part in kind.field.parts.values()]
        return None if None in parts else types.BaseTuple.from_types(parts, kind.field.record)
    several = kind.field.kind in ("numbers", "integers", "doubles")
    if isinstance(index, types.BaseTuple) != several or (several and len(index) != 2):
        return None
    return {
        "number": kind.real,
        "numbers": kind.real,
        "vector": vec3_of(kind.real),
        "integer": word_of(kind.real),
        "integers": word_of(kind.real),
        "flag": types.boolean,
        "doubles": types.float64,
    }[kind.field.kind]


def _lane_place(builder: Any, base: Any, number: Any, lane: Any) -> Any:
    """Where number `number` (a 64-bit word) of a lane lies."""
    return builder.gep(base, [builder.add(builder.mul(number, ir.Constant(WORD, LANES)), lane)])


def _double_place(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    start = builder.gep(base, [ir.Constant(WORD, kind.field.first * LANES)])
    start = builder.bitcast(start, context.get_value_type(types.float64).as_pointer())
    return _lane_place(builder, start, index[0], index[1])


def _get_lane(context: Any, builder: Any, kind: Any, base: Any, index: Any) -> Any:
    field = kind.field
    if field.kind == "record":
        values = [_get_lane(context, builder, kind.part(part), base, index) for part in field.parts.values()]
        return context.make_tuple(builder, _lane_item(kind, types.int64), values)
    if field.kind == "doubles":
        return load(builder, _double_place(context, builder, kind, base, index), True)
    if field.kind in ("numbers", "integers"):
        number = builder.add(ir.Constant(WORD, field.first), index[0])
        value = load(builder, _lane_place(builder, base, number, index[1]), True)
        bits = context.get_value_type(word_of(kind.real))
        return value if field.kind == "numbers" else builder.bitcast(value, bits)
    places = [_lane_place(builder, base, ir.Constant(WORD, field.first + k), index[0]) for k in range(field.n)]
    values = [load(builder, place, True) for place in places]
    if field.kind == "vector":
        return context.make_tuple(builder, vec3_of(kind.real), values)
    if field.kind == "number":
        return values[0]
    word = context.get_value_type(word_of(kind.real))
    bits = builder.bitcast(values[0], word)
    return bits if field.kind == "integer" else builder.icmp_signed("!=", bits, ir.Constant(word, 0))


def _put_lane(context: Any, builder: Any, kind: Any, base: Any, index: Any, value: Any, of: Any) -> None:
    field = kind.field
    if field.kind == "record":
        for part, given, given_type in zip(field.parts.values(), cgutils.unpack_tuple(builder, value), of, strict=True):
            if given_type != types.none:
                _put_lane(context, builder, kind.part(part), base, index, given, given_type)
    elif field.kind == "doubles":
        value = context.cast(builder, value, of, types.float64)
        store(builder, value, _double_place(context, builder, kind, base, index), True)
    elif field.kind in ("numbers", "integers"):
        number = builder.add(ir.Constant(WORD, field.first), index[0])
        value = context.cast(builder, value, of, kind.real if field.kind == "numbers" else word_of(kind.real))
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
            value = context.cast(builder, value, of, word_of(kind.real))
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


@intrinsic
def lane_numbers(typing, field, lane):
    """A lane's numbers of a field of `reals` or `doubles`, as a tuple."""

    def generate(context, builder, sig, arguments):
        number = index_word(context, builder, arguments[1], sig.args[1])
        words = [[ir.Constant(WORD, k), number] for k in range(field.field.n)]
        return context.make_tuple(
            builder, sig.return_type, [_get_lane(context, builder, field, arguments[0], index) for index in words]
        )

    pair = types.UniTuple(types.int64, 2)
    return types.UniTuple(_lane_item(field, pair), field.field.n)(field, lane), generate
