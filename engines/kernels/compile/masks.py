"""Lanes as the bits of a word: comparisons of a field of all sixteen, and copies of some, each a few vector instructions."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from engines.kernels.compile.fields import LANES, word_of
from engines.kernels.compile.jit import inline
from engines.kernels.compile.lanes import LaneField
from engines.kernels.compile.memory import WORD, tag_access

EVERY_LANE = (1 << LANES) - 1
_BITS = ir.IntType(LANES)


def _vector_place(context: Any, builder: Any, kind: Any, base: Any, number: int) -> Any:
    """The address of number `number` of all lanes, as that of a vector; numbers lie on cache lines."""
    vector = ir.VectorType(context.get_value_type(kind), LANES)
    return builder.bitcast(builder.gep(base, [ir.Constant(WORD, number * LANES)]), vector.as_pointer())


def _load(builder: Any, place: Any) -> Any:
    value = builder.load(place, align=4)
    tag_access(builder.module, value, True)
    return value


def _field_value(context: Any, builder: Any, field: Any, base: Any) -> Any:
    """The first number of a field, of all lanes, as a vector."""
    return _load(builder, _vector_place(context, builder, field.real, base, field.field.first))


def _word(builder: Any, mask: Any) -> Any:
    return builder.zext(builder.bitcast(mask, _BITS), WORD)


@inline
def lane_bit(lane, condition):
    """The word of one lane, empty unless the condition holds."""
    return np.int64(1 if condition else 0) << np.int64(lane)


@inline
def has_lane(lanes, lane):
    """Whether the lane is in the word."""
    return (lanes >> np.int64(lane)) & 1 != 0


@intrinsic
def flagged_lanes(typing, field):
    """The word of the lanes whose flag is set."""
    if not isinstance(field, LaneField) or field.field.kind != "flag":
        return None

    def generate(context, builder, signature, arguments):
        value = _field_value(context, builder, field, arguments[0])
        words = ir.VectorType(ir.IntType(field.real.bitwidth), LANES)
        value = builder.bitcast(value, words)
        return _word(builder, builder.icmp_signed("!=", value, ir.Constant(words, None)))

    return types.int64(field), generate


@intrinsic
def positive_lanes(typing, field):
    """The word of the lanes whose number is above 0."""
    if not isinstance(field, LaneField) or field.field.kind != "number":
        return None

    def generate(context, builder, signature, arguments):
        value = _field_value(context, builder, field, arguments[0])
        return _word(builder, builder.fcmp_ordered(">", value, ir.Constant(value.type, None)))

    return types.int64(field), generate


def _compared(field: Any, relation: str, other: Any) -> Any:
    def generate(context, builder, signature, arguments):
        words = ir.VectorType(context.get_value_type(word_of(field.real)), LANES)
        place = _vector_place(context, builder, field.real, arguments[0], field.field.first)
        value = _load(builder, builder.bitcast(place, words.as_pointer()))
        return _word(builder, builder.icmp_signed(relation, value, ir.Constant(words, [other] * LANES)))

    return generate


@cache
def lanes_where(relation: str, number: int) -> Any:
    """The function of compiled code (field) -> word of the lanes whose integer is `relation`, such as ">=", to `number`."""

    @intrinsic
    def found(typing, field):
        return types.int64(field), _compared(field, relation, number)

    return found


@intrinsic
def copy_lanes(typing, to, source, field, lanes):
    """Copies a field of `reals`, in the lanes of the word `lanes`, from the same memory of another record: `to` and `source`
    are views of one layout, `field` is that field of either."""

    def generate(context, builder, signature, arguments):
        target, begun, _, word = arguments
        mask = builder.bitcast(builder.trunc(word, _BITS), ir.VectorType(ir.IntType(1), LANES))
        for number in range(field.field.first, field.field.first + field.field.n):
            place = _vector_place(context, builder, field.real, target, number)
            new = _load(builder, _vector_place(context, builder, field.real, begun, number))
            stored = builder.store(builder.select(mask, new, _load(builder, place)), place, align=4)
            tag_access(builder.module, stored, True)
        return context.get_dummy_value()

    return types.void(to, source, field, types.int64), generate
